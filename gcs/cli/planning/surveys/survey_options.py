"""The options of `gcs new --survey`, as they were typed and as numbers."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.cli.planning.places_given import parse_course
from gcs.cli.shared_options import unknown_choice, within
from gcs.errors import UsageError

AUTO = "auto"
HOLES = ("cross", "avoid")
_OVERLAP_MAX = 0.9


@dataclass(frozen=True)
class SurveyOptions:
    """The options of a survey as they were typed; None for those left out."""

    swath: float | None
    overlap: str | None
    angle: str | None
    speed: float | None
    holes: str | None

    def given(self) -> list[str]:
        """The names of those that were typed."""
        return [f"--{name}" for name, value in vars(self).items() if value is not None]


def check_survey(options: SurveyOptions) -> None:
    """Refuse wrong options before anything is read. Raises `UsageError`."""
    if options.swath is None:
        raise UsageError("--survey needs --swath.", hint="give the width that a vehicle sees, for example --swath 12")
    within("--swath", options.swath, 0.5, 1000.0, "m")
    if options.speed is not None:
        within("--speed", options.speed, 0.2, 100.0, "m/s")
    if options.holes is not None and options.holes not in HOLES:
        raise unknown_choice("--holes", options.holes, HOLES)
    overlap_share(options.overlap)
    pass_course_deg(options.angle)


def overlap_share(text: str | None) -> float:
    """The share of `20%` or `0.2`. Raises `UsageError`."""
    if text is None:
        return 0.2
    number, percent, rest = text.partition("%")
    try:
        share = float(number) / (100.0 if percent else 1.0)
    except ValueError:
        share = -1.0
    if rest.strip() or not 0.0 <= share <= _OVERLAP_MAX:
        raise UsageError(f"--overlap {text}: not a share up to {_OVERLAP_MAX:.0%}", hint="give for example 20% or 0.2")
    return share


def pass_course_deg(text: str | None) -> float | None:
    """The direction of the passes; None for the best one. Raises `UsageError`."""
    if text is None or text.strip().lower() == AUTO:
        return None
    return parse_course(text, "--angle")
