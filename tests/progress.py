"""One line for each area of the tests when it is done, in place of one dot for each test.

An area is a folder (`unit/plan`) or, among tests on real sockets, a file. A failed test is said at once, in words.
"""

from __future__ import annotations

from collections import Counter
from pathlib import PurePosixPath

import pytest

BY_FILE = ("bridge", "clients", "hostile")


def area_of(nodeid: str) -> str:
    """The area of a test: two folders below `tests`, or the file."""
    parts = PurePosixPath(nodeid.split("::", maxsplit=1)[0]).parts[1:]
    return "/".join(parts[:2] if len(parts) > 2 or parts[0] in BY_FILE else parts[:1])


def in_words(report: pytest.TestReport) -> str:
    """The file, the promise that is not kept (a test's name is one), and the first line of the reason."""
    file, _, name = report.nodeid.partition("::")
    promise = name.replace("test_", "", 1).replace("::", ": ").replace("_", " ")
    crash = getattr(report.longrepr, "reprcrash", None)
    reason = str(crash.message if crash else report.longrepr).strip().splitlines() or [""]
    when = "" if report.when == "call" else f" ({report.when})"
    return f"{file}: {promise}{when}: {reason[0]}"


class AreaProgress:
    """Counts the reports of every area and prints its line with the last one."""

    def __init__(self, reporter: pytest.TerminalReporter) -> None:
        self._reporter = reporter
        self._left: Counter[str] = Counter()
        self._total = 0
        self._outcomes: dict[str, Counter[str]] = {}
        self._seconds: Counter[str] = Counter()

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        """Without worker processes the session knows its tests."""
        if session.items:
            self._expect([item.nodeid for item in session.items])

    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        """With them every worker tells the same list."""
        if not self._total:
            self._expect(ids)

    def pytest_report_teststatus(self, report: pytest.TestReport) -> tuple[str, str, str] | None:
        """No letter for what passed or was skipped."""
        if report.skipped or (report.passed and report.when == "call"):
            return report.outcome, "", ""
        return None

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Adds one report; `teardown` is the last of a test."""
        area = area_of(report.nodeid)
        seen = self._outcomes.setdefault(area, Counter())
        self._seconds[area] += report.duration
        if report.failed:
            seen["failed"] += 1
            self._reporter.write_line(f"FAILED {in_words(report)}", red=True)
        elif report.skipped or (report.when == "call" and report.passed):
            seen[report.outcome] += 1
        if report.when == "teardown":
            self._left[area] -= 1
            if self._left[area] == 0:
                self._say(area)

    def _expect(self, ids: list[str]) -> None:
        self._left = Counter(area_of(nodeid) for nodeid in ids)
        self._total = len(ids)

    def _say(self, area: str) -> None:
        done = self._total - sum(self._left.values())
        counts = ", ".join(f"{count} {outcome}" for outcome, count in sorted(self._outcomes[area].items()))
        self._reporter.write_line(f"[{100 * done // self._total:3d}%] {area}: {counts} in {self._seconds[area]:.0f} s")
