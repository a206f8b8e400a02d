"""The frame of the command line: help, endings, exit codes, and what goes to which stream."""

from __future__ import annotations

import inspect
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import typer

from gcs.cli import command_app, main
from gcs.cli.command_table import COMMANDS, PANELS
from gcs.cli.main import run
from gcs.cli.shared.console import Screen, to_json
from gcs.cli.shared.shared_options import DebugOption, JsonOption
from gcs.errors import PeerTimeout, PlanningError, ScenarioError, UsageError, counted
from gcs.flight.recording.flight_state import held_folder

# typer brings pydantic itself.
HEAVY = {"numpy", "casadi", "scipy", "pymavlink", "matplotlib", "pymap3d", "filterpy", "mavsdk", "gcs.scenario.schema"}

Ending = Callable[[], None]


@pytest.fixture
def with_command(monkeypatch: pytest.MonkeyPatch) -> Callable[[Ending], None]:
    """The real frame around one command `x` that ends as given."""

    def install(ending: Ending) -> None:
        app = typer.Typer()

        @app.command()
        def x(json: JsonOption = False, debug: DebugOption = False) -> None:
            ending()

        @app.callback()
        def group() -> None:
            pass

        monkeypatch.setattr(command_app, "command_of", lambda *_names: typer.main.get_command(app))

    return install


def raises(error: BaseException) -> Ending:
    def ending() -> None:
        raise error

    return ending


def test_help_lists_every_command_and_examples(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["--help"]) == 0
    text = capsys.readouterr().out
    assert "Examples:" in text
    assert [name for name in COMMANDS if f"\n  {name} " not in text] == []


def test_the_help_has_a_panel_for_each_room_of_commands(capsys: pytest.CaptureFixture[str], repo_root: Path) -> None:
    rooms = [path.parent.name for path in (repo_root / "gcs" / "cli").glob("*/__init__.py")]
    assert sorted([*PANELS, "shared"]) == sorted(rooms)
    assert main.run(["--help"]) == 0
    parts = capsys.readouterr().out.split("\n\n")
    for row in COMMANDS.values():
        (part,) = (part for part in parts if part.startswith(PANELS[row.module.split(".")[2]]))
        assert f"\n  {row.name} " in part


def test_the_table_says_what_the_commands_say_of_themselves() -> None:
    for command in command_app.app_of().registered_commands:
        assert command.callback is not None and command.name is not None
        row = COMMANDS[command.name]
        assert (inspect.getdoc(command.callback) or "").splitlines()[0] == row.summary
        assert command.callback.__module__ == row.module


def test_help_looks_the_same_beside_other_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["--help"]) == 0
    alone = capsys.readouterr().out
    assert main.run(["--help", "plan"]) == 0
    assert capsys.readouterr().out.rstrip() == alone.rstrip()


def test_help_keeps_what_stands_in_brackets(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Paragraphs and options may name tables of the scenario, as `[judge]`."""
    app = command_app.app_of.__wrapped__("fly")
    monkeypatch.setattr(app.registered_commands[0], "help", "It is held to [judge].")
    monkeypatch.setattr(command_app, "command_of", lambda *_names: typer.main.get_command(app))
    assert main.run(["fly", "--help"]) == 0
    text = " ".join(capsys.readouterr().out.replace("│", " ").split())
    assert "It is held to [judge]." in text
    assert "light (0.5 m/s), moderate (1 m/s), severe (2 m/s)" in text


def test_gcs_alone_shows_the_first_steps(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run([]) == 0
    out, err = capsys.readouterr()
    steps = [line.split() for line in out.splitlines() if line.startswith("  gcs ")]
    assert 3 <= len(steps) <= 4
    assert {step[1] for step in steps} <= set(COMMANDS)
    assert "gcs --help" in out
    assert err == ""


def test_help_and_mistyped_arguments_load_nothing_heavy() -> None:
    for arguments in ([], ["--help"], ["schema", "--nonsense"], ["schema", "--help"], ["nonsense"]):
        code = (
            f"import sys; from gcs.cli.main import run; run({arguments!r}); "
            f"sys.exit(' '.join({HEAVY!r} & set(sys.modules)) or 0)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{arguments}: {done.stderr}"


def test_help_and_version_load_no_parser_of_command_lines() -> None:
    """They are what a newcomer types first: 0.1 s instead of 0.8 s."""
    for arguments in ([], ["--help"], ["-h"], ["--version"]):
        code = (
            f"import sys; sys.argv[1:] = {arguments!r}; from gcs.cli.main import run; code = run(); "
            "sys.exit(code or ' '.join({'typer', 'rich', 'asyncio', 'dataclasses'} & set(sys.modules)) or 0)"
        )
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{arguments}: {done.stderr}"


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["--version"]) == 0
    assert capsys.readouterr().out.startswith("gcs 0.")


@pytest.mark.parametrize("arguments", [["nonsense"], ["schema", "--nonsense"], ["schema", "extra"]])
def test_usage_errors_are_a_sentence_and_a_next_step(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    first, second = err.splitlines()
    assert first.startswith("error: ")
    assert second.startswith("next: see `gcs")


@pytest.mark.parametrize(
    ("error", "code"), [(ScenarioError("broken", hint="mend it"), 3), (PeerTimeout("silent", hint="mend it"), 8)]
)
def test_our_errors_end_with_their_code(
    with_command: Callable[[Ending], None], error: BaseException, code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    with_command(raises(error))
    assert main.run(["x"]) == code
    assert capsys.readouterr() == ("", f"error: {error}\nnext: mend it\n")
    assert main.run(["x", "--json"]) == code
    out, err = capsys.readouterr()
    assert json.loads(out) == {
        "ok": False,
        "error": {"kind": type(error).__name__, "message": str(error), "hint": "mend it", "exit_code": code},
    }
    assert err == ""
    assert main.run(["x", "--debug"]) == code
    assert "Traceback" in capsys.readouterr().err


def test_an_error_in_a_flight_names_its_folder_in_both_forms(
    with_command: Callable[[Ending], None], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def ending() -> None:
        with held_folder(tmp_path):
            raise PeerTimeout("silent", hint="mend it")

    with_command(ending)
    assert main.run(["x"]) == 8
    assert capsys.readouterr() == ("", f"error: silent\nnext: mend it\nfolder: {tmp_path}\n")
    assert main.run(["x", "--json"]) == 8
    assert json.loads(capsys.readouterr().out)["folder"] == str(tmp_path)


def test_no_help_has_words_in_brackets_which_its_screen_would_leave_out() -> None:
    every = command_app.command_of()
    assert isinstance(every, typer.core.TyperGroup)
    for name, command in every.commands.items():
        texts = [command.help or "", *(getattr(option, "help", None) or "" for option in command.params)]
        assert [text for text in texts if re.search(r"\[[a-z]", text)] == [], name


def test_a_bug_asks_for_a_report(with_command: Callable[[Ending], None], capsys: pytest.CaptureFixture[str]) -> None:
    with_command(raises(ZeroDivisionError("by zero")))
    assert main.run(["x"]) == 70
    assert capsys.readouterr().err == (
        "error: a bug in this program: ZeroDivisionError: by zero\n"
        "next: run the same command with --debug and report its output\n"
    )
    assert main.run(["x", "--debug"]) == 70
    assert "Traceback" in capsys.readouterr().err


def test_ctrl_c_says_stopped(with_command: Callable[[Ending], None], capsys: pytest.CaptureFixture[str]) -> None:
    with_command(raises(KeyboardInterrupt()))
    assert main.run(["x"]) == 130
    assert capsys.readouterr() == ("", "stopped\n")
    assert main.run(["x", "--json"]) == 130
    assert json.loads(capsys.readouterr().out)["error"]["kind"] == "Stopped"


def test_usage_errors_are_json_too(capsys: pytest.CaptureFixture[str]) -> None:
    assert main.run(["nonsense", "--json"]) == 2
    out, err = capsys.readouterr()
    assert json.loads(out)["error"]["kind"] == "UsageError"
    assert err == ""


def test_python_m_gcs_is_gcs() -> None:
    done = subprocess.run([sys.executable, "-m", "gcs", "plam"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert done.stderr == "error: gcs has no command plam\nnext: write gcs plan\n"


def test_a_reader_that_leaves_early_ends_it_quietly() -> None:
    """`gcs schema | head -1`: the pipe's end is closed before anything is written."""
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(
        [sys.executable, "-c", "import sys; from gcs.cli.main import run; sys.exit(run(['schema']))"],
        stdout=write,
        stderr=subprocess.PIPE,
        check=False,
    )
    os.close(write)
    assert (done.returncode, done.stderr) == (1, b"")


def test_screen_keeps_stdout_for_the_object(capsys: pytest.CaptureFixture[str]) -> None:
    screen = Screen(json=True)
    screen.say("planning [0, 1] " + "x" * 200)
    screen.show("table")
    screen.warn("a limit is near")
    screen.result({"path": Path("a"), "worst_m": 0.5})
    out, err = capsys.readouterr()
    assert json.loads(out) == {"ok": True, "path": "a", "worst_m": 0.5}
    assert err == "WARNING: a limit is near\n"
    assert not screen.is_watched


def test_screen_speaks_plainly_to_people(capsys: pytest.CaptureFixture[str]) -> None:
    screen = Screen()
    screen.say("height [red] " + "y" * 200)
    screen.warn("a limit is near")
    screen.result({"worst_m": 0.5})
    assert capsys.readouterr() == ("height [red] " + "y" * 200 + "\nWARNING: a limit is near\n", "")
    assert not screen.is_watched


def test_json_has_arrays_and_no_nan() -> None:
    import numpy as np

    assert to_json({"a": np.arange(3), "b": np.float64(0.5), "c": "ü"}) == '{"a": [0, 1, 2], "b": 0.5, "c": "ü"}'
    with pytest.raises(ValueError, match="not JSON compliant"):
        to_json(float("nan"))
    with pytest.raises(TypeError, match="object has no JSON form"):
        to_json(object())


@pytest.mark.parametrize(
    ("typed", "says", "then"),
    [
        ("plam missions/field", "gcs has no command plam", "write gcs plan"),
        ("plan missions/field --outt x", "gcs plan has no option --outt", "write --out"),
        ("schema --x", "gcs schema has no option --x", "see `gcs schema --help`"),
        (
            "check a.plan --separation 5m",
            "--separation: must be a number, without a unit",
            "write for example --separat",
        ),
        ("check a.plan --separation 5,5", "--separation: must be a number", "write for example --separation 5"),
        ("new plans/x --count six", "--count: must be a whole number", "write for example --count 5"),
        (
            "schema me",
            "gcs schema takes no more arguments; there is also me",
            "see `gcs schema --help`",
        ),
        ("plan", "Missing argument 'MISSION'.", "see `gcs plan --help`"),
    ],
)
def test_one_sentence_and_what_to_type(typed: str, says: str, then: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(typed.split()) == 2
    error, hint = capsys.readouterr().err.splitlines()
    assert error.startswith(f"error: {says}")
    assert hint.startswith(f"next: {then}")


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("1.388888889 m/s is too slow", "1.389 m/s is too slow"),
        ("-0.00012345 m of 20.50000 m", "-0.000123 m of 20.5 m"),
        ("0.0203 deg/s at 47.3977421 north", "0.0203 deg/s at 47.3977421 north"),
        ("v1.23456 m.plan/12.34567.bin", "v1.23456 m.plan/12.34567.bin"),
    ],
)
def test_quantities_have_three_digits_after_the_point(text: str, shown: str) -> None:
    error = PlanningError(text, hint=text)
    assert (error.message, error.hint, str(error)) == (shown, shown, shown)


def test_one_is_singular() -> None:
    assert [counted(n, "vehicle") for n in (0, 1, 2)] == ["0 vehicles", "1 vehicle", "2 vehicles"]
    assert counted(2, "vehicle has its", "vehicles have their") == "2 vehicles have their"
    assert UsageError("x").exit_code == 2
