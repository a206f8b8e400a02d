"""Every command with its options as a page, docs/commands.md; `tools/reference.py` writes it."""

from __future__ import annotations

import inspect
from typing import Any

import typer

from gcs.cli.main import PANELS, app
from tools.markdown import table

HEAD = """# Commands of gcs

<!-- made by tools/commands_reference.py from the commands in gcs/cli; change those -->

`gcs` alone prints the first steps, and `gcs COMMAND --help` prints what this page has. In a checkout, put
`./tools/run` before each command. Every command takes `--debug`, which prints the traceback of an error. Commands with
`--json` print one JSON object on stdout; stderr then has warnings only. The how-to lists the
[exit codes](howto.md#exit-codes). `sim-bridge` has [its own page](sim_bridge.md).

`gcs --install-completion` has your shell complete commands, options, missions, plans, flights and the words that an
option takes. `gcs` must be found on the PATH: `. .venv/bin/activate` in a checkout. Completion opens no link, so it
does not offer the vehicles on one: a port that it opened would take frames from the station that flies.

`--to` names where results go, in every command. `--out` and `-o` are its older names in `plan` and `replan`, and `--to`
is the older name of `--until` in `replay`.

Options in **bold** must be given.
"""
_EVERYWHERE = ("debug", "json", "help")


def commands_reference() -> str:
    """The page."""
    group: Any = typer.main.get_command(app)
    parts = [HEAD]
    for panel in PANELS.values():
        commands = [command for command in group.commands.values() if command.rich_help_panel == panel]
        parts.append(f"## {panel}\n")
        parts += [_command(command) for command in commands]
    return "\n".join(parts)


def _command(command: Any) -> str:
    """One command: what it does, its arguments and options, its examples."""
    text, examples = split_help(inspect.cleandoc(command.help))
    arguments = [p for p in command.params if not p.opts[0].startswith("-")]
    options = [p for p in command.params if p.opts[0].startswith("-")]
    usage = " ".join([f"gcs {command.name}", *(p.metavar for p in arguments if p.metavar)])
    rows = [_row(p) for p in (*arguments, *options) if p.name not in _EVERYWHERE]
    parts = [f"### `{usage}`", text]
    if rows:
        parts.append(table(("argument, option", "what", "if left out"), rows).rstrip())
    if not any(p.name == "json" for p in options):
        parts.append("It has no `--json`.")
    if examples:
        parts.append("```text\n" + "\n".join(examples) + "\n```")
    return "\n\n".join(parts) + "\n"


def split_help(help_text: str) -> tuple[str, list[str]]:
    """The description and the example lines of a docstring."""
    text, _, examples = help_text.partition("Example")
    lines = examples.removeprefix("s").removeprefix(":").splitlines()
    return text.strip(), [line.strip() for line in lines if line.strip()]


def _row(parameter: Any) -> tuple[str, str, str]:
    is_option = parameter.opts[0].startswith("-")
    name = ", ".join(parameter.opts) if is_option else parameter.metavar
    if is_option and not parameter.is_flag:
        name += f" {parameter.metavar or parameter.opts[0].strip('-').replace('-', '_').upper()}"
    return f"**`{name}`**" if parameter.required else f"`{name}`", parameter.help, _default(parameter)


def _default(parameter: Any) -> str:
    """The default as `--help` shows it; nothing for flags and for options without one."""
    if isinstance(parameter.show_default, str):
        return parameter.show_default
    if parameter.required or parameter.default in (None, False) or not parameter.show_default:
        return ""
    default = parameter.default
    return f"`{' '.join(map(str, default)) if isinstance(default, tuple) else default}`"
