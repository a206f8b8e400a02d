"""The `gcs` command: its commands, exit codes and error output.

A command is a function; its docstring is its help. Its folder is its panel in `gcs --help`.
Heavy imports are inside the function, so that `gcs --help` and mistyped arguments are answered at once (a test checks
this). A traceback is printed with `--debug` only.
"""

import difflib
import errno
import functools
import os
import re
import sys
import traceback
from collections.abc import Sequence
from typing import Annotated

import typer

from gcs.cli.flights.attach import attach
from gcs.cli.flights.fly import fly
from gcs.cli.flights.replay import replay
from gcs.cli.flights.report import report
from gcs.cli.flights.vehicles import tell, vehicles
from gcs.cli.missions.check import check
from gcs.cli.missions.download import diff, download
from gcs.cli.missions.export import export
from gcs.cli.missions.upload import restore, upload
from gcs.cli.planning.new import new, schema
from gcs.cli.planning.new_options import PlaceCommand
from gcs.cli.planning.new_vehicle import new_vehicle
from gcs.cli.planning.plan import plan, verify
from gcs.cli.planning.prove_tracks import prove
from gcs.cli.planning.replan import replan
from gcs.cli.planning.show import show
from gcs.cli.shared.console import Screen
from gcs.cli.shared.safe_stdout import install
from gcs.errors import FileFormatError, GcsError, UsageError
from gcs.util.aio import StopSignals

NAME, COMPLETING = "gcs", "_GCS_COMPLETE"
STOPPED = 130  # typer's, for every KeyboardInterrupt
OUTPUT_LOST = 1
BUG = 70
OF_FILES = frozenset(  # errors of paths and disks; all others are bugs of this program
    {
        *(errno.EACCES, errno.EDQUOT, errno.EEXIST, errno.EFBIG, errno.EINVAL, errno.EIO, errno.EISDIR, errno.ELOOP),
        *(errno.EBUSY, errno.ENAMETOOLONG, errno.ENODEV, errno.ENOENT, errno.ENOSPC, errno.ENOTDIR, errno.ENOTEMPTY),
        *(errno.ENXIO, errno.EPERM, errno.EROFS, errno.EXDEV),
    }
)
FOR_VEHICLES = {"fly", "attach", "tell", "upload", "restore"}  # what they did counts, not what they could print
EXAMPLES = """Examples:

gcs fly missions/simulation1 --sim

gcs new plans/first

gcs plan plans/first

gcs schema > scenario.schema.json"""
FIRST_STEPS = """Plan, verify and fly formations of quadrotors over MAVLink. First steps:

  gcs fly missions/simulation1 --sim    Fly six emulated vehicles and judge the flight.
  gcs new plans/first                   Write a short scenario of your own.
  gcs plan plans/first                  Plan it, verify the plan and write plans/first.skein.
  gcs show plans/first                  Show what is in it: vehicles, limits, pads.

All commands: gcs --help. One command with its options and examples: gcs plan --help."""
PANELS = {  # of `gcs --help`, by the folder of the command
    "planning": "Planning: scenarios and plans",
    "missions": "Missions: files, and what vehicles have on board",
    "flights": "Flights: vehicles and recordings",
}

app = typer.Typer(
    help="Plan, verify and fly formations of quadrotors over MAVLink.",
    epilog=EXAMPLES,
    context_settings={"help_option_names": ["-h", "--help"]},
    rich_markup_mode="markdown",  # typer's default takes `[judge]` for markup, and leaves it out
)
for _command in (
    *(new, new_vehicle, show, plan, replan, verify, prove, schema),
    *(export, check, upload, download, diff, restore),
    *(fly, attach, report, replay, vehicles, tell),
):
    _class = PlaceCommand if _command is new else None
    app.command(rich_help_panel=PANELS[_command.__module__.split(".")[2]], cls=_class)(_command)
_COMMAND = re.compile(r"No such command '([^']*)'\.")
_NUMBER = re.compile(r"Input should be a valid (number|integer)")
_TOO_MANY = re.compile(r"Got unexpected extra arguments?(?:\(s\))? \((.*)\)")


def _print_version(wanted: bool) -> None:
    if wanted:
        from importlib.metadata import version

        print(f"gcs {version('skein-gcs')}")
        raise typer.Exit


@app.callback()
def _gcs(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """Options that come before the command."""


def run(arguments: Sequence[str] | None = None) -> int:
    """The exit code of one command line (default: the process's). Every error ends as one sentence.

    Without arguments it prints the first steps.
    """
    if COMPLETING in os.environ:  # the shell asks what may follow; the words are in the environment
        app(args=[], prog_name=NAME)
    is_the_process = arguments is None
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if not is_the_process:
        return _run(arguments, StopSignals())
    streams, stops = install(), StopSignals()
    stops.listen()
    try:
        code = _run(arguments, stops)
        for safe in streams:
            safe.end()
    except KeyboardInterrupt:  # while the last lines were printed
        code = stops.exit_code
    lost = streams[0].lost
    if code == 0 and lost is not None and not set(arguments[:1]) & FOR_VEHICLES:
        code = OUTPUT_LOST
        if not isinstance(lost, BrokenPipeError):  # `gcs schema | head` is no mistake
            print(f"error: the output was not written whole: {lost}", file=sys.stderr)
    return code


_command_of = functools.cache(typer.main.get_command)  # a process may run many command lines


def _run(arguments: list[str], stops: StopSignals) -> int:
    # Read here because the arguments may be what is wrong.
    screen, debug = Screen(json="--json" in arguments), "--debug" in arguments
    try:
        if any("\0" in argument for argument in arguments):  # no path and no name has one
            raise UsageError("an argument has a NUL character", hint="leave it out")
        # Not standalone: typer then leaves the endings to the lines below. None is success.
        code = 0
        if arguments:
            code = _command_of(app)(args=arguments, prog_name=NAME, standalone_mode=False) or 0
        else:
            print(FIRST_STEPS)
    except SystemExit as ended:  # --install-completion
        code = ended.code if isinstance(ended.code, int) else 0
    except KeyboardInterrupt:
        code = STOPPED
    except typer.TyperException as error:
        code = error.exit_code
        message, hint = usage(error)
        screen.error(message, hint=hint, kind="UsageError", exit_code=code)
    except GcsError as error:
        code = error.exit_code
        _trace(debug)
        screen.failure(error)
    except OSError as error:
        code = BUG if error.errno not in OF_FILES else FileFormatError.exit_code
        _trace(debug)
        _say_os_error(screen, error, code)
    except MemoryError:
        code = OUTPUT_LOST
        _trace(debug)
        screen.error(
            "the memory of this machine is used up.",
            hint="give the command less to read, or more memory",
            kind="MemoryError",
            exit_code=code,
        )
    except Exception as error:
        code = BUG
        _trace(debug)
        _say_bug(screen, error)
    if code == STOPPED:
        code = stops.exit_code
        stops.ignore()  # a second Ctrl-C must not print a traceback
        screen.stopped(code)
    return int(code)


def _say_os_error(screen: Screen, error: OSError, code: int) -> None:
    if code == BUG:
        _say_bug(screen, error)
        return
    place = "a file" if error.filename is None else str(error.filename)
    hint = "check the path, its permissions, and the space on its disk"
    screen.error(f"{place}: {error.strerror}.", hint=hint, kind=FileFormatError.__name__, exit_code=code)


def _say_bug(screen: Screen, error: Exception) -> None:
    screen.error(
        f"a bug in this program: {type(error).__name__}: {error}",
        hint="run the same command with --debug and report its output",
        kind="Bug",
        exit_code=BUG,
    )


def _trace(wanted: bool) -> None:
    if wanted:
        traceback.print_exc()


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
