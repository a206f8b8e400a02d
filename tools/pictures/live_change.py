"""A picture of the page in a headless Chromium: a zone in the way of a flight, and the plan round it as proposed."""

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.browser import Browser
from tools.pictures.live import NOW, SIZE, page_of, taken

_DRAWN_AT_S, _AHEAD_S, _RADIUS_M = 16.0, 80.0, 25.0  # when the zone is drawn, how far ahead, and how large
_NEARER = """(() => {{ const {{ world }} = skein; const place = world.at([{0}, {1}, 0]); world.isMoved = true;
    world.controls.target.copy(place); world.camera.position.copy(place).add({{ x: 0, y: -0.4, z: 450 }}); }})()"""


def write_proposal(root: Path, folder: Path) -> Iterator[Path]:
    """The proposed plan and what it costs, before it is accepted."""
    with tempfile.TemporaryDirectory() as scratch, Browser(*SIZE) as page:
        line = (sys.executable, "-m", "gcs", "fly", str(root / "missions" / "ridge"), "--sim", "--speedup", "1")
        with page_of((*line, "--page", "--to", scratch), page):
            page.until(f"{NOW} > {_DRAWN_AT_S}", 300.0)
            place = f"skein.scene.place(skein.scene.planned, 0, skein.scene.at({NOW} + {_AHEAD_S}))"
            north_m, east_m, _ = page.value(place)
            zone = f"{north_m:.1f},{east_m:.1f},{_RADIUS_M:g}"
            page.value("skein.look('above')")
            page.value(_NEARER.format(north_m, east_m))
            page.value(f"(skein.changes.of.value = '{zone}', skein.changes.propose(), 0)")
            page.until("!document.querySelector('.proposal').hidden", 120.0)
            yield taken(page, folder / "proposal.png")
