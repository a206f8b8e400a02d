"""`gcs replay`: show a recorded flight in the terminal, draw it, or send it to another ground station."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from gcs.cli.console import Screen
from gcs.cli.shared_options import DebugOption, JsonOption, recordings
from gcs.errors import UsageError

if TYPE_CHECKING:
    from gcs.flight.recording.recording import Recording


SPEEDS = (0.01, 10_000.0)  # least and most, in multiples of real time


def replay(
    flight: Annotated[
        Path,
        typer.Argument(
            metavar="FLIGHT", help="Folder of a flight, or any .tlog.", show_default=False, autocompletion=recordings
        ),
    ],
    speed: Annotated[
        str | None,
        typer.Option(
            "--speed", metavar="TIMES", help="Speed in multiples of real time, or max. Default 10; with --to-link 1."
        ),
    ] = None,
    from_s: Annotated[
        float | None,
        typer.Option(
            "--from", metavar="SECONDS", help="Begin at this plan time; in a .tlog without a plan, at this log time."
        ),
    ] = None,
    until_s: Annotated[
        float | None, typer.Option(*("--until", "--to"), metavar="SECONDS", help="End at this time.")
    ] = None,
    picture: Annotated[
        Path | None,
        typer.Option(
            "--picture", "-p", metavar="FILE", help="Draw the flight (.png, .svg, .pdf) instead of showing it."
        ),
    ] = None,
    to_link: Annotated[
        str | None,
        typer.Option(
            "--to-link",
            metavar="LINK",
            help="Send the recorded frames of the vehicles to another ground station, at their times: "
            "udpout:127.0.0.1:14550.",
        ),
    ] = None,
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Show a recorded flight: positions, modes and events over time.

    Examples: gcs replay flights/2026-01-31-120000-simulation1 --speed 20 --from 0

    gcs replay flights/2026-01-31-120000-simulation1 --picture flight.png

    gcs replay recorded.tlog --to-link udpout:127.0.0.1:14550
    """
    screen = Screen(json=json)
    rate = _rate(speed, to_link)
    if picture is not None and to_link is not None:
        raise UsageError("--picture and --to-link exclude each other", hint="draw in a command of its own")
    if picture is not None:
        from gcs.flight.assessment.pictures.figure_file import refuse_kind

        refuse_kind(picture)
    from gcs.flight.recording.load_recording import load_recording

    loaded = load_recording(flight)
    recording = loaded.recording
    for note in recording.notes:
        screen.say(f"note: {note}")
    window = _window(recording, from_s, until_s)
    if picture is not None:
        from gcs.flight.assessment.replay_plot import save_picture

        save_picture(recording, *window, picture)
        screen.say(f"picture: {picture}")
        screen.result({**_data(recording, window), "picture": picture})
        return 0
    from gcs.aio import Stoppable
    from gcs.cli.flights.replay_view import play

    sent = Stoppable().run(play(screen, loaded, window, rate, to_link))
    screen.result({**_data(recording, window), "sent": sent})
    return 0


def _rate(speed: str | None, to_link: str | None) -> float:
    if speed == "max":
        if to_link is not None:
            raise UsageError("--speed max: --to-link sends frames at their times", hint="give a number")
        return float("inf")
    try:
        rate = float(speed) if speed is not None else (10.0 if to_link is None else 1.0)
    except ValueError:
        rate = 0.0
    if not SPEEDS[0] <= rate <= SPEEDS[1]:
        hint = f"give a number from {SPEEDS[0]:g} to {SPEEDS[1]:g}, or max"
        raise UsageError(f"--speed {speed}: not a speed", hint=hint)
    if to_link is not None:
        from gcs.link.endpoints.base import LinkMode, parse_link_spec

        if parse_link_spec(to_link).mode is not LinkMode.CALL:
            raise UsageError(
                f"--to-link {to_link}: this link cannot call a ground station",
                hint="write for example udpout:127.0.0.1:14550",
            )
    return rate


def _window(recording: Recording, from_s: float | None, until_s: float | None) -> tuple[float, float]:
    """The first and last time to show. Raises `UsageError` where the recording has nothing between them."""
    begin_s, end_s = recording.span_s
    first = begin_s if from_s is None else max(begin_s, from_s)
    last = end_s if until_s is None else min(end_s, until_s)
    if not first < last:
        given = " ".join(f"{name} {t:g}" for name, t in (("--from", from_s), ("--until", until_s)) if t is not None)
        raise UsageError(
            f"{given or 'this flight'}: nothing to show; its reports are from {begin_s:.1f} s to {end_s:.1f} s",
            hint="give times within these",
        )
    return first, last


def _data(recording: Recording, window: tuple[float, float]) -> dict[str, Any]:
    from gcs.autopilots.traits import autopilot_name

    def within(t_s: float) -> bool:
        return window[0] <= t_s <= window[1]

    return {
        "name": recording.name,
        "from_s": window[0],
        "to_s": window[1],
        "planned": recording.plan is not None,
        "vehicles": [
            {"sysid": t.sysid, "autopilot": autopilot_name(t.autopilot), "reports": sum(map(within, t.t_s.tolist()))}
            for t in recording.tracks
        ],
        "events": [vars(event) for event in recording.events if within(event.t_s)],
        "notes": recording.notes,
    }
