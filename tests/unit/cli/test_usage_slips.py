"""Mistyped command lines, as a person mistypes them: one sentence and what to type instead."""

from __future__ import annotations

import pytest

from gcs.cli.main import run
from gcs.errors import PlanningError, UsageError, counted


@pytest.mark.parametrize(
    ("typed", "says", "then"),
    [
        ("plam missions/field", "gcs has no command plam", "write gcs plan"),
        ("plan missions/field --outt x", "gcs plan has no option --outt", "write --out"),
        ("schema --x", "gcs schema has no option --x", "see `gcs schema --help`"),
        (
            "check a.plan --separation 5m",
            "--separation: must be a number, without a unit",
            "write for example --separat",
        ),
        ("check a.plan --separation 5,5", "--separation: must be a number", "write for example --separation 5"),
        ("new plans/x --count six", "--count: must be a whole number", "write for example --count 5"),
        (
            "schema me",
            "gcs schema takes no more arguments; there is also me",
            "see `gcs schema --help`",
        ),
        ("plan", "Missing argument 'MISSION'.", "see `gcs plan --help`"),
    ],
)
def test_one_sentence_and_what_to_type(typed: str, says: str, then: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(typed.split()) == 2
    error, hint = capsys.readouterr().err.splitlines()
    assert error.startswith(f"error: {says}")
    assert hint.startswith(f"next: {then}")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("1.388888889 m/s is too slow", "1.389 m/s is too slow"),
        ("-0.00012345 m of 20.50000 m", "-0.000123 m of 20.5 m"),
        ("0.0203 deg/s at 47.3977421 north", "0.0203 deg/s at 47.3977421 north"),
        ("v1.23456 m.plan/12.34567.bin", "v1.23456 m.plan/12.34567.bin"),
    ],
)
def test_quantities_have_three_digits_after_the_point(text: str, shown: str) -> None:
    error = PlanningError(text, hint=text)
    assert (error.message, error.hint, str(error)) == (shown, shown, shown)


def test_one_is_singular() -> None:
    assert [counted(n, "vehicle") for n in (0, 1, 2)] == ["0 vehicles", "1 vehicle", "2 vehicles"]
    assert counted(2, "vehicle has its", "vehicles have their") == "2 vehicles have their"
    assert UsageError("x").exit_code == 2
