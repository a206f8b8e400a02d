"""Writes the commit into the wheel, as `gcs/commit.txt`: `gcs --version` prints it."""

import subprocess
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface


class BuiltFrom(BuildHookInterface[Any]):
    """A hook of hatchling. Without git, or in an editable install, there is no such file."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Write the file and have it packed."""
        asked = ["git", "-C", self.root, "rev-parse", "HEAD"]
        if version == "editable" or not (Path(self.root) / ".git").exists():
            return
        try:
            commit = subprocess.run(asked, capture_output=True, text=True, check=True).stdout.strip()
        except (OSError, subprocess.CalledProcessError):
            return
        file = Path(self.directory) / "commit.txt"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(commit + "\n", encoding="ascii")
        build_data["force_include"][str(file)] = "gcs/commit.txt"

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove what was written beside the wheel."""
        (Path(self.directory) / "commit.txt").unlink(missing_ok=True)
