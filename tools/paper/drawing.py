"""How figures of the page are written.

Knows: resolution. Does not know: what is drawn.
"""

from __future__ import annotations

from matplotlib.figure import Figure

from tools.paper.run import Run

_DPI, _SHORT_DPI = 85, 30


def save(figure: Figure, run: Run, name: str) -> None:
    """Write a figure of the page."""
    run.pictures.mkdir(parents=True, exist_ok=True)
    if run.short:
        figure.set_layout_engine("none")  # half of the time
    metadata = {"Software": None}  # the same numbers give the same file
    figure.savefig(run.pictures / name, dpi=_SHORT_DPI if run.short else _DPI, metadata=metadata)
