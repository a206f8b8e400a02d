"""A figure and its file: colours, titles that fit, places of labels, a layout that holds still, and the file."""

import io
import textwrap
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gcs.errors import UsageError
from gcs.util.atomic_write import atomic_write

mpl.use("Agg")
from itertools import product

import numpy as np
from matplotlib import pyplot as plt
from matplotlib.text import Annotation
from matplotlib.transforms import Bbox
from numpy.typing import ArrayLike

DPI = 110
NAMED = 12  # vehicles at most in a legend
Look = dict[str, Any]  # keyword arguments of matplotlib
BESIDE: Look = {"fontsize": 8, "loc": "upper left", "bbox_to_anchor": (1.01, 1.0), "borderaxespad": 0.0}
_COLOURS = (
    *("#d62728", "#1f77b4", "#2ca02c", "#9467bd", "#ff7f0e"),
    *("#17becf", "#8c564b", "#e377c2", "#7f7f7f", "#bcbd22"),
)
_KINDS = (".png", ".svg", ".pdf")
_POINTS_PER_IN = 72.0
_CHARACTER = 0.62  # width of a character, in sizes of the font
_PASSES = 2  # of the layout: where axes keep their aspect, the first one does not end it
_LINES = 3  # of a title, at most
_REACH_PT = (7.0, 13.0, 22.0, 34.0, 50.0)  # from the point to the label's nearest side
_TURN_DEG = (20.0, -20.0, 160.0, -160.0, 70.0, -70.0, 110.0, -110.0)
_ROOM_PX = 2.0
_ALONG = 8  # points of each part of an arrow
_LONG_PT = 20.0  # from that distance on, a line joins label and point
_HALO = {"boxstyle": "round,pad=0.1", "fc": "white", "ec": "none", "alpha": 0.65}


def colours(sysids: tuple[int, ...]) -> list[str]:
    """Return a colour for each vehicle."""
    return [_COLOURS[i % len(_COLOURS)] for i in range(len(sysids))]


def refuse_kind(path: Path) -> None:
    """Raises UsageError for a file name without the ending of a picture."""
    if path.suffix.lower() not in _KINDS:
        raise UsageError(f"{path} is not the name of a picture.", hint="use a name ending in .png, .svg or .pdf")


def save(figure: Figure, path: Path) -> None:
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


def head(axes: Axes, text: str, width_in: float, size_pt: float = 11.0) -> None:
    """Write a title over axes of that width, in as many lines as it needs."""
    axes.set_title(fitted(text, width_in, size_pt), fontsize=size_pt, parse_math=False)


def head_figure(figure: Figure, text: str) -> None:
    """Write a title over a whole figure."""
    figure.suptitle(fitted(text, 0.95 * figure.get_figwidth(), 12.0), fontsize=12.0, parse_math=False)


def fitted(text: str, width_in: float, size_pt: float) -> str:
    """Return the text in lines that fit a width; what is too long for some lines is shortened."""
    characters = max(int(width_in * _POINTS_PER_IN / (_CHARACTER * size_pt)), 8)
    wrapped = (textwrap.wrap(line, characters, max_lines=_LINES, placeholder=" ...") for line in text.split("\n"))
    return "\n".join(line for lines in wrapped for line in lines)


def settle(figure: Figure) -> None:
    """Lay a figure out and keep it so: labels that are placed after this are where they were placed.

    They are as wide then as in the file: letters are fitted to its pixels.
    """
    figure.set_dpi(DPI)
    for _ in range(_PASSES):
        if (engine := figure.get_layout_engine()) is not None:
            engine.execute(figure)
    figure.set_layout_engine("none")


class Labels:
    """The labels of one figure, which is laid out already. Each goes to the first free place near its point."""

    def __init__(self, figure: Figure) -> None:
        self._figure = figure
        self._renderer = figure.canvas.get_renderer()  # type: ignore[attr-defined]
        self._taken: list[Bbox] = []

    def avoid_points(self, axes: Axes, places: ArrayLike, size_px: float = 5.0) -> None:
        """Keep labels off markers at places (N, 2), east and north."""
        for x, y in axes.transData.transform(np.asarray(places)):
            self._taken.append(Bbox([[x - size_px, y - size_px], [x + size_px, y + size_px]]))

    def avoid_arrows(self, axes: Axes) -> None:
        """Keep labels off arrows that begin at a place on the map and have a length in points."""
        for note in axes.texts:
            if isinstance(note, Annotation) and note.arrow_patch is not None and not note.get_text():
                path = note.arrow_patch.get_path().interpolated(_ALONG)
                for x, y in note.arrow_patch.get_transform().transform(path.vertices):
                    self._taken.append(Bbox([[x - 1.0, y - 1.0], [x + 1.0, y + 1.0]]))

    def place(self, axes: Axes, text: str, point: tuple[float, float], *, needed: bool = False, **style: Any) -> bool:
        """Write a label near (east, north); whether there was room. One that is needed is written without room too."""
        if not axes.bbox.contains(*axes.transData.transform(point)):
            return False
        style = {"fontsize": 8, "bbox": _HALO, "zorder": 12, "va": "center", **style}
        note = axes.annotate(text, point, xytext=(0.0, 0.0), textcoords="offset points", annotation_clip=False, **style)
        note.set_in_layout(False)
        first = None
        for reach, turn in product(_REACH_PT, np.radians(_TURN_DEG)):
            right, up = float(reach * np.cos(turn)), float(reach * np.sin(turn))
            note.set_position((right, up))
            note.set_horizontalalignment(
                "left" if right > 0.4 * reach else "right" if right < -0.4 * reach else "center"
            )
            box = note.get_window_extent(self._renderer).padded(_ROOM_PX)
            room = axes.bbox
            if not (room.x0 <= box.x0 and box.x1 <= room.x1 and room.y0 <= box.y0 and box.y1 <= room.y1):
                continue
            first = first or (right, up, note.get_horizontalalignment(), box)
            if not any(box.overlaps(other) for other in self._taken):
                self._taken.append(box)
                if reach >= _LONG_PT:
                    self._join(axes, point, (right, up))
                return True
        if not needed or first is None:
            note.remove()
            return False
        note.set_position(first[:2])
        note.set_horizontalalignment(first[2])
        self._taken.append(first[3])
        return False

    def _join(self, axes: Axes, point: tuple[float, float], offset_pt: tuple[float, float]) -> None:
        line = axes.annotate(
            "",
            point,
            xytext=offset_pt,
            textcoords="offset points",
            arrowprops={"arrowstyle": "-", "lw": 0.5, "color": "0.3"},
            zorder=11,
        )
        line.set_in_layout(False)
