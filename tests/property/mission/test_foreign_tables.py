"""Tables that are written as people write them: blanks, comments, blank lines and wrong numbers change no mission."""

from __future__ import annotations

import math

from hypothesis import given, settings
from hypothesis import strategies as st

from gcs.mission.formats.qgc_wpl import WaypointFile, read_waypoints, write_waypoints
from gcs.mission.formats.vendor_quirks import QuirkKind
from gcs.mission.model import Home, MissionItem

numbers = st.floats(-1e6, 1e6)
items = st.builds(
    MissionItem,
    command=st.sampled_from([16, 19, 20, 21, 22, 93, 178, 601]),
    frame=st.sampled_from([0, 3, 10]),
    params=st.tuples(*[numbers | st.just(math.nan)] * 4),
    lat_degE7=st.integers(-900_000_000, 900_000_000),
    lon_degE7=st.integers(-1_800_000_000, 1_800_000_000),
    alt_m=numbers,
    autocontinue=st.booleans(),
)
homes = st.builds(Home, lat_deg=st.floats(-90, 90), lon_deg=st.floats(-180, 180), alt_amsl_m=numbers)
separators = st.sampled_from(["\t", " ", "  ", "\t ", " \t"])
between = st.lists(st.sampled_from(["", "   ", "# up", "  // and down"]), max_size=2)
behind = st.sampled_from(["", " ", "\t", "# here", "\t// there"])


@settings(deadline=None)
@given(st.data(), st.none() | homes, st.lists(items, min_size=1, max_size=5), st.sampled_from(["\n", "\r\n"]))
def test_a_scrambled_table_is_the_same_mission(
    data: st.DataObject, home: Home | None, mission: list[MissionItem], newline: str
) -> None:
    written = WaypointFile(home, tuple(mission))
    header, *rows = write_waypoints(written).splitlines()
    lines, wrong = [*data.draw(between), header], 0
    for place, row in enumerate(rows):
        lines += data.draw(between)
        seq, *cells = row.split("\t")
        number = data.draw(st.just(int(seq)) | st.integers(-3, 70_000))
        wrong += number != place
        lines.append(data.draw(separators).join([str(number), *cells]) + data.draw(behind))
    text = data.draw(st.sampled_from(["", "\ufeff"])) + newline.join(lines) + newline
    read = read_waypoints(text.encode(), "x", home_first=home is not None)
    assert repr((read.home, read.items)) == repr((written.home, written.items))  # NaN differs from itself
    assert [lines[n - 1].split()[2:4] for n in read.lines] == [[str(i.frame), str(i.command)] for i in mission]
    assert sum(o.count for o in read.quirks if o.kind is QuirkKind.SEQ) == wrong
    assert read.quirks or lines == [header, *rows]
