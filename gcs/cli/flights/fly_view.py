"""`gcs fly` at work: its pre-flight table, the answer of the operator, progress, and the table of the verdict."""

import asyncio
import math
import sys
from contextlib import nullcontext
from pathlib import Path

from rich.live import Live
from rich.markup import escape
from rich.table import Table

from gcs.cli.flights.flight_table import FlightTable
from gcs.cli.flights.live_page import LivePage, live_page
from gcs.cli.flights.report import verdict_table
from gcs.cli.shared.console import Screen
from gcs.cli.shared.page_option import PageChoices
from gcs.cli.shared.plan_argument import Stopwatch
from gcs.errors import GcsError, JudgementError, UsageError, counted
from gcs.flight.assessment.criterion import FlightOutcome
from gcs.flight.assessment.judge import Verdict
from gcs.flight.monitoring.lateness import skew_s
from gcs.flight.monitoring.preflight_check import PreflightCheck, complete
from gcs.flight.monitoring.progress import Event, InFlight, Snapshot, Watcher
from gcs.flight.recording.flight_folder import REPORTS, TELEMETRY, limit_text, planned_text
from gcs.flight.run import FlightRun, Flown, fly_run
from gcs.util.aio import ended

CONFIRMATION = "arm"
_REFRESH_S = 0.25
_LINE_EVERY_S = 5.0


class FlightView(Watcher):
    """The output of a flight: lines, or a live table on a terminal."""

    def __init__(self, screen: Screen, watch: Stopwatch, question: str, page: LivePage | None = None) -> None:
        self._screen = screen
        self._page = page
        self._watch = watch
        self._question = question  # empty: arm without confirmation
        self._live: Live | None = None

    @property
    def laps_s(self) -> dict[str, float]:
        """The time of each part, for the report."""
        return self._watch.laps_s

    def say(self, text: str) -> None:
        """Print one line."""
        self._screen.say(text)

    def warn(self, text: str) -> None:
        """Print one warning, also with `--json`."""
        self._screen.warn(text)

    def lap(self, name: str) -> None:
        """Count the time since the last lap as `name`."""
        self._watch.lap(name)

    def checks(self, checks: tuple[PreflightCheck, ...]) -> None:
        """Show the pre-flight table (GO or NO-GO)."""
        show_checks(self._screen, checks)
        if self._page is not None:
            self._page.checks(checks, checks_title(checks))

    async def confirm(self) -> str:
        """Wait until you type the confirmation here or on the page, and return where: the first counts.

        Raises `UsageError` for anything else that is typed here, and where nobody can type it.
        """
        if not self._question:
            return "--yes-arm"
        if self._live is not None:
            self._live.stop()
        self._screen.ask(self._question)
        ways = [asyncio.ensure_future(self._typed_here())]
        if self._page is not None:
            ways.append(asyncio.ensure_future(self._page.typed(CONFIRMATION, self._question)))
        try:
            while ways:
                done, _ = await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
                if by := next((one.result() for one in done if one.result()), ""):
                    break
                ways = [one for one in ways if one not in done]
            else:
                hint = "type it at the prompt, or give --yes-arm"
                raise UsageError(f"not armed: '{CONFIRMATION}' was not typed", hint=hint)
        finally:
            await ended(*ways)
        if self._live is not None:
            self._live.start()
        return by

    async def _typed_here(self) -> str:
        """Where the word was typed; empty without an input, when the page alone is left."""
        line = await typed_line()
        if line is not None and line != CONFIRMATION:
            raise UsageError(
                f"not armed: '{CONFIRMATION}' was not typed", hint="type it at the prompt, or give --yes-arm"
            )
        if line is None and self._page is not None:
            self._screen.say("no input here: the word can be typed on the page")
        return "" if line is None else "the terminal"

    def event(self, event: Event) -> None:
        """Add an event to the log of the page."""
        if self._page is not None:
            self._page.event(event)

    async def follow(self, flight: InFlight) -> None:
        """Show the flight until cancelled: a live table on a terminal, else a line every few seconds; and on a page."""
        if self._page is None:
            await self._show(flight)
            return
        beside = asyncio.ensure_future(self._page.run(flight))
        try:
            await self._show(flight)
        finally:
            await ended(beside)

    async def _show(self, flight: InFlight) -> None:
        if not self._screen.is_watched:
            await _say_progress(self._screen, flight)
        console, table = self._screen.console, FlightTable()
        with Live(console=console, refresh_per_second=4, transient=True) as self._live:
            while True:
                self._live.update(table.draw(flight, console.width, console.height))
                await asyncio.sleep(_REFRESH_S)


def fly_and_judge(
    run: FlightRun,
    screen: Screen,
    watch: Stopwatch,
    *,
    asks: bool,
    page: PageChoices | None = None,
) -> int:
    """The exit status of the flight; raises JudgementError when it did not meet a criterion.

    Vehicles on a link are armed after their pre-flight table and, with `asks`, after you typed the confirmation. With
    `page` the flight is shown on a page as well; at its `address` also to other machines, which may order with
    `control`. After the flight the page stays while a browser shows it, if standard input is a terminal; with `keep`
    until Ctrl-C in any case.
    """
    question, keep = "", page is not None and page.keep
    if asks and run.link is not None:
        count = len(run.plan.sysids)
        question = f"This arms and flies {counted(count, 'vehicle')} at {run.link}. Type '{CONFIRMATION}' to continue:"
    with (
        live_page(run.plan, screen.say, page.address, orders_from_afar=page.control, tiles=page.tiles)
        if page is not None
        else nullcontext() as shown,
    ):
        try:
            with screen.without_waiting():
                flown = fly_run(run, FlightView(screen, watch, question, shown))
        except GcsError as failure:
            if shown is not None:
                folder = None if failure.folder is None else Path(failure.folder)
                shown.report("flight FAILED", f"{failure.message} {failure.hint}".strip(), None, folder)
                _keep_page(screen, shown, failure, folder, keep=keep)
            raise
        _show(screen, flown)
        if shown is not None:
            shown.report(_ended_words(flown.verdict), _failed_words(flown.verdict), flown.verdict, flown.folder)
            _keep_page(screen, shown, None, flown.folder, keep=keep)
    if page:
        screen.say(f"the page has ended; gcs replay {flown.folder} --page shows the flight again")
    screen.say(f"time: {watch}")
    screen.result(flown.data)
    return screen.ended(_failure(flown))


def _keep_page(screen: Screen, page: LivePage, failure: GcsError | None, folder: Path | None, *, keep: bool) -> None:
    if not page.stays(keep=keep):
        return
    if failure is not None:  # it is printed once more, with its hint, at the very end
        screen.warn(failure.message)
    if folder is not None:
        page.replay(folder)
    until = "Ctrl-C" if keep else "its browser is closed, or Ctrl-C"
    screen.say(f"the page stays, with the report, until {until}")
    page.stay(keep=keep)


def _ended_words(verdict: Verdict | None) -> str:
    if verdict is None:
        return "flight not known: its telemetry is missing"
    return f"flight {'FAILED' if verdict.outcome is FlightOutcome.FAILED else verdict.outcome}"


def _failed_words(verdict: Verdict | None) -> str:
    return "; ".join(
        f"{c.name} {c.value:.3f} {c.unit}, limit {limit_text(c)}"
        for c in (() if verdict is None else verdict.criteria)
        if c.outcome is FlightOutcome.FAILED
    )


def _failure(flown: Flown) -> JudgementError | None:
    said = _failed_words(flown.verdict)
    if not said:
        return None
    hint = f"read {flown.folder / 'report.md'} and its pictures"
    return JudgementError(f"the flight failed its criteria: {said}", hint=hint)


async def _say_progress(screen: Screen, flight: InFlight) -> None:
    last_line, due_s = "", 0.0
    while True:
        snapshot = flight.snapshot()
        now_s = asyncio.get_running_loop().time()
        if snapshot.phase != last_line or now_s >= due_s:
            waiting = _waiting(snapshot) if snapshot.phase == last_line else ""
            last_line, due_s = snapshot.phase, now_s + _LINE_EVERY_S
            screen.say(_line(snapshot) + waiting)
        await asyncio.sleep(_REFRESH_S)


def _waiting(snapshot: Snapshot) -> str:
    """Missing readiness conditions: ": vehicles 1, 3: no position estimate"; empty if all are ready."""
    by_lack: dict[str, list[str]] = {}
    for sysid, lack in sorted(snapshot.lacks.items()):
        by_lack.setdefault(lack, []).append(str(sysid))
    words = [f"vehicle{'s' * (len(ids) > 1)} {', '.join(ids)}: {lack}" for lack, ids in by_lack.items() if lack]
    return f": {'; '.join(words)}" if words else ""


def _line(snapshot: Snapshot) -> str:
    if snapshot.plan_time_s is None:
        apart = "" if math.isnan(snapshot.separation_m) else f": separation {snapshot.separation_m:.2f} m"
        return f"{snapshot.phase}{apart}"
    worst = max((e for e in snapshot.errors_m.values() if not math.isnan(e)), default=math.nan)
    figures = (
        ("position error at most", worst),
        ("formation error", snapshot.formation_error_m),
        ("separation", snapshot.separation_m),
    )
    known = (f"{name} {metres:.2f} m" for name, metres in figures if not math.isnan(metres))
    return ", ".join((f"{snapshot.phase}: t = {snapshot.plan_time_s:.0f} s ({snapshot.progress:.0%})", *known))


def _skew_text(late_s: dict[int, float]) -> str | None:
    """The time skew as text: "4.1 ms (vehicles 2 and 3)"; None for fewer than two vehicles in flight."""
    known = {sysid: late for sysid, late in late_s.items() if math.isfinite(late)}
    if len(known) < 2:
        return None
    first, last = sorted((min(known, key=known.__getitem__), max(known, key=known.__getitem__)))
    return f"{1e3 * skew_s(known.values()):.1f} ms (vehicles {first} and {last})"


def _show(screen: Screen, flown: Flown) -> None:
    verdict, judged, telemetry = flown.verdict, flown.data["judged"], flown.folder / TELEMETRY
    if judged == REPORTS:
        screen.say(f"landed. Telemetry: {telemetry}" if telemetry.is_file() else "landed.")
    if verdict is None:
        screen.say("flight not known: its telemetry is missing.")
        return
    table = verdict_table(verdict, judged)
    if (skew := _skew_text(flown.late_s)) is not None:
        table.add_row("time skew (telemetry)", skew, "–", "–")
    screen.show(table)
    planned = [f"{c.name} {planned_text(c)}" for c in verdict.criteria if planned_text(c)]
    screen.say(f"limits of the plan, by the scenario: {', '.join(planned)}")
    screen.say(f"formation error: at most {verdict.formation_error_m:.3f} m (Definition 1, from the {judged})")
    if flown.nearest:
        screen.say(f"least separation, from telemetry: {', '.join(map(str, flown.nearest))}")
    where = f" Report and pictures: {flown.folder}" if (flown.folder / "report.md").is_file() else ""
    screen.say(f"{_ended_words(verdict)}.{where}")


async def typed_line() -> str | None:
    """The next line of standard input without its line end; None at its end. It may be cancelled at any time."""
    if sys.stdin is None or sys.stdin.closed:
        return None
    loop = asyncio.get_running_loop()
    arrived = asyncio.Event()
    try:
        loop.add_reader(sys.stdin, arrived.set)
    except PermissionError:  # a file: its next line is there at once
        return _stripped(sys.stdin.readline())
    try:
        await arrived.wait()
    finally:
        loop.remove_reader(sys.stdin)
    try:
        return _stripped(sys.stdin.readline())
    except (OSError, ValueError):  # the terminal was closed
        return None


def _stripped(line: str) -> str | None:
    return line.strip() if line else None


def show_checks(screen: Screen, checks: tuple[PreflightCheck, ...]) -> None:
    """Show a table: one row per check, one column per vehicle, failed checks marked, and the requirement."""
    table = checks_table(checks)
    if (sum((column.min_width or 0) + 3 for column in table.columns) + 1) > screen.console.width:
        table = narrow_checks_table(checks)
    screen.show(table)
    vehicles_of: dict[str, list[str]] = {}
    for check in checks:
        if check.warning:
            vehicles_of.setdefault(check.warning, []).append(str(check.sysid))
    for text, sysids in vehicles_of.items():
        screen.warn(f"vehicle{'s' * (len(sysids) > 1)} {', '.join(sysids)}: {text}")


def checks_table(checks: tuple[PreflightCheck, ...]) -> Table:
    """Return the table of checks. A check that a vehicle lacks is not reported, and failed."""
    rows = _by_name(checks)
    columns = {"check": list(rows)}
    for row in rows.values():
        for c in row:
            columns.setdefault(str(c.sysid), []).append(_cell(c))
    columns["required"] = [row[0].required for row in rows.values()]
    table = Table(title=_title(rows))
    for heading, cells in columns.items():
        widest = max(map(len, " ".join([heading, *cells]).split()), default=1)
        table.add_column(heading, overflow="fold", min_width=widest)
    for texts in zip(*columns.values(), strict=True):
        table.add_row(*(escape(text) for text in texts))
    return table


def narrow_checks_table(checks: tuple[PreflightCheck, ...]) -> Table:
    """Return the table for terminals that have no room for one column per vehicle: vehicles stand in the cells."""
    rows = _by_name(checks)
    table = Table(title=_title(rows))
    for heading in ("check", "vehicles: measured", "required"):
        table.add_column(heading, overflow="fold")
    for name, row in rows.items():
        vehicles_of: dict[str, list[str]] = {}
        for c in row:
            vehicles_of.setdefault(_cell(c), []).append(str(c.sysid))
        remarkable = {_cell(c) for c in row if not c.ok or c.warning}
        lines = [f"{', '.join(ids) if len(ids) < len(row) else 'all'}: {cell}" for cell, ids in vehicles_of.items()]
        apart = [line for line, cell in zip(lines, vehicles_of, strict=True) if cell in remarkable]
        good = "; ".join(line for line in lines if line not in apart)
        table.add_row(name, escape("\n".join((*apart, *([good] if good else [])))), escape(row[0].required))
    return table


def _by_name(checks: tuple[PreflightCheck, ...]) -> dict[str, list[PreflightCheck]]:
    rows: dict[str, list[PreflightCheck]] = {}
    for check in complete(checks):
        rows.setdefault(check.name, []).append(check)
    return rows


def checks_title(checks: tuple[PreflightCheck, ...]) -> str:
    """Return GO or NO-GO, with what was waived."""
    return _title(_by_name(checks))


def _title(rows: dict[str, list[PreflightCheck]]) -> str:
    waived = [name for name, row in rows.items() if any(c.waived for c in row)]
    go = all(c.go for row in rows.values() for c in row)
    return ("GO" if go else "NO-GO") + (f", waived: {', '.join(waived)}" if waived else "")


def _cell(check: PreflightCheck) -> str:
    mark = "WAIVED: " if check.waived else "FAILED: " if not check.ok else "WARNING: " if check.warning else ""
    return mark + check.measured
