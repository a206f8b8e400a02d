"""What the shell offers after the Tab key: missions, plans, flights and the words that an option takes.

It reads folders and opens no link: a port that the completion opens takes frames from the station that flies.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

SCENARIO, PLAN, FLIGHT = "scenario.toml", ".skein", "flight.json"
_DEPTH = 3  # folders below the one that is typed
_ENTRIES_MAX = 5000  # read for one key press
_READ_MAX = 4000  # bytes of a .toml file

Completion = Callable[[str], list[str]]


def one_of(*words: str) -> Completion:
    """Offer these words."""

    def offered(incomplete: str) -> list[str]:
        return [word for word in words if word.startswith(incomplete)]

    return offered


def missions(incomplete: str) -> list[str]:
    """Mission folders, and scenario and plan files that stand outside them."""
    return _found(incomplete, SCENARIO, (PLAN, ".toml"))


def plans(incomplete: str) -> list[str]:
    """Plan files."""
    return _found(incomplete, None, (PLAN,))


def flights(incomplete: str) -> list[str]:
    """Folders of flights, the newest first."""
    return sorted(_found(incomplete, FLIGHT, ()), reverse=True)


def recordings(incomplete: str) -> list[str]:
    """Folders of flights, the newest first, and logs."""
    return [*flights(incomplete), *_found(incomplete, FLIGHT, (".tlog",), folders=False)]


def _found(incomplete: str, mark: str | None, suffixes: tuple[str, ...], *, folders: bool = True) -> list[str]:
    """The folders that hold a file `mark`, and the files outside them that end so, as the user began to type them."""
    typed, slash, begun = incomplete.rpartition("/")
    found: list[str] = []
    left = [_ENTRIES_MAX]
    for entry in _entries(Path(typed or slash or "."), left):
        if entry.name.startswith(begun):
            found += _below(entry, f"{typed}{slash}{entry.name}", mark, suffixes, left, _DEPTH, folders)
    return found


def _below(
    entry: os.DirEntry[str],
    name: str,
    mark: str | None,
    suffixes: tuple[str, ...],
    left: list[int],
    depth: int,
    folders: bool,
) -> Iterator[str]:
    if not entry.is_dir(follow_symlinks=False):
        if name.endswith(suffixes) and (not name.endswith(".toml") or _is_scenario(Path(entry.path))):
            yield name
    elif mark is not None and (Path(entry.path) / mark).exists():
        if folders:
            yield name
    elif depth > 1:
        for inner in _entries(Path(entry.path), left):
            yield from _below(inner, f"{name}/{inner.name}", mark, suffixes, left, depth - 1, folders)


def _is_scenario(file: Path) -> bool:
    with suppress(OSError), file.open("rb") as opened:
        return b"schema_version" in opened.read(_READ_MAX)
    return False


def _entries(folder: Path, left: list[int]) -> list[os.DirEntry[str]]:
    """What is in a folder, by name, without hidden entries; nothing where it cannot be read."""
    found: list[os.DirEntry[str]] = []
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            left[0] -= 1
            if left[0] < 0:
                break
            if not entry.name.startswith("."):
                found.append(entry)
    return sorted(found, key=lambda entry: entry.name)
