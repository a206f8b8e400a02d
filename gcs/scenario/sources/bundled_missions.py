"""The missions that come with Skein: a bare name such as `simulation1` means one of them.

A wheel has them in the package. In a checkout they are the folder `missions` at its top.
"""

from pathlib import Path

_PACKAGE = Path(__file__).resolve().parents[2]
FILE_NAME = "scenario.toml"


def bundled_folder() -> Path | None:
    """The folder of all bundled missions; None where they were left out of an installation."""
    places = (_PACKAGE / "missions", _PACKAGE.parent / "missions")
    return next((place for place in places if (place / "simulation1" / FILE_NAME).is_file()), None)


def bundled_names() -> list[str]:
    """The names of the bundled missions, sorted."""
    folder = bundled_folder()
    return sorted(file.parent.name for file in folder.glob(f"*/{FILE_NAME}")) if folder else []


def bundled_mission(path: Path) -> Path | None:
    """The scenario file of the bundled mission that a bare name means; None if it is a path, or no mission's name."""
    if path.name != str(path) or path.name not in bundled_names():
        return None
    folder = bundled_folder()
    return folder / path.name / FILE_NAME if folder else None
