"""Lets a program that a test starts share plans with the tests (`tests/kept.py`), with this folder in PYTHONPATH.

Python imports this module first in every process, so nothing else is imported until a program imports what is kept.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from types import ModuleType

from kept_functions import KEPT


class Keeping(PathFinder):
    """Replaces functions of a module when it has been executed."""

    @classmethod
    def find_spec(
        cls, fullname: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname not in KEPT or (spec := PathFinder.find_spec(fullname, path, target)) is None:
            return None
        assert spec.loader is not None
        execute = spec.loader.exec_module

        def executed(module: ModuleType) -> None:
            execute(module)
            from tests.kept import kept

            name, *makers = KEPT[fullname]
            setattr(module, name, kept(getattr(module, name), *makers, apart_from=("on_round", "workers")))

        spec.loader.exec_module = executed  # type: ignore[method-assign]
        return spec


sys.meta_path.insert(0, Keeping)
