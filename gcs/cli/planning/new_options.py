"""The options of `gcs new` as they are typed (`--end 47.40 8.55`, `--course north-east`), and as numbers."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from typer.core import TyperCommand

from gcs.cli.shared.shared_options import as_number, as_share
from gcs.errors import UsageError

WINDS = ("n", "nne", "ne", "ene", "e", "ese", "se", "sse", "s", "ssw", "sw", "wsw", "w", "wnw", "nw", "nnw")
COURSES = ("north", "north-east", "east", "south-east", "south", "south-west", "west", "north-west")
_PLACE_MAX = {"--at": 3, "--end": 2}  # numbers of a place, by option
_INITIALS = {"north": "n", "east": "e", "south": "s", "west": "w", "-": "", " ": ""}
AUTO = "auto"
_OVERLAP_MAX = 0.9


class PlaceCommand(TyperCommand):
    """A command whose places (--at, --end) take their numbers with commas or with spaces between them."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments, with the numbers of each place in one word."""
        joined: list[str] = []
        rest = list(args)
        while rest:
            word = rest.pop(0)
            if word in _PLACE_MAX and rest:
                parts = [rest.pop(0)]
                while rest and _numbers(parts) < _PLACE_MAX[word] and _numbers([rest[0]]):
                    parts.append(rest.pop(0))
                word = f"{word}={','.join(part.strip().strip(',') for part in parts)}"
            joined.append(word)
        return super().parse_args(ctx, joined)


def parse_place(text: str, option: str = "--at") -> tuple[float, float, float | None]:
    """Latitude, longitude, and height above the sea if it is given. Raises `UsageError`."""
    parts = text.replace(",", " ").split()
    count = _numbers([text])
    if count != len(parts) or not 2 <= count <= _PLACE_MAX[option]:
        example = "--at 47.39,8.54 or, with its height, --at 47.39 8.54 450" if option == "--at" else "--end 47.40,8.55"
        raise UsageError(f"{option} {text}: not a place", hint=f"write for example {example}")
    lat_deg, lon_deg, *height = map(float, parts)
    return lat_deg, lon_deg, height[0] if height else None


def parse_course(text: str, option: str = "--course") -> float:
    """Degrees clockwise from north, from a number or a point of the compass. Raises `UsageError`."""
    wind = text.strip().lower()
    for word, initial in _INITIALS.items():
        wind = wind.replace(word, initial)
    if wind in WINDS:
        return 360.0 / len(WINDS) * WINDS.index(wind)
    course_deg = as_number(text)
    if not -360.0 <= course_deg <= 360.0:
        raise UsageError(
            f"{option} {text}: not a course", hint="give degrees clockwise from north, or north, north-east, east, ..."
        )
    return course_deg


def _numbers(words: list[str]) -> int:
    """How many numbers the words hold; 0 where one is something else."""
    parts = [part for word in words for part in word.replace(",", " ").split()]
    try:
        return len([float(part) for part in parts])
    except ValueError:
        return 0


@dataclass(frozen=True)
class DrawingOptions:
    """The options of every flight along or over a drawing: its place, the ground under it, and what flies."""

    at: tuple[float, float, float | None] | None  # degrees, degrees, m above the sea
    terrain: Path | None = None  # elevation model; heights count from it
    vehicle: str | None = None  # preset or vehicle file


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
    overlap_share(options.overlap)
    pass_course_deg(options.angle)


def overlap_share(text: str | None) -> float:
    """The share of `20%` or `0.2`. Raises `UsageError`."""
    if text is None:
        return 0.2
    share = as_share(text)
    if not 0.0 <= share <= _OVERLAP_MAX:
        raise UsageError(f"--overlap {text}: not a share up to {_OVERLAP_MAX:.0%}", hint="give for example 20% or 0.2")
    return share


def pass_course_deg(text: str | None) -> float | None:
    """The direction of the passes; None for the best one. Raises `UsageError`."""
    if text is None or text.strip().lower() == AUTO:
        return None
    return parse_course(text, "--angle")
