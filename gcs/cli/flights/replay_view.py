"""`gcs replay` at work: a live table or lines over time, and the recorded frames sent to another ground station."""

import asyncio
import bisect
import math
from collections import deque
from contextlib import AsyncExitStack, nullcontext
from dataclasses import dataclass

import numpy as np
from rich.live import Live
from rich.table import Table

from gcs.autopilots.traits import mode_name
from gcs.cli.shared.console import Screen
from gcs.flight.monitoring.progress import Event
from gcs.flight.recording.load_recording import LoadedRecording
from gcs.flight.recording.recording import SILENCE_S, Recording, VehicleTrack, nearest_m
from gcs.link.endpoints.endpoint import Endpoint, make_endpoint

_TICK_S, _SENDING_S = 0.1, 0.005
_LINE_EVERY_S = 5.0  # wall-clock time
_LINES = 10  # in all, with --speed max
_EVENTS = 4  # under the table
_BURST = 100  # frames sent before the event loop runs again


@dataclass(frozen=True)
class ReplayMoment:
    """One vehicle at a time of the replay, from its last report."""

    sysid: int
    mode: str
    armed: bool
    height_m: float
    speed_mps: float
    error_m: float  # NaN without a plan
    battery_pct: int
    age_s: float


async def play(
    screen: Screen, loaded: LoadedRecording, window: tuple[float, float], rate: float, to_link: str | None
) -> int:
    """The number of frames sent, after showing a window of time at `rate` times real time. Raises `LinkError`."""
    recording, loop = loaded.recording, asyncio.get_running_loop()
    happened = sorted((*recording.events, *recording.remarks), key=lambda event: event.t_s)
    happened = [event for event in happened if window[0] <= event.t_s <= window[1]]
    step_s = _LINE_EVERY_S * rate if math.isfinite(rate) else (window[1] - window[0]) / _LINES
    lines = deque([*np.arange(window[0], window[1] - 0.1 * step_s, step_s).tolist(), window[1]])
    sent = shown = 0
    async with AsyncExitStack() as stack:
        endpoint = await _opened(to_link, stack)
        frames = _Frames(loaded, window)
        live = Live(console=screen.console, refresh_per_second=10, transient=True) if screen.is_watched else None
        with live or nullcontext():
            began_s = loop.time()
            while True:
                past_s = (loop.time() - began_s) * rate if math.isfinite(rate) else math.inf
                t_s = min(window[0] + past_s, window[1])
                if endpoint is not None:
                    sent += await frames.send(endpoint, t_s)
                while lines and lines[0] <= t_s and live is None:
                    shown = _say_events(screen, happened, shown, lines[0])
                    screen.say(_line(recording, lines.popleft()))
                if live is not None:
                    shown = bisect.bisect_right(happened, t_s, key=lambda event: event.t_s)
                    live.update(_table(recording, window, t_s, happened[:shown][-_EVENTS:]))
                else:
                    shown = _say_events(screen, happened, shown, t_s)
                if t_s >= window[1]:
                    break
                due_s = math.inf if endpoint is None else (frames.next_s - t_s) / rate
                await asyncio.sleep(min(max(due_s, _SENDING_S), _TICK_S))
        if live is not None:
            _say_events(screen, happened, 0, window[1])
            screen.say(_line(recording, window[1]))
        if endpoint is not None:
            lost = getattr(endpoint, "lost", 0)
            screen.say(f"{sent} frames sent to {to_link}" + (f", {lost} were not accepted" if lost else ""))
    return sent


async def _opened(to_link: str | None, stack: AsyncExitStack) -> Endpoint | None:
    if to_link is None:
        return None
    endpoint = make_endpoint(to_link)
    await endpoint.open(lambda data, address: None)  # received frames are ignored: no vehicle flies
    stack.callback(endpoint.close)
    return endpoint


class _Frames:
    def __init__(self, loaded: LoadedRecording, window: tuple[float, float]) -> None:
        self._t_s, self._frames = loaded.t_s, loaded.frames
        self._next = int(np.searchsorted(self._t_s, window[0]))

    @property
    def next_s(self) -> float:
        """When the next frame is due; infinite after the last."""
        return float(self._t_s[self._next]) if self._next < len(self._t_s) else math.inf

    async def send(self, endpoint: Endpoint, t_s: float) -> int:
        """The number of frames sent: all that were due at `t_s`, in order."""
        end = int(np.searchsorted(self._t_s, t_s, side="right"))
        count = max(end - self._next, 0)
        for n in range(self._next, end):
            endpoint.send(self._frames[n])
            if n % _BURST == _BURST - 1:
                await asyncio.sleep(0)
        self._next = max(end, self._next)
        return count


def _say_events(screen: Screen, happened: list[Event], shown: int, t_s: float) -> int:
    while shown < len(happened) and happened[shown].t_s <= t_s:
        screen.say(str(happened[shown]))
        shown += 1
    return shown


def moments(recording: Recording, t_s: float) -> list[ReplayMoment | None]:
    """Every vehicle from its last report; None where there is none yet."""
    return [_moment(recording, track, t_s) for track in recording.tracks]


def _moment(recording: Recording, track: VehicleTrack, t_s: float) -> ReplayMoment | None:
    at = track.last(t_s)
    if at is None:
        return None
    place, report_s = track.position_ned_m[at], float(track.t_s[at])
    planned = recording.planned(np.array([report_s]))
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
        t_s - report_s,
    )


def _line(recording: Recording, t_s: float) -> str:
    heard = [m for m in moments(recording, t_s) if m is not None and m.age_s <= SILENCE_S]
    text = f"t = {t_s:.1f} s: {len(heard)} of {len(recording.tracks)} vehicles heard"
    if heard:
        heights = [m.height_m for m in heard]
        text += f", {sum(m.armed for m in heard)} armed, height {min(heights):.1f} to {max(heights):.1f} m"
        text += f", at most {max(m.speed_mps for m in heard):.1f} m/s"
    planned = [m for m in heard if not math.isnan(m.error_m)]
    if planned:
        worst = max(planned, key=lambda m: m.error_m)
        text += f", position error at most {worst.error_m:.2f} m (vehicle {worst.sysid})"
    nearest = _nearest(recording, t_s)
    return text if math.isnan(nearest) else f"{text}, separation {nearest:.2f} m"


def _table(recording: Recording, window: tuple[float, float], t_s: float, events: list[Event]) -> Table:
    share = (t_s - window[0]) / (window[1] - window[0])
    nearest = _nearest(recording, t_s)
    apart = "" if math.isnan(nearest) else f"  separation {nearest:.2f} m"
    table = Table(
        "vehicle", "mode", "armed", "height", "speed", "position error", "battery", "last report",
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
    table.caption = "\n".join([f"{bar:░<30} {share:.0%}", *map(str, events)])
    return table


def _nearest(recording: Recording, t_s: float) -> float:
    return float(nearest_m(recording.at(np.array([t_s]))[0])[0])
