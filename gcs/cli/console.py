"""What a command says, and to whom: lines for people, or one JSON object for programs.

Knows: terminals, JSON, how errors read. Does not know: commands.
With `--json` stdout carries exactly one object; what people would read goes to stderr.
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
    """Output of one command."""

    def __init__(self, *, json: bool = False) -> None:
        self.json = json

    @cached_property
    def console(self) -> Console:
        """rich's console for tables, bars and live displays; plain lines where nobody watches."""
        from rich.console import Console

        return Console(stderr=self.json, highlight=False)

    @property
    def is_watched(self) -> bool:
        """Whether live displays make sense: a terminal is there and it can redraw."""
        return bool(self.console.is_terminal and not self.console.is_dumb_terminal)

    def say(self, text: str) -> None:
        """One line for people, never wrapped or coloured, so that it can be searched and copied."""
        print(text, file=sys.stderr if self.json else sys.stdout, flush=True)

    def show(self, picture: RenderableType) -> None:
        """A table or other rich renderable for people."""
        self.console.print(picture)

    def result(self, data: dict[str, Any]) -> None:
        """What the command found, for programs: printed with `--json` only, `"ok": true` unless data says otherwise."""
        if self.json:
            print(to_json({"ok": True, **data}), flush=True)

    def error(self, message: str, *, hint: str, kind: str, exit_code: int) -> None:
        """What went wrong: on stderr for people, as the one object on stdout for programs."""
        if self.json:
            failure = {"kind": kind, "message": message, "hint": hint, "exit_code": exit_code}
            print(to_json({"ok": False, "error": failure}), flush=True)
            return
        print(f"error: {message}", file=sys.stderr)
        if hint:
            print(f"next: {hint}", file=sys.stderr)

    def failure(self, error: GcsError) -> None:
        """The same for one of the errors of `gcs.errors`."""
        self.error(error.message, hint=error.hint, kind=type(error).__name__, exit_code=error.exit_code)

    def stopped(self, exit_code: int) -> None:
        """The person at the keyboard has ended it."""
        if self.json:
            self.error("stopped", hint="", kind="Stopped", exit_code=exit_code)
        else:
            print("stopped", file=sys.stderr)


def to_json(data: Any) -> str:
    """JSON text of plain values, paths and NumPy arrays. Raises ValueError on NaN and infinity, which JSON has not."""
    return json.dumps(data, default=_plain, allow_nan=False, ensure_ascii=False)


def _plain(value: Any) -> Any:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy, without importing it
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")
