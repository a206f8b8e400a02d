"""The commands of `gcs` as typer has them, and the sentences of mistyped command lines."""

from __future__ import annotations

import difflib
import functools
import re
from importlib import import_module
from typing import Annotated, Any

import typer

from gcs.cli.command_table import COMMANDS, EXAMPLES, SUMMARY, help_text, version_text

_COMMAND = re.compile(r"No such command '([^']*)'\.")
_NUMBER = re.compile(r"Input should be a valid (number|integer)")
_TOO_MANY = re.compile(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)")


class CommandGroup(typer.core.TyperGroup):
    """`gcs` itself: its help is the text that is printed without loading any command."""

    def format_help(self, ctx: Any, formatter: Any) -> None:
        """Write the help, whatever other options are given with --help."""
        print(help_text())


@functools.cache  # a process may run many command lines
def app_of(*names: str) -> typer.Typer:
    """The commands of these names; without any, all."""
    app = typer.Typer(
        cls=CommandGroup,
        help=SUMMARY,
        epilog="Examples:\n\n" + "\n\n".join(EXAMPLES),
        context_settings={"help_option_names": ["-h", "--help"]},
        rich_markup_mode="markdown",  # typer's default takes `[judge]` for markup, and leaves it out
    )
    app.callback()(_gcs)
    for row in COMMANDS.values():
        if not names or row.name in names:
            command = getattr(import_module(row.module), row.name.replace("-", "_"))
            app.command(row.name, rich_help_panel=row.panel, cls=_class_of(row.name))(command)
    return app


@functools.cache
def command_of(*names: str) -> Any:
    """The commands of these names, or all, to be called with arguments."""
    return typer.main.get_command(app_of(*names))


def _class_of(name: str) -> type[typer.core.TyperCommand] | None:
    if name != "new":
        return None
    from gcs.cli.planning.new_options import PlaceCommand

    return PlaceCommand


def _print_version(wanted: bool) -> None:
    if wanted:
        print(version_text())
        raise typer.Exit


def _gcs(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and commit.")
    ] = False,
) -> None:
    """Options that come before the command."""


def usage(error: typer.TyperException) -> tuple[str, str]:
    """The sentence of a mistyped command line, and the next step."""
    context = getattr(error, "ctx", None)
    path = context.command_path if context else "gcs"
    see, text = f"see `{path} --help`", error.format_message()
    option, near = getattr(error, "option_name", None), getattr(error, "possibilities", None)
    if option is not None and near is not None:
        best = difflib.get_close_matches(option, near, n=1, cutoff=0.0)
        return f"{path} has no option {option}", f"write {best[0]}" if best else see
    if option is not None and not near:
        return text, see
    if (found := _COMMAND.match(text)) and context is not None:
        close = difflib.get_close_matches(found[1], getattr(context.command, "commands", {}), n=1)
        return f"gcs has no command {found[1]}", f"write gcs {close[0]}" if close else see
    if found := _TOO_MANY.match(text):
        return f"{path} takes no more arguments; there is also {found[1]}", see
    if found := _NUMBER.search(text):
        kind = "number" if found[1] == "number" else "whole number"
        param = getattr(error, "param", None)
        names = [*getattr(param, "opts", ())]
        name = str(max(names, key=len, default="the value"))
        return f"{name}: must be a {kind}, without a unit, and with a decimal point", f"write for example {name} 5"
    return text, see
