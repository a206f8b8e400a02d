"""One flight from the command line: what a person sees of it.

Knows: how a flight and its verdict are shown. Does not know: how it is flown, judged, or what it leaves.
"""

from __future__ import annotations

import asyncio
import math

from rich.live import Live
from rich.table import Table

from gcs.cli.console import Screen
from gcs.cli.plan_argument import Stopwatch
from gcs.cli.prompts import show_checks, typed_line
from gcs.errors import JudgementError, UsageError
from gcs.flight.lateness import skew_s
from gcs.flight.progress import InFlight, Snapshot, Watcher
from gcs.flight.recording.flight_folder import asked
from gcs.flight.run import FlightRun, Flown, fly_run
from gcs.flight.setup.preflight import PreflightCheck

CONFIRMATION = "arm"
_REFRESH_S = 0.25
_LINE_EVERY_S = 5.0


class FlightView(Watcher):
    """A person at a terminal, or what reads its lines."""

    def __init__(self, screen: Screen, watch: Stopwatch, question: str) -> None:
        self._screen = screen
        self._watch = watch
        self._question = question  # none where it was answered before
        self._live: Live | None = None

    @property
    def laps_s(self) -> dict[str, float]:
        """Where the time went."""
        return self._watch.laps_s

    def say(self, text: str) -> None:
        """One line."""
        self._screen.say(text)

    def lap(self, name: str) -> None:
        """The stopwatch goes on."""
        self._watch.lap(name)

    def checks(self, checks: tuple[PreflightCheck, ...]) -> None:
        """The go/no-go table."""
        show_checks(self._screen, checks)

    async def confirm(self) -> None:
        """Whoever flies real vehicles types a word, having seen the table."""
        if not self._question:
            return
        if self._live is not None:
            self._live.stop()
        self._screen.say(self._question)
        if await typed_line() != CONFIRMATION:
            raise UsageError("not armed: the word was not typed", hint="type it when asked, or give --yes-arm")
        if self._live is not None:
            self._live.start()

    async def follow(self, flight: InFlight) -> None:
        """A table that redraws where somebody watches, else a line now and then."""
        if not self._screen.is_watched:
            await _tell(self._screen, flight)
        with Live(console=self._screen.console, refresh_per_second=4, transient=True) as self._live:
            while True:
                self._live.update(_table(flight.snapshot()))
                await asyncio.sleep(_REFRESH_S)


def fly_and_judge(sortie: FlightRun, screen: Screen, watch: Stopwatch, *, asks: bool) -> int:
    """Fly and show it; raises JudgementError when the flight does not hold.

    Vehicles on a link are armed once their table was shown and, with `asks`, a word was typed.
    """
    question = ""
    if asks and sortie.link is not None:
        many = len(sortie.plan.sysids)
        question = f"This arms and flies {many} vehicles at {sortie.link}. Type '{CONFIRMATION}' to go on:"
    flown = fly_run(sortie, FlightView(screen, watch, question))
    verdict = flown.verdict
    if verdict is None:
        screen.say(f"landed. Telemetry: {flown.folder / 'telemetry.tlog'}")
        if (said := _together(flown.late_s)) is not None:
            screen.say(f"apart in time by their own clocks: {said}")
        screen.result(flown.data)
        return 0
    _show(screen, flown)
    screen.say(f"time: {watch}")
    screen.result(flown.data)
    if verdict.ok:
        return 0
    broken = "; ".join(f"{c.name} {c.value:.3f} {c.unit}, {asked(c)}" for c in verdict.criteria if not c.ok)
    failure = JudgementError(
        f"the flight did not hold: {broken}", hint=f"see {flown.folder / 'report.md'} and its pictures"
    )
    if screen.json:
        return failure.exit_code
    raise failure


async def _tell(screen: Screen, flight: InFlight) -> None:
    last_line, due_s = "", 0.0
    while True:
        snapshot = flight.snapshot()
        now_s = asyncio.get_running_loop().time()
        if snapshot.phase != last_line or now_s >= due_s:
            last_line, due_s = snapshot.phase, now_s + _LINE_EVERY_S
            screen.say(_line(snapshot))
        await asyncio.sleep(_REFRESH_S)


def _line(snapshot: Snapshot) -> str:
    if snapshot.plan_time_s is None:
        return snapshot.phase
    worst = max((e for e in snapshot.errors_m.values() if not math.isnan(e)), default=math.nan)
    figures = (
        ("position error at most", worst),
        ("shape off by", snapshot.formation_error_m),
        ("separation", snapshot.separation_m),
    )
    known = (f"{name} {metres:.2f} m" for name, metres in figures if not math.isnan(metres))
    return ", ".join((f"{snapshot.phase}: t = {snapshot.plan_time_s:.0f} s ({snapshot.progress:.0%})", *known))


def _table(snapshot: Snapshot) -> Table:
    bar = "█" * round(30 * snapshot.progress)
    time_text = "" if snapshot.plan_time_s is None else f"  t = {snapshot.plan_time_s:.0f} s"
    separation = "" if math.isnan(snapshot.separation_m) else f"  separation {snapshot.separation_m:.2f} m"
    off = "" if math.isnan(snapshot.formation_error_m) else f"  shape off by {snapshot.formation_error_m:.2f} m"
    table = Table("vehicle", "armed", "position error", "link", title=f"{snapshot.phase}{time_text}{separation}{off}")
    table.caption = f"{bar:░<30} {snapshot.progress:.0%}"
    for sysid, error in snapshot.errors_m.items():
        error_text = "–" if math.isnan(error) else f"{error:.3f} m"
        age = snapshot.link_age_s[sysid]
        table.add_row(str(sysid), "yes" if snapshot.armed[sysid] else "no", error_text, f"{age:.1f} s ago")
    return table


def _together(late_s: dict[int, float]) -> str | None:
    """The skew for people: "4.1 ms (vehicles 2 and 3)"; None for a lone vehicle, or where nobody flew."""
    known = {sysid: late for sysid, late in late_s.items() if math.isfinite(late)}
    if len(known) < 2:
        return None
    first, last = sorted((min(known, key=known.__getitem__), max(known, key=known.__getitem__)))
    return f"{1e3 * skew_s(known.values()):.1f} ms (vehicles {first} and {last})"


def _show(screen: Screen, flown: Flown) -> None:
    verdict = flown.verdict
    assert verdict is not None
    table = Table("criterion", "flown", "asked", "holds", title="judged from the true states")
    for c in verdict.criteria:
        who = "" if c.sysid is None else f" (vehicle {c.sysid})"
        table.add_row(c.name, f"{c.value:.3f} {c.unit}{who}", asked(c), "yes" if c.ok else "NO")
    if (said := _together(flown.late_s)) is not None:
        table.add_row("apart in time, as told", said, "–", "–")
    screen.show(table)
    screen.say(f"formation's shape off by at most {verdict.formation_error_m:.3f} m (Definition 1)")
    screen.say(f"flight {'held' if verdict.ok else 'NOT held'}. Report and pictures: {flown.folder}")
