"""The words of a check and of a report, at their limits."""

from __future__ import annotations

import math

import pytest

from gcs.errors import VerificationError
from gcs.plan.trajectory.constraint_id import STATES, ConstraintId, Kind
from gcs.plan.verification.proof.verdict import Check, Report, refusal
from gcs.plan.verification.verify import _merged


def check(worst: float, proved: float | None, kind: Kind = Kind.PLACE, t_s: float | None = 12.345) -> Check:
    return Check(ConstraintId(kind), "mission", "m", worst, 0.001, 3, t_s, proved)


@pytest.mark.parametrize(
    ("worst", "proved", "verdict", "ok"),
    [
        (0.5, 0.4, "proved", True),
        (0.5, -0.0009, "proved", True),  # within the tolerance
        (0.5, -0.001, "proved", True),
        (0.5, -0.0011, "undecided", False),
        (-0.0009, -0.0009, "proved", True),
        (-0.001, -0.001, "proved", True),
        (-0.0011, -0.0011, "violated", False),
        (-0.0011, None, "violated", False),
        (-0.001, None, "sampled", True),
        (0.5, None, "sampled", True),
        (math.nan, 0.4, "violated", False),  # what is no number is not met
        (0.5, math.nan, "undecided", False),
        (math.nan, None, "violated", False),
    ],
)
def test_what_a_margin_and_its_bound_mean(worst: float, proved: float | None, verdict: str, ok: bool) -> None:
    assert (check(worst, proved).verdict, check(worst, proved).ok) == (verdict, ok)


def test_a_check_says_its_margin_where_and_when() -> None:
    assert str(check(0.5214, 0.5)) == "place in formation, mission: margin 0.521 m at t = 12.35 s (vehicle 3)"
    assert str(check(0.0, 0.0)).startswith("place in formation, mission: margin 0 m")
    assert str(check(-0.25, -0.25)) == "place in formation, mission: violated by 0.25 m at t = 12.35 s (vehicle 3)"
    assert str(check(0.02, -0.03, t_s=None)) == (
        "place in formation, mission: undecided, margin between -0.03 and 0.02 m (vehicle 3)"
    )
    assert str(Check(ConstraintId(Kind.SEPARATION), "landing", "m", 1.0, 0.001, None, 3.0, 1.0)) == (
        "separation, landing: margin 1 m at t = 3.00 s"
    )


def report(*checks: Check) -> Report:
    return Report(checks, 0.5, None, 0.0, 0.0)


def test_a_report_is_right_if_all_its_checks_are() -> None:
    good, sampled, undecided, bad = check(1.0, 1.0), check(1.0, None, Kind.DRIFT), check(1.0, -1.0), check(-1.0, -1.0)
    assert report(good, sampled).ok
    assert report(good, sampled, sampled).sampled == ("Eq. 1 re-integrated over 5 s",)
    assert not report(good, undecided).ok
    assert report(good, bad, sampled, undecided).failures == (bad, undecided)


def test_a_refusal_names_the_first_failures_and_counts_the_others() -> None:
    many = [check(-1.0 - n, -1.0 - n, kind) for n, kind in enumerate(STATES[:7])]
    for count, listed, more in ((1, 1, ""), (5, 5, ""), (6, 5, "; and 1 more"), (7, 5, "; and 2 more")):
        error = refusal(report(check(1.0, 1.0), *many[:count]))
        assert isinstance(error, VerificationError)
        words = "; ".join(
            f"{kind.value}, mission: violated by {n} m at t = 12.35 s (vehicle 3)"
            for n, kind in enumerate(STATES[:listed], start=1)
        )
        assert error.message == f"the plan failed verification: {words}{more}"
        assert error.reason == f"{words}{more}"
        assert "--unverified" in str(error.hint)


@pytest.mark.parametrize("order", [1, -1])
def test_of_two_checks_of_one_limit_the_worse_counts_and_the_lower_bound_of_both(order: int) -> None:
    """The leader stands for all while they fly alike; else the followers have checks of their own."""
    roll = ConstraintId(Kind.ROLL)
    leader = Check(roll, "mission", "rad", 0.2, 0.001, 1, 3.0, 0.1)
    follower = Check(roll, "mission", "rad", 0.3, 0.001, 2, 4.0, -0.05)
    other = Check(roll, "landing", "rad", 0.9, 0.001, 1, 50.0, 0.9)
    merged = _merged([leader, follower, other][::order])
    found = {one.phase: one for one in merged}
    assert len(merged) == 2
    assert found["mission"] == Check(roll, "mission", "rad", 0.2, 0.001, 1, 3.0, -0.05)
    assert found["mission"].verdict == "undecided"
    assert found["landing"] == other


def test_a_report_says_its_worst_failure_or_what_was_not_proved() -> None:
    good, sampled = check(1.0, 1.0), check(1.0, None, Kind.DRIFT)
    assert str(Report((good,), 0.51234, None, 0.00123, 0.0)) == (
        "verification: all 1 checks passed\n  at least 0.512 m from the ground\n"
        "  integrated again: within 0.0012 m; every instant proved"
    )
    words = str(Report((good, sampled), 0.5, 1.5, 0.0, 0.0))
    assert "from the ground, vehicles at least 1.500 m apart\n" in words
    assert words.endswith("within 0.0000 m; sampled: Eq. 1 re-integrated over 5 s")
    bad, worse = check(-0.5, -0.5, Kind.HEIGHT), check(-2.0, -2.0, Kind.ROLL)
    failed = str(report(good, bad, worse))
    assert failed.startswith("verification: FAILED, 2 of 3 checks did not pass\n")
    assert failed.endswith("  roll, mission: violated by 2 m at t = 12.35 s (vehicle 3); and 1 more")
    assert str(report(good, bad)).endswith("height, mission: violated by 0.5 m at t = 12.35 s (vehicle 3)")
