"""A flight as the page shows it, filmed in a headless Chromium: a zone is drawn, and the plan round it flown."""

import io
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from PIL import Image

from tests.browser import Browser
from tools.pictures.live import NOW, page_of, taken

_SIZE, _SMALL = (1200, 750), (960, 600)
_COLOURS, _FRAME_MS = 48, 160
_STEP_S = 3.0  # of plan time between frames in flight
_DRAWN_AT_S, _AHEAD_S, _RADIUS_M = 20.0, 80.0, 25.0  # when the zone is drawn, how far ahead, and how large
_PAST_S, _ENDS_S = 125.0, 150.0  # the zone, and of the film
_NEARER = """(() => {{ const {{ world }} = skein; const place = world.at([{0}, {1}, 0]); world.isMoved = true;
    world.controls.target.copy(place); world.camera.position.copy(place).add({{ x: 0, y: -0.4, z: 330 }}); }})()"""


def write_film(root: Path, folder: Path) -> Iterator[Path]:
    """The film, and a picture of the proposal."""
    frames: list[Image.Image] = []
    with tempfile.TemporaryDirectory() as scratch, Browser(*_SIZE) as page:
        line = (sys.executable, "-m", "gcs", "fly", str(root / "missions" / "ridge"), "--sim", "--speedup", "2")
        with page_of((*line, "--page", "--to", scratch), page):

            def frame(count: int = 1) -> None:
                shot = Path(scratch) / "frame.png"
                page.picture(shot)
                frames.extend([Image.open(io.BytesIO(shot.read_bytes())).convert("RGB").resize(_SMALL, 3)] * count)

            def fly_until(t_s: float) -> None:
                while (now_s := page.value(NOW) or -1.0) < t_s:
                    frame()
                    page.until(f"{NOW} > {now_s + _STEP_S}", 120.0)

            page.until(f"{NOW} > 6", 300.0)
            fly_until(_DRAWN_AT_S)
            ahead = f"skein.scene.at({_DRAWN_AT_S + _AHEAD_S})"
            north_m, east_m, _ = page.value(f"skein.scene.place(skein.scene.planned, 0, {ahead})")
            page.value("document.querySelector('.changed .draw').click()")
            page.value("new Promise((done) => setTimeout(done, 500))")
            page.value(_NEARER.format(north_m, east_m))
            for share in (0.2, 0.6, 1.0):
                page.value(f"skein.changes.drawing.showZone({north_m}, {east_m}, {share * _RADIUS_M})")
                page.value("new Promise((done) => setTimeout(done, 200))")
                frame()
            page.value("skein.changes.drawing.end()")
            page.value(
                f"(skein.changes.of.value = '{north_m:.1f},{east_m:.1f},{_RADIUS_M:g}', skein.changes.propose(), 0)"
            )
            page.until("!document.querySelector('.proposal').hidden", 120.0)
            yield taken(page, folder / "proposal.png")
            frame(10)
            page.value("document.querySelector('.proposal .accept').click()")
            page.until("skein.scene.zones.length === 2", 120.0)
            frame(4)
            fly_until(_PAST_S)
            page.value("skein.look('chase')")
            fly_until(_ENDS_S)
    still = frames[len(frames) // 2].quantize(_COLOURS)
    small = [one.quantize(palette=still, dither=Image.Dither.NONE) for one in frames]
    path = folder / "flight.gif"
    small[0].save(path, save_all=True, append_images=small[1:], duration=_FRAME_MS, loop=0, optimize=True)
    yield path
