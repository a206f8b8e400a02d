"""The computer's wall clock may be set at any time: nothing that flies, links or waits reads it."""

from __future__ import annotations

import re
from pathlib import Path

ROOMS = ("gcs/flight", "gcs/link", "gcs/cli/flights", "gcs/util/aio.py", "gcs/util/steady_loop.py")
WALL = re.compile(
    r"\btime\.(?:time|time_ns|localtime|gmtime|ctime|strftime)\b|\bdatetime\.(?:now|today|utcnow)\b|\bdate\.today\b"
    r"|\bst_[mca]time\b|CLOCK_REALTIME|from time import (?:time|.*\btime\b)"
)
# Each is a name or a note for people, or has another proof beside it.
ALLOWED = {
    ("gcs/flight/run.py", "datetime.now"): "the name of a flight's folder; a second one of that name gets a number",
    ("gcs/cli/flights/attach_view.py", "datetime.now"): "the name of a log, to which frames are appended",
    ("gcs/flight/recording/record_gaps.py", "time.time"): "when frames were not written, as people read it",
    ("gcs/flight/recording/flight_state.py", "time.time"): "only where folders cannot be locked",
    ("gcs/flight/recording/flight_state.py", "st_mtime"): "the same; and which unfinished flight is shown first",
    ("gcs/link/wire/signing_keys.py", "time.time"): "where signing time begins; it then runs with the steady clock",
}


def test_no_flight_reads_the_wall_clock(repo_root: Path) -> None:
    found = set()
    for room in ROOMS:
        path = repo_root / room
        for file in [path] if path.is_file() else sorted(path.rglob("*.py")):
            text = file.read_text(encoding="utf-8")
            found |= {(file.relative_to(repo_root).as_posix(), name) for name in WALL.findall(text)}
    assert found == set(ALLOWED)
