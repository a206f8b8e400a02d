"""The page in flight as a film, recorded in a headless Chromium while the vehicles fly."""

import base64
import io
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from PIL import Image

from tests.browser import Browser
from tools.pictures.live import NOW, page_of

_WINDOW, _WIDE = (1200, 750), 800  # pixels: of the window, and of the film
_BEGIN_S, _END_S, _STEP_S = -6.0, 126.0, 3.0  # of the plan's time: hover, flight, hover
_SPEEDUP = "2"
_SHOWN_MS, _STILL_MS = 150, 1500  # each picture, and the last one
_COLOURS = 96


def write_page_film(root: Path, path: Path) -> Path:
    """Fly `gap` with emulated vehicles and a page, and save a GIF of it, seen from behind the leader."""
    line = (sys.executable, "-m", "gcs", "fly", str(root / "missions" / "gap"), "--sim", "--speedup", _SPEEDUP)
    with (
        tempfile.TemporaryDirectory() as scratch,
        Browser(*_WINDOW) as page,
        page_of((*line, "--page", "--to", scratch), page),
    ):
        return save_film(recorded(page), path)


def recorded(page: Browser) -> list[Image.Image]:
    """Pictures of the page between two times of the flight under way."""
    pictures, next_s = [], _BEGIN_S
    page.until(f"{NOW} > {next_s}", 300.0)
    page.value("skein.look('chase')")
    while next_s < _END_S:
        page.until(f"{NOW} > {next_s}", 60.0)
        png = page.call("Page.captureScreenshot", format="png")["data"]
        pictures.append(smaller(png))
        next_s = max(next_s + _STEP_S, float(page.value(NOW)))
    return pictures


def smaller(png: str) -> Image.Image:
    """A picture, base64 of PNG, as wide as the film."""
    picture = Image.open(io.BytesIO(base64.b64decode(png))).convert("RGB")
    return picture.resize((_WIDE, round(_WIDE * picture.height / picture.width)), Image.Resampling.LANCZOS)


def save_film(pictures: Sequence[Image.Image], path: Path) -> Path:
    """Save pictures one after the other as GIF, in colours that they share: what stands still takes no room."""
    shared = pictures[len(pictures) // 2].quantize(_COLOURS, dither=Image.Dither.NONE)
    first, *others = (one.quantize(palette=shared, dither=Image.Dither.NONE) for one in pictures)
    shown_ms = [_SHOWN_MS] * len(others) + [_STILL_MS]
    first.save(path, save_all=True, append_images=others, duration=shown_ms, loop=0, optimize=True)
    return path
