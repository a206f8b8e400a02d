"""`gcs replay`: show a recorded flight in the terminal, draw it, or send it to another ground station."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from gcs.cli.shared.console import Screen
from gcs.cli.shared.page_option import PageOption, TilesOption, refuse_tiles, show_page
from gcs.cli.shared.shared_options import DebugOption, JsonOption, argument, as_rate, option, recordings
from gcs.errors import UsageError
from gcs.page.page_feed import refuse_without_nicegui

if TYPE_CHECKING:
    from gcs.flight.recording.recording import Recording
    from gcs.types import JsonObject


def replay(
    flight: Annotated[Path, argument("Folder of a flight, or any .tlog.", "FLIGHT", recordings)],
    speed: Annotated[
        str | None, option("Speed in multiples of real time, or max. Default 10; with --to-link 1.", metavar="TIMES")
    ] = None,
    from_s: Annotated[
        float | None,
        option("Begin at this plan time; in a .tlog without a plan, at this log time.", "--from", metavar="SECONDS"),
    ] = None,
    until_s: Annotated[float | None, option("End at this time.", "--until", "--to", metavar="SECONDS")] = None,
    picture: Annotated[
        Path | None,
        option("Draw the flight (.png, .svg, .pdf) instead of showing it.", "--picture", "-p", metavar="FILE"),
    ] = None,
    to_link: Annotated[
        str | None,
        option(
            "Send the recorded frames of the vehicles to another ground station, at their times: "
            "udpout:127.0.0.1:14550.",
            metavar="LINK",
        ),
    ] = None,
    page: PageOption = False,
    tiles: TilesOption = "",
    json: JsonOption = False,
    debug: DebugOption = False,
) -> int:
    """Show a recorded flight: positions, modes and events over time.

    Examples: gcs replay flights/2026-01-31-120000-simulation1 --speed 20 --from 0

    gcs replay flights/2026-01-31-120000-simulation1 --picture flight.png

    gcs replay recorded.tlog --to-link udpout:127.0.0.1:14550

    gcs replay flights/2026-01-31-120000-simulation1 --page
    """
    screen = Screen(json=json)
    rate = _rate(speed, to_link)
    given = [name for name, is_given in (("--picture", picture), ("--to-link", to_link), ("--page", page)) if is_given]
    if len(given) > 1:
        raise UsageError(f"{' and '.join(given)} exclude each other", hint="give each in a command of its own")
    refuse_tiles(tiles, page=page)
    if page:
        refuse_without_nicegui()
    if picture is not None:
        from gcs.flight.plots.figure_file import refuse_kind

        refuse_kind(picture)
    from gcs.flight.recording.load_recording import load_recording

    loaded = load_recording(flight)
    recording = loaded.recording
    for note in recording.notes:
        screen.say(f"note: {note}")
    window = _window(recording, from_s, until_s)
    if page:
        from gcs.flight.scene.recording_scene import scene_of_recording

        show_page(screen, scene_of_recording(recording, *window), _data(recording, window), tiles)
        return 0
    if picture is not None:
        from gcs.flight.plots.replay_plot import save_picture

        save_picture(recording, *window, picture)
        screen.say(f"picture: {picture}")
        screen.result({**_data(recording, window), "picture": picture})
        return 0
    from gcs.cli.flights.replay_view import play
    from gcs.util.aio import Stoppable

    sent = Stoppable().run(play(screen, loaded, window, rate, to_link))
    screen.result({**_data(recording, window), "sent": sent})
    return 0


def _rate(speed: str | None, to_link: str | None) -> float:
    rate = as_rate("--speed", speed or ("10" if to_link is None else "1"))
    if to_link is not None:
        if speed == "max":
            raise UsageError("--speed max: --to-link sends frames at their times", hint="give a number")
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


def _data(recording: Recording, window: tuple[float, float]) -> JsonObject:
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
