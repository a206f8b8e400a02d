"""Which flights a campaign keeps whole: the worst of every criterion and all that did not hold, whatever the order."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gcs.campaign.campaign_flight import zipped
from gcs.campaign.kept_flights import FLIGHTS, KeptFlights

MARGINS = st.lists(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=30)


def rows_of(margins: list[tuple[int, int]]) -> list[dict[str, Any]]:
    return [
        {"index": n, "outcome": "held", "separation_m": a, "separation_m_margin": a, "height_m_margin": b}
        for n, (a, b) in enumerate(margins)
    ]


@given(MARGINS, st.integers(0, 2**32))
def test_what_is_kept_depends_on_the_rows_alone(margins: list[tuple[int, int]], seed: int) -> None:
    rows = rows_of(margins)
    shuffled = random.Random(seed).sample(rows, len(rows))
    wanted = KeptFlights(Path("none"), rows, 2)._wanted()
    kept, known = KeptFlights(Path("none"), [], 2), set()
    rules = [kept.rule] * 3  # those of flights that began before others ended
    for row in shuffled:
        if rules.pop(0).keeps(row):
            known.add(row["index"])
        kept._note(row)
        rules.append(kept.rule)
    assert wanted <= known
    assert kept._wanted() == wanted


def test_folders_are_whole_and_go_when_worse_flights_come(tmp_path: Path) -> None:
    folder = tmp_path / "one"
    (folder / "inner").mkdir(parents=True)
    (folder / "inner" / "a.txt").write_text("x")
    data = zipped(folder)
    kept = KeptFlights(tmp_path, [], 1)
    for index, margin, outcome in ((0, 3.0, "held"), (1, 2.0, "held"), (2, 5.0, "failed"), (3, 1.0, "infrastructure")):
        kept.add({"index": index, "outcome": outcome, "separation_m_margin": margin}, data)
    assert (kept.path(0) / "inner" / "a.txt").read_text() == "x"  # its row may be on disk, and 1's not yet
    kept.tidy()
    assert sorted(one.name for one in (tmp_path / FLIGHTS).iterdir()) == ["000001", "000002"]
    (tmp_path / FLIGHTS / "000007.part").mkdir()
    KeptFlights(tmp_path, [], 1).tidy()
    assert not any((tmp_path / FLIGHTS).iterdir())
