"""A figure and its file: colours of vehicles, titles that fit, a layout that holds still, and the file itself."""

from __future__ import annotations

import io
import textwrap
from pathlib import Path
from typing import Any

import matplotlib as mpl

from gcs.errors import UsageError
from gcs.files import atomic_write

mpl.use("Agg")
from matplotlib import pyplot as plt

DPI = 110
NAMED = 12  # vehicles at most in a legend
BESIDE: dict[str, Any] = {"fontsize": 8, "loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
_COLOURS = (
    *("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e"),
    *("#17becf", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22"),
)
_KINDS = (".png", ".svg", ".pdf")
_POINTS_PER_IN = 72.0
_CHARACTER = 0.62  # width of a character, in sizes of the font
_PASSES = 2  # of the layout: where axes keep their aspect, the first one does not end it
_LINES = 3  # of a title, at most


def colours(sysids: tuple[int, ...]) -> list[str]:
    """Return a colour for each vehicle."""
    return [_COLOURS[i % len(_COLOURS)] for i in range(len(sysids))]


def refuse_kind(path: Path) -> None:
    """Raises UsageError for a file name without the ending of a picture."""
    if path.suffix.lower() not in _KINDS:
        raise UsageError(f"{path} is not the name of a picture.", hint="use a name ending in .png, .svg or .pdf")


def save(figure: Any, path: Path) -> None:
    """Write and close a figure, in the format of the file's ending, whole or not at all. Raises UsageError."""
    drawn = io.BytesIO()
    try:
        refuse_kind(path)
        figure.savefig(drawn, dpi=DPI, format=path.suffix[1:].lower())
    finally:
        plt.close(figure)
    try:
        atomic_write(path, drawn.getvalue())
    except OSError as problem:
        raise UsageError(f"{path} cannot be written: {problem.strerror or problem}.") from None


def head(axes: Any, text: str, width_in: float, size_pt: float = 11.0) -> None:
    """Write a title over axes of that width, in as many lines as it needs."""
    axes.set_title(fitted(text, width_in, size_pt), fontsize=size_pt, parse_math=False)


def head_figure(figure: Any, text: str, size_pt: float = 12.0) -> None:
    """Write a title over a whole figure."""
    figure.suptitle(fitted(text, 0.95 * figure.get_figwidth(), size_pt), fontsize=size_pt, parse_math=False)


def fitted(text: str, width_in: float, size_pt: float) -> str:
    """Return the text in lines that fit a width; what is too long for some lines is shortened."""
    characters = max(int(width_in * _POINTS_PER_IN / (_CHARACTER * size_pt)), 8)
    wrapped = (textwrap.wrap(line, characters, max_lines=_LINES, placeholder=" ...") for line in text.split("\n"))
    return "\n".join(line for lines in wrapped for line in lines)


def settle(figure: Any) -> None:
    """Lay a figure out and keep it so: labels that are placed after this are where they were placed."""
    for _ in range(_PASSES):
        figure.get_layout_engine().execute(figure)
    figure.set_layout_engine("none")
