"""The output of a command: lines and tables for an operator, or one JSON object for a program.

With `--json` stdout carries exactly one object, and stderr carries warnings only.
"""

from __future__ import annotations

import json
import sys
import time
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gcs.errors import GcsError

if TYPE_CHECKING:
    from rich.console import Console, RenderableType


BEGAN_S = time.perf_counter()  # this module is among the first to be imported


class Screen:
    """The output of one command."""

    def __init__(self, *, json: bool = False) -> None:
        self.json = json

    @cached_property
    def console(self) -> Console:
        """rich's console for tables, bars and live displays; plain lines where stdout is no terminal."""
        from rich.console import Console

        return Console(quiet=self.json, highlight=False)

    @property
    def is_watched(self) -> bool:
        """Whether stdout is a terminal that can redraw, and text is wanted there."""
        return bool(not self.json and self.console.is_terminal and not self.console.is_dumb_terminal)

    def say(self, text: str) -> None:
        """Print one line, never wrapped or coloured, so that it can be searched and copied; nothing with `--json`."""
        if not self.json:
            print(text, flush=True)

    def warn(self, text: str) -> None:
        """Print one warning line: on stdout among the others, or on stderr with `--json`."""
        print(f"WARNING: {text}", file=sys.stderr if self.json else sys.stdout, flush=True)

    def ask(self, question: str) -> None:
        """Print a question that you must answer to go on; on stderr with `--json`."""
        print(question, file=sys.stderr if self.json else sys.stdout, flush=True)

    def show(self, picture: RenderableType) -> None:
        """Print a table or another rich renderable; nothing with `--json`."""
        if not self.json:
            self.console.print(picture)

    def result(self, data: dict[str, Any]) -> None:
        """Print the one JSON object, with `--json` only; `"ok"` is true unless `data` has another value."""
        if self.json:
            print(to_json({"ok": True, **data}), flush=True)

    def error(self, message: str, *, hint: str, kind: str, exit_code: int) -> None:
        """Print what failed and what to do next: on stderr, or as the one object on stdout with `--json`."""
        if self.json:
            failure = {"kind": kind, "message": message, "hint": hint, "exit_code": exit_code}
            print(to_json({"ok": False, "error": failure}), flush=True)
            return
        print(f"error: {message}", file=sys.stderr)
        if hint:
            print(f"next: {hint}", file=sys.stderr)

    def failure(self, error: GcsError) -> None:
        """Print one of the errors of `gcs.errors`."""
        self.error(error.message, hint=error.hint, kind=type(error).__name__, exit_code=error.exit_code)

    def stopped(self, exit_code: int) -> None:
        """Print that you stopped the command."""
        if self.json:
            self.error("stopped", hint="", kind="Stopped", exit_code=exit_code)
        else:
            print("stopped", file=sys.stderr)


def to_json(data: Any) -> str:
    """The JSON text of plain values, paths and NumPy arrays. Raises ValueError on NaN and infinity, unknown to JSON."""
    return json.dumps(data, default=_plain, allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy, without importing it
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")
