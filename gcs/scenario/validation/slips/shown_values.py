"""Keys and values as messages show them: short, without nested quotes, at most three digits after the point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gcs.scenario.validation.slips.number_units import is_number_with_unit
from gcs.scenario.validation.toml_lines import Key

_SHOWN_INT = 10**100
_SHOWN_DEPTH = 10
_SMALL = 0.1


@dataclass(frozen=True)
class AsShown:
    """A value whose text is made already."""

    text: str

    def __str__(self) -> str:
        return self.text


def dotted(key: Key) -> str:
    """The key as text: `formation.vehicle[3].position_m[0]`."""
    parts = (f"[{part}]" if isinstance(part, int) else f".{part}" for part in key)
    return "".join(parts).removeprefix(".")


def number(value: float) -> str:
    """A number as people write it: at most three digits after the point, or three digits in all below 0.1."""
    if isinstance(value, int) and abs(value) >= _SHOWN_INT:
        return hex(value)  # Python refuses thousands of decimal digits
    if not isinstance(value, float):
        return str(value)
    return f"{value:.3g}" if 0.0 < abs(value) < _SMALL else str(round(value, 3))


def plain(value: float) -> str:
    """A number in a sentence: at most three digits after the point, and no zeros at the end."""
    if isinstance(value, int):
        return number(value)
    if 0.0 < abs(value) < _SMALL:
        return f"{value:.3g}"
    return f"{value:.3f}".rstrip("0").rstrip(".")


def exact(value: float) -> str:
    """A number to be written into a file: all its digits, and none of a rounding error."""
    return number(value) if isinstance(value, int) else f"{value:.10g}"


def toml(value: Any, depth: int = 0) -> str:
    """The value in TOML, cut when it is long or nested deeply. Numbers with units stand as they were written."""
    if isinstance(value, bool):
        return str(value).lower()
    if depth > _SHOWN_DEPTH:
        text = "..."
    elif isinstance(value, str):
        text = _quoted(value)
    elif isinstance(value, list | tuple):
        text = f"[{', '.join(toml(item, depth + 1) for item in value)}]"
    elif isinstance(value, dict):
        text = f"{{{', '.join(f'{name} = {toml(item, depth + 1)}' for name, item in value.items())}}}"
    elif isinstance(value, int | float):
        text = number(value)
    else:
        text = str(value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def _quoted(text: str) -> str:
    """Text in quotes, unless it holds some: quotes within quotes are hard to read."""
    shown = "".join(mark if mark.isprintable() else ascii(mark)[1:-1] for mark in text)
    return shown if is_number_with_unit(text) or '"' in text or "'" in text else f'"{shown}"'
