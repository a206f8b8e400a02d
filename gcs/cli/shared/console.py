"""The output of a command: lines and tables for an operator, or one JSON object for a program.

With `--json` stdout carries exactly one object, and stderr carries warnings only. Output that fails raises nothing.
"""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cached_property
from pathlib import Path
from typing import IO, TYPE_CHECKING, cast

from gcs.cli.shared.safe_stdout import SafeStream
from gcs.errors import GcsError, error_text, for_people

if TYPE_CHECKING:
    from rich.console import Console, RenderableType

    from gcs.types import JsonObject


BEGAN_S = time.perf_counter()  # this module is among the first to be imported


class Screen:
    """The output of one command."""

    def __init__(self, *, json: bool = False) -> None:
        self.json = json

    @cached_property
    def console(self) -> Console:
        """rich's console for tables, bars and live displays; plain lines where stdout is no terminal."""
        from rich.console import Console

        return Console(quiet=self.json, highlight=False, file=cast("IO[str]", _safe(sys.stdout)))

    @property
    def is_watched(self) -> bool:
        """Whether stdout is a terminal that can redraw, and text is wanted there."""
        return bool(not self.json and self.console.is_terminal and not self.console.is_dumb_terminal)

    def say(self, text: str) -> None:
        """Print one line, never wrapped or coloured, so that it can be searched and copied; nothing with `--json`."""
        if not self.json:
            _line(sys.stdout, text)

    def warn(self, text: str) -> None:
        """Print one warning line, red on a terminal: on stdout among the others, or on stderr with `--json`."""
        stream, line = sys.stderr if self.json else sys.stdout, f"WARNING: {for_people(text)}"
        colour = stream is not None and stream.isatty() and "NO_COLOR" not in os.environ
        _line(stream, f"\x1b[1;31m{line}\x1b[0m" if colour else line)

    def ask(self, question: str) -> None:
        """Print a question that you must answer to go on; on stderr with `--json`."""
        _line(sys.stderr if self.json else sys.stdout, question)

    def show(self, picture: RenderableType) -> None:
        """Print a table or another rich renderable; nothing with `--json`."""
        if not self.json:
            self.console.print(picture)

    def result(self, data: JsonObject) -> None:
        """Print the one JSON object, with `--json` only; `"ok"` is true unless `data` has another value."""
        if self.json:
            self._object({"ok": True, **data})

    def error(self, message: str, *, hint: str, kind: str, exit_code: int, folder: str | None = None) -> None:
        """Print what failed, what to do next and where it is recorded: on stderr, or as one object with `--json`."""
        if self.json:
            failure = {"kind": kind, "message": message, "hint": hint, "exit_code": exit_code}
            self._object({"ok": False, "error": failure} | ({} if folder is None else {"folder": folder}))
            return
        _line(sys.stderr, error_text(message, hint))
        if folder is not None:
            _line(sys.stderr, f"folder: {folder}")

    def failure(self, error: GcsError) -> None:
        """Print one of the errors of `gcs.errors`."""
        kind, code = type(error).__name__, error.exit_code
        self.error(error.message, hint=error.hint, kind=kind, exit_code=code, folder=error.folder)

    def ended(self, failure: GcsError | None) -> int:
        """The exit code of a command that has printed its result. Raises a failure, unless `--json` has printed it."""
        if failure is None or self.json:
            return 0 if failure is None else failure.exit_code
        raise failure

    def stopped(self, exit_code: int) -> None:
        """Print that you stopped the command."""
        if self.json:
            self.error("stopped", hint="", kind="Stopped", exit_code=exit_code)
        else:
            _line(sys.stderr, "stopped")

    @contextmanager
    def without_waiting(self) -> Iterator[None]:
        """Within the block, no line waits for a terminal that stands still: vehicles are in the air."""
        streams = [stream for stream in (sys.stdout, sys.stderr) if isinstance(stream, SafeStream)]
        with ExitStack() as stack:
            for safe in streams:
                stack.enter_context(safe.without_waiting())
            yield

    def _object(self, data: JsonObject) -> None:
        text = to_json(data)
        try:
            text.encode(getattr(sys.stdout, "encoding", None) or "utf-8")
        except UnicodeEncodeError:
            text = to_json(data, ascii_only=True)
        _line(sys.stdout, text)


def to_json(data: object, *, ascii_only: bool = False) -> str:
    """The JSON text of plain values, paths and NumPy arrays. Raises ValueError on NaN and infinity, unknown to JSON."""
    return json.dumps(data, default=_plain, allow_nan=False, ensure_ascii=ascii_only)


def _safe(stream: IO[str] | None) -> SafeStream:
    return stream if isinstance(stream, SafeStream) else SafeStream(stream)


def _line(stream: IO[str] | None, text: str) -> None:
    safe = _safe(stream)
    safe.write(text + "\n")
    safe.flush()


def _plain(value: object) -> object:
    if isinstance(value, Path):
        return str(value)
    if hasattr(value, "tolist"):  # NumPy, without importing it
        return value.tolist()
    raise TypeError(f"{type(value).__name__} has no JSON form")
