"""A recorded flight against time: a table that moves, or lines, and frames towards another ground station.

Knows: the wall's clock, how a moment is shown. Does not know: files.
"""

from __future__ import annotations

import asyncio
import bisect
import math
from collections import deque
from contextlib import AsyncExitStack, nullcontext
from dataclasses import dataclass

import numpy as np
from rich.live import Live
from rich.table import Table

from gcs.autopilots.flight_modes import mode_name
from gcs.cli.console import Screen
from gcs.flight.progress import Event
from gcs.flight.recording.load_recording import LoadedRecording
from gcs.flight.recording.recording import SILENCE_S, Recording, VehicleTrack, nearest_m
from gcs.link.endpoints.base import Endpoint
from gcs.link.endpoints.factory import make_endpoint

_TICK_S, _SENDING_S = 0.1, 0.005
_LINE_EVERY_S = 5.0  # of the wall's clock
_LINES = 10  # where time does not count
_SAID = 4  # events under the table
_BURST = 100  # frames before others get their turn


@dataclass(frozen=True)
class ReplayMoment:
    """One vehicle at an instant of the replay; None where it was not heard of yet."""

    sysid: int
    mode: str
    armed: bool
    height_m: float
    speed_mps: float
    error_m: float  # NaN without a plan
    battery_pct: int
    age_s: float


async def play(
    screen: Screen, recalled: LoadedRecording, window: tuple[float, float], rate: float, to_link: str | None
) -> int:
    """Show a stretch at `rate` times real time; the frames sent. Raises `LinkError`."""
    recording, loop = recalled.recording, asyncio.get_running_loop()
    happened = sorted((*recording.events, *recording.remarks), key=lambda event: event.t_s)
    happened = [event for event in happened if window[0] <= event.t_s <= window[1]]
    step_s = _LINE_EVERY_S * rate if math.isfinite(rate) else (window[1] - window[0]) / _LINES
    lines = deque([*np.arange(window[0], window[1] - 0.1 * step_s, step_s).tolist(), window[1]])
    sent = told = 0
    async with AsyncExitStack() as stack:
        endpoint = await _opened(to_link, stack)
        frames = _Frames(recalled, window)
        live = Live(console=screen.console, refresh_per_second=10, transient=True) if screen.is_watched else None
        with live or nullcontext():
            began_s = loop.time()
            while True:
                past_s = (loop.time() - began_s) * rate if math.isfinite(rate) else math.inf
                t_s = min(window[0] + past_s, window[1])
                if endpoint is not None:
                    sent += await frames.send(endpoint, t_s)
                while lines and lines[0] <= t_s and live is None:
                    told = _tell(screen, happened, told, lines[0])
                    screen.say(_line(recording, lines.popleft()))
                if live is not None:
                    told = bisect.bisect_right(happened, t_s, key=lambda event: event.t_s)
                    live.update(_table(recording, window, t_s, happened[:told][-_SAID:]))
                else:
                    told = _tell(screen, happened, told, t_s)
                if t_s >= window[1]:
                    break
                await asyncio.sleep(_TICK_S if endpoint is None else _SENDING_S)
        if live is not None:
            _tell(screen, happened, 0, window[1])
            screen.say(_line(recording, window[1]))
        if endpoint is not None:
            lost = getattr(endpoint, "lost", 0)
            screen.say(f"{sent} frames sent to {to_link}" + (f", {lost} were not taken" if lost else ""))
    return sent


async def _opened(to_link: str | None, stack: AsyncExitStack) -> Endpoint | None:
    if to_link is None:
        return None
    endpoint = make_endpoint(to_link)
    await endpoint.open(lambda data, address: None)  # nobody flies here who could be told anything
    stack.callback(endpoint.close)
    return endpoint


class _Frames:
    """What is still to be sent."""

    def __init__(self, recalled: LoadedRecording, window: tuple[float, float]) -> None:
        self._t_s, self._frames = recalled.t_s, recalled.frames
        self._next = int(np.searchsorted(self._t_s, window[0]))

    async def send(self, endpoint: Endpoint, t_s: float) -> int:
        """All that were due at `t_s`, in order."""
        end = int(np.searchsorted(self._t_s, t_s, side="right"))
        count = max(end - self._next, 0)
        for n in range(self._next, end):
            endpoint.send(self._frames[n])
            if n % _BURST == _BURST - 1:
                await asyncio.sleep(0)
        self._next = max(end, self._next)
        return count


def _tell(screen: Screen, happened: list[Event], told: int, t_s: float) -> int:
    while told < len(happened) and happened[told].t_s <= t_s:
        screen.say(str(happened[told]))
        told += 1
    return told


def moments(recording: Recording, t_s: float) -> list[ReplayMoment | None]:
    """Every vehicle as it had last told of itself."""
    return [_moment(recording, track, t_s) for track in recording.tracks]


def _moment(recording: Recording, track: VehicleTrack, t_s: float) -> ReplayMoment | None:
    at = track.last(t_s)
    if at is None:
        return None
    place, told_s = track.position_ned_m[at], float(track.t_s[at])
    planned = recording.planned(np.array([told_s]))
    error_m = math.nan
    if planned is not None:
        error_m = float(np.linalg.norm(place - planned[0][recording.sysids.index(track.sysid), 0]))
    return ReplayMoment(
        track.sysid,
        mode_name(track.autopilot, int(track.mode[at])),
        bool(track.armed[at]),
        -float(place[2]),
        float(np.linalg.norm(track.velocity_ned_mps[at])),
        error_m,
        int(track.battery_pct[at]),
        t_s - told_s,
    )


def _line(recording: Recording, t_s: float) -> str:
    heard = [m for m in moments(recording, t_s) if m is not None and m.age_s <= SILENCE_S]
    said = f"t = {t_s:.1f} s: {len(heard)} of {len(recording.tracks)} vehicles heard"
    if heard:
        heights = [m.height_m for m in heard]
        said += f", {sum(m.armed for m in heard)} armed, height {min(heights):.1f} to {max(heights):.1f} m"
        said += f", at most {max(m.speed_mps for m in heard):.1f} m/s"
    planned = [m for m in heard if not math.isnan(m.error_m)]
    if planned:
        worst = max(planned, key=lambda m: m.error_m)
        said += f", off the plan by at most {worst.error_m:.2f} m (vehicle {worst.sysid})"
    nearest = _nearest(recording, t_s)
    return said if math.isnan(nearest) else f"{said}, nearest two {nearest:.2f} m"


def _table(recording: Recording, window: tuple[float, float], t_s: float, said: list[Event]) -> Table:
    share = (t_s - window[0]) / (window[1] - window[0])
    nearest = _nearest(recording, t_s)
    apart = "" if math.isnan(nearest) else f"  nearest two {nearest:.2f} m"
    table = Table(
        "vehicle", "mode", "armed", "height", "speed", "off the plan", "battery", "heard",
        title=f"{recording.name}  t = {t_s:.1f} s{apart}",
    )  # fmt: skip
    for track, m in zip(recording.tracks, moments(recording, t_s), strict=True):
        if m is None:
            table.add_row(str(track.sysid), *["–"] * 7)
            continue
        error = "–" if math.isnan(m.error_m) else f"{m.error_m:.2f} m"
        battery = "–" if m.battery_pct < 0 else f"{m.battery_pct} %"
        state = (m.mode, "yes" if m.armed else "no", f"{m.height_m:.1f} m", f"{m.speed_mps:.1f} m/s")
        table.add_row(str(m.sysid), *state, error, battery, f"{m.age_s:.1f} s ago")
    bar = "█" * round(30 * share)
    table.caption = "\n".join([f"{bar:░<30} {share:.0%}", *map(str, said)])
    return table


def _nearest(recording: Recording, t_s: float) -> float:
    return float(nearest_m(recording.at(np.array([t_s]))[0])[0])
