"""The `gcs` command: its exit codes and error output.

A command is a function; its docstring is its help. Its folder is its panel in `gcs --help`.
Only the command that is called is loaded, and its heavy imports are inside the function, so that `gcs --help` and
mistyped arguments are answered at once (a test checks this). A traceback is printed with `--debug` only.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from gcs.cli.command_table import COMMANDS, FIRST_STEPS, help_text, version_text
from gcs.cli.shared.safe_stdout import SafeStream, install
from gcs.errors import FileFormatError, GcsError, UsageError

if TYPE_CHECKING:
    from gcs.cli.shared.console import Screen
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
ANSWERS: dict[tuple[str, ...], Callable[[], str]] = {  # printed without loading any command
    (): lambda: FIRST_STEPS,
    ("--help",): help_text,
    ("-h",): help_text,
    ("--version",): version_text,
}


def run(arguments: Sequence[str] | None = None) -> int:
    """The exit code of one command line (default: the process's). Every error ends as one sentence.

    Without arguments it prints the first steps.
    """
    if COMPLETING in os.environ:  # the shell asks what may follow; the words are in the environment
        from gcs.cli.command_app import app_of

        app_of()(args=[], prog_name=NAME)
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words[:2] == ["campaign", "report"]:  # a mission of that name is ./report
        words[:2] = ["campaign-report"]
    answer = ANSWERS.get(tuple(words))
    if arguments is not None:
        if answer is not None:
            return _print(answer)
        from gcs.util.aio import StopSignals

        return _run(words, StopSignals())
    streams = install()
    if answer is not None:
        code = _print(answer)
        for safe in streams:
            safe.end()
    else:
        code = _run_process(words, streams)
    lost = streams[0].lost
    if code == 0 and lost is not None and not set(words[:1]) & FOR_VEHICLES:
        code = OUTPUT_LOST
        if not isinstance(lost, BrokenPipeError):  # `gcs schema | head` is no mistake
            print(f"error: the output was not written whole: {lost}", file=sys.stderr)
    return code


def _print(answer: Callable[[], str]) -> int:
    print(answer())
    return 0


def _run_process(words: list[str], streams: Sequence[SafeStream]) -> int:
    import gcs.cli.command_app
    import gcs.cli.shared.console  # noqa: F401  before signals are heard: who stops an import is told nothing
    from gcs.util.aio import StopSignals

    stops = StopSignals()
    stops.listen()
    try:
        code = _run(words, stops)
        for safe in streams:
            safe.end()
    except KeyboardInterrupt:  # while the last lines were printed
        code = stops.exit_code
    return code


def _run(arguments: list[str], stops: StopSignals) -> int:
    from typer import TyperException

    from gcs.cli.command_app import command_of, usage
    from gcs.cli.shared.console import Screen

    # Read here because the arguments may be what is wrong.
    screen, debug = Screen(json="--json" in arguments), "--debug" in arguments
    try:
        if any("\0" in argument for argument in arguments):  # no path and no name has one
            raise UsageError("an argument has a NUL character", hint="leave it out")
        # Not standalone: typer then leaves the endings to the lines below. None is success.
        command = command_of(*(name for name in arguments[:1] if name in COMMANDS))
        code = command(args=arguments, prog_name=NAME, standalone_mode=False) or 0
    except SystemExit as ended:  # --install-completion
        code = ended.code if isinstance(ended.code, int) else 0
    except KeyboardInterrupt:
        code = STOPPED
    except TyperException as error:
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
        import traceback

        traceback.print_exc()
