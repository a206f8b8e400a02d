"""Reports of long work: none of short work, then more and more seldom, and only to who listens."""

from itertools import pairwise

from gcs.util.long_work import report, shown


def test_long_work_is_shown_within_two_seconds_and_then_more_and_more_seldom() -> None:
    now, lines = [0.0], list[tuple[float, str]]()
    with shown(lambda what: lines.append((now[0], what)), now_s=lambda: now[0]):
        while now[0] < 120.0:
            report(lambda: f"at {now[0]:.1f}")
            now[0] += 0.1
    times = [t_s for t_s, _ in lines]
    pauses = [later - sooner for sooner, later in pairwise([0.0, *times])]
    assert 1.4 < pauses[0] < 2.0
    assert all(a <= b + 0.11 for a, b in pairwise(pauses))
    assert max(pauses) < 15.2
    assert lines[0][1] == f"at {times[0]:.1f}"
    report("nobody is shown this")
    assert len(lines) == len(times)


def test_short_work_is_silent_and_a_text_is_made_only_if_it_is_shown() -> None:
    with shown(lambda _: None, now_s=lambda: 0.0):
        report(lambda: 1 / 0)  # type: ignore[arg-type, return-value]


def test_a_fixed_pause_is_kept() -> None:
    now, lines = [0.0], list[float]()
    with shown(lambda _: lines.append(now[0]), 0.5, now_s=lambda: now[0]):
        while now[0] < 3.0:
            report("spinning")
            now[0] += 0.25
    assert lines == [0.5, 1.0, 1.5, 2.0, 2.5]


def test_the_same_words_are_not_repeated_at_once() -> None:
    now, lines = [0.0], list[float]()
    with shown(lambda _: lines.append(now[0]), now_s=lambda: now[0]):
        while now[0] < 60.0:
            report("proving")
            now[0] += 0.25
    assert lines[0] < 2.0
    assert all(15.0 <= later - sooner < 31.0 for sooner, later in pairwise(lines))
