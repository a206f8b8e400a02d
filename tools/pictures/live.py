"""Pictures of the page in six states of its life, from flights that are really flown, in a headless Chromium."""

import io
import re
import socket
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from PIL import Image

from tests.browser import Browser

SIZE = (1200, 780)
_COLOURS = 224  # of each picture: that keeps it small
_ADDRESS = re.compile(r"page: (http://127\.0\.0\.1:\d+/\?token=[\w-]+)")
NOW = "skein.scene.newest.t_s"
_LOST_S = 90.0


def write_page(root: Path, folder: Path) -> Iterator[Path]:
    """Plan, go or no-go, a flight from above and followed, an incident, and the verdict."""
    gcs = (sys.executable, "-m", "gcs")
    field = root / "missions" / "field"
    with tempfile.TemporaryDirectory() as scratch, Browser(*SIZE) as page:
        with page_of((*gcs, "show", str(root / "missions" / "survey"), "--page"), page):
            page.value("skein.seek(60), skein.look('all')")
            yield taken(page, folder / "plan.png")
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("127.0.0.1", 0))
            port = free.getsockname()[1]
        vehicles = [sys.executable, "-m", "sim_bridge", str(field), "--udp", f"127.0.0.1:{port}"]
        with subprocess.Popen(vehicles, stdout=subprocess.DEVNULL) as emulated:
            try:
                line = (*gcs, "fly", str(field), "--link", f"udpin:127.0.0.1:{port}", "--page", "--to", scratch)
                with page_of(line, page):
                    page.until("!document.querySelector('.question').hidden", 300.0)
                    yield taken(page, folder / "go.png")
            finally:
                emulated.terminate()
        flown = (
            *gcs,
            "fly",
            str(field),
            "--sim",
            "--mode",
            "mission",
            "--nav",
            "own",
            "--speedup",
            "5",
            "--page",
        )
        with page_of((*flown, "--page-keep", "--fault", f"4:die@{_LOST_S + 60:g}", "--to", scratch), page):
            page.until(f"{NOW} > 20", 300.0)
            page.value("skein.look('above')")
            yield taken(page, folder / "above.png")
            page.value("skein.look('chase')")
            page.until(f"{NOW} > 50", 300.0)
            yield taken(page, folder / "chase.png")
            page.until("skein.scene.events.some((one) => one.sysid === 4 && one.is_bad)", 300.0)
            page.value("skein.look('all')")
            yield taken(page, folder / "incident.png", settle_ms=4000)
            page.until("!document.querySelector('.report').hidden && skein.scene.kind === 'replay'", 600.0)
            page.value("skein.seek(skein.curves.worst(skein.curves.separation).t), skein.look('side')")
            yield taken(page, folder / "verdict.png", settle_ms=3000)


@contextmanager
def page_of(line: tuple[str, ...], page: Browser) -> Iterator[None]:
    """Have the browser show the page that a command opens; the command ends with the block."""
    with subprocess.Popen(line, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True) as command:
        try:
            found: Any = None
            while found is None:
                said = command.stdout.readline() if command.stdout is not None else ""
                if not said:
                    raise SystemExit(f"{' '.join(line)} ended without a page")
                found = _ADDRESS.search(said)
            page.go(found[1])
            page.until("skein.world.markers.size", 180.0)
            yield
            page.go("about:blank")
        finally:
            command.kill()


def taken(page: Browser, path: Path, settle_ms: int = 1500) -> Path:
    """Save what the page shows once it stands still, with few colours."""
    page.value(f"new Promise((done) => setTimeout(done, {settle_ms}))")
    page.picture(path)
    picture = Image.open(io.BytesIO(path.read_bytes())).convert("RGB").quantize(_COLOURS, dither=Image.Dither.NONE)
    picture.save(path, optimize=True)
    return path
