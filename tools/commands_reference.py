"""docs/commands.md, every command with its options; `tools/reference.py` writes it."""

import inspect
from typing import Any

import typer

from gcs.cli.main import PANELS, app
from tools.markdown import table

_EVERYWHERE = ("debug", "json", "help")


def commands_reference() -> str:
    """Every command, by panel."""
    group: Any = typer.main.get_command(app)
    parts: list[str] = []
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
