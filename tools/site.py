"""The site of one version: every page where it stands in the tree, with the pictures and sources that pages link to.

./tools/run python -m tools.site
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from gcs.cli.command_table import version_text

ROOT = Path(__file__).resolve().parent.parent
PAGES = ROOT / "dist" / "site_pages"
LINK = re.compile(r"\]\(([^)#\s]+)")


def page_files() -> list[Path]:
    """The pages: those at the top of the tree, of docs and of the missions."""
    return [
        *sorted(ROOT.glob("*.md")),
        *sorted((ROOT / "docs").rglob("*.md")),
        *sorted(ROOT.glob("missions/*/README.md")),
    ]


def copy_pages() -> None:
    """Copy all pages, and every file that one of them links to, to the same places below `PAGES`."""
    shutil.rmtree(PAGES, ignore_errors=True)
    for page in page_files():
        text = page.read_text(encoding="utf-8")
        linked = ((page.parent / target).resolve() for target in LINK.findall(text) if "://" not in target)
        for file in (page, *(file for file in linked if file.is_file())):
            to = PAGES / file.relative_to(ROOT)
            to.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, to)


if __name__ == "__main__":
    copy_pages()
    build = [sys.executable, "-m", "mkdocs", "build", "--strict", *sys.argv[1:]]
    # Material advertises its successor otherwise; the version stands at the foot of every page.
    told = os.environ | {"NO_MKDOCS_2_WARNING": "1", "SKEIN_VERSION": version_text()}
    sys.exit(subprocess.run(build, cwd=ROOT, env=told, check=False).returncode)
