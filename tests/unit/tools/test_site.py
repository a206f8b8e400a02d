"""The site has every page, and every page of the site is in its menu."""

from __future__ import annotations

import re
from pathlib import Path

from tools.site import page_files


def test_every_page_is_in_the_menu(repo_root: Path) -> None:
    menu = re.findall(r"[\w/]+\.md$", (repo_root / "mkdocs.yml").read_text(encoding="utf-8"), re.M)
    assert sorted(menu) == sorted(str(page.relative_to(repo_root)) for page in page_files())


def test_the_page_of_each_trade_is_short(repo_root: Path) -> None:
    pages = sorted((repo_root / "docs").glob("for_*.md"))
    assert len(pages) == 4
    assert all(len(page.read_text(encoding="utf-8").splitlines()) < 60 for page in pages)
