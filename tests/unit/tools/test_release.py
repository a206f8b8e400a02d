"""What a release needs: one version everywhere, and a section of the changelog that is dated when it is cut."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path


def test_one_version_everywhere(repo_root: Path) -> None:
    def found(file: str, pattern: str) -> str:
        match = re.search(pattern, (repo_root / file).read_text(encoding="utf-8"), re.M)
        assert match, f"{file} has no {pattern}"
        return match[1]

    version = tomllib.loads((repo_root / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert found("CITATION.cff", r"^version: (\S+)$") == version
    newest = found("CHANGELOG.md", r"^## (.*)$")
    assert re.fullmatch(rf"{re.escape(version)} \((unreleased|20\d\d-\d\d-\d\d)\)", newest)
    assert (repo_root / "tests" / "releases" / version).is_dir(), "a release leaves files that later versions read"
