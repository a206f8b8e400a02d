"""Mistyped command lines: what is wrong in this program's words, and what to type instead."""

from __future__ import annotations

import re
from difflib import get_close_matches

import typer

_COMMAND = re.compile(r"No such command '([^']*)'\.")
_NUMBER = re.compile(r"Input should be a valid (number|integer)")
_TOO_MANY = re.compile(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)")


def usage(error: typer.TyperException) -> tuple[str, str]:
    """The sentence of a mistyped command line, and the next step."""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "gcs"
    see, text = f"see `{path} --help`", error.format_message()
    option, near = getattr(error, "option_name", None), getattr(error, "possibilities", None)
    if option is not None and near is not None:
        return f"{path} has no option {option}", f"write {near[0]}" if near else see
    if option is not None and not near:
        return text, see
    if (found := _COMMAND.match(text)) and context is not None:
        close = get_close_matches(found[1], getattr(context.command, "commands", {}), n=1)
        return f"gcs has no command {found[1]}", f"write gcs {close[0]}" if close else see
    if found := _TOO_MANY.match(text):
        return f"{path} takes no more arguments; there is also {found[1]}", see
    if found := _NUMBER.search(text):
        kind = "number" if found[1] == "number" else "whole number"
        name = _named(error)
        return f"{name}: must be a {kind}, without a unit, and with a decimal point", f"write for example {name} 5"
    return text, see


def _named(error: typer.TyperException) -> str:
    param = getattr(error, "param", None)
    names = [*getattr(param, "opts", ())]
    return str(max(names, key=len, default="the value"))
