"""tools/run without an installation: a stand-in for Python plays venv and pip, everything else is real."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

TOOLS = ("sh", "sed", "cat", "cmp", "dirname", "mkdir", "rm", "mv", "sleep", "touch", "chmod", "printf", "kill")
# Says which Python it is, makes a venv whose python is itself, and writes down what pip is asked for.
FAKE_PYTHON = r"""#!/bin/sh
case "$*" in
"-c "*) exit ${FAKE_TOO_OLD:-0} ;;
"-m venv "*)
    [ -z "${FAKE_NO_VENV:-}" ] || exit 1
    mkdir -p "$3/bin"
    cat "$0" >"$3/bin/python"
    chmod +x "$3/bin/python" ;;
*" install "*)
    echo "$*" >>"$LOG"
    [ -z "${FAKE_PIP_FAILS:-}" ] || exit 1
    [ -z "${FAKE_SLOW:-}" ] || sleep 1 ;;
esac
"""


class Clone:
    """A fresh copy of what tools/run reads, and a PATH that holds nothing else."""

    def __init__(self, root: Path, original: Path) -> None:
        self.root = root / "a clone"  # a space, as people have them
        self.bin, self.log = root / "bin", root / "pip.log"
        (self.root / "tools").mkdir(parents=True)
        for name in ("tools/run", "requirements.lock", "pyproject.toml"):
            shutil.copy(original / name, self.root / name)
        self.bin.mkdir()
        for tool in TOOLS:
            if where := shutil.which(tool):
                (self.bin / tool).symlink_to(where)

    def python(self, name: str = "python3") -> None:
        (self.bin / name).write_text(FAKE_PYTHON)
        (self.bin / name).chmod(0o755)

    def start(self, *command: str, **environment: str) -> subprocess.Popen[str]:
        given = {"PATH": str(self.bin), "LOG": str(self.log), **environment}
        return subprocess.Popen(
            [str(self.root / "tools" / "run"), *command],
            env=given,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def run(self, *command: str, **environment: str) -> tuple[int, str, str]:
        process = self.start(*command, **environment)
        out, err = process.communicate(timeout=60)
        return process.returncode, out, err

    @property
    def installations(self) -> int:
        return self.log.read_text().count("--require-hashes") if self.log.exists() else 0


@pytest.fixture
def clone(tmp_path: Path, repo_root: Path) -> Clone:
    return Clone(tmp_path, repo_root)


def test_no_python_at_all_is_one_clear_sentence(clone: Clone) -> None:
    code, out, err = clone.run("gcs")
    assert (code, out) == (3, "")
    assert err.count("\n") == 1
    assert "Python 3.11 or newer" in err


def test_an_old_python_is_passed_over(clone: Clone) -> None:
    clone.python()
    code, _, err = clone.run("gcs", FAKE_TOO_OLD="1")
    assert code == 3
    assert "Python 3.11 or newer" in err


def test_a_newer_python_beside_it_is_found(clone: Clone) -> None:
    clone.python("python3.12")
    assert clone.run("printf", "%s-", "a b", "c")[:2] == (0, "a b-c-")


def test_no_venv_module_is_one_sentence_and_leaves_nothing(clone: Clone) -> None:
    clone.python()
    code, _, err = clone.run("gcs", FAKE_NO_VENV="1")
    assert code == 3
    assert "could not make a virtual environment" in err
    assert not list(clone.root.glob(".venv*"))


def test_it_installs_once_and_again_when_the_lock_changes(clone: Clone) -> None:
    clone.python()
    assert clone.run("printf", "x") == (0, "x", "skein: installing into .venv (once; about a minute)\n")
    assert clone.run("printf", "x") == (0, "x", "")
    assert clone.installations == 1
    with (clone.root / "requirements.lock").open("a") as lock:
        lock.write("# changed\n")
    assert clone.run("printf", "x")[0] == 0
    assert clone.installations == 2


def test_tool_settings_are_no_reason_to_install(clone: Clone) -> None:
    clone.python()
    clone.run("printf", "x")
    with (clone.root / "pyproject.toml").open("a") as project:
        project.write("\n[tool.other]\nx = 1\n")
    clone.run("printf", "x")
    assert clone.installations == 1


def test_a_moved_clone_installs_again(clone: Clone) -> None:
    clone.python()
    clone.run("printf", "x")
    clone.root = clone.root.rename(clone.root.with_name("moved"))
    clone.run("printf", "x")
    assert clone.installations == 2


def test_an_interrupted_installation_is_repaired(clone: Clone) -> None:
    clone.python()
    code, out, _ = clone.run("printf", "x", FAKE_PIP_FAILS="1")
    assert code != 0
    assert out == ""
    assert not list(clone.root.glob(".venv.busy"))
    assert clone.run("printf", "x")[:2] == (0, "x")
    (clone.root / ".venv" / ".installed").unlink()  # as a killed one leaves it
    assert clone.run("printf", "x")[:2] == (0, "x")
    assert clone.installations == 3


@pytest.mark.slow
def test_two_at_once_install_once(clone: Clone) -> None:
    clone.python()
    both = [clone.start("printf", "x", FAKE_SLOW="1") for _ in range(2)]
    assert [process.communicate(timeout=60)[0] for process in both] == ["x", "x"]
    assert clone.installations == 1


def test_a_lock_left_by_one_that_was_killed_is_taken_over(clone: Clone) -> None:
    clone.python()
    (clone.root / ".venv.busy").mkdir()
    gone = subprocess.Popen(["true"])
    gone.wait()
    (clone.root / ".venv.busy" / "pid").write_text(str(gone.pid))
    assert clone.run("printf", "x")[:2] == (0, "x")


def test_without_a_command_it_says_how(clone: Clone) -> None:
    clone.python()
    clone.run("printf", "x")
    code, out, err = clone.run()
    assert (code, out) == (2, "")
    assert err.startswith("usage: ./tools/run COMMAND")


def test_exit_codes_and_the_environment_pass_through(clone: Clone) -> None:
    clone.python()
    assert clone.run("sh", "-c", "exit 7")[0] == 7
    code, out, _ = clone.run("sh", "-c", 'printf %s "$VIRTUAL_ENV"')
    assert (code, out) == (0, str(clone.root / ".venv"))


def test_the_lock_pins_hashes_and_names_no_index(repo_root: Path) -> None:
    text = (repo_root / "requirements.lock").read_text(encoding="utf-8")
    pins = re.findall(
        r"^[A-Za-z0-9._-]+==\S+(?: ; [^\\\n]+)? \\\n(?:    --hash=sha256:[0-9a-f]{64}(?: \\)?\n)+", text, re.M
    )
    assert "".join(pins) == text
    assert "://" not in text
    assert len(pins) > 20


def test_the_script_needs_no_more_than_a_posix_shell(repo_root: Path) -> None:
    script = repo_root / "tools" / "run"
    assert script.read_text(encoding="utf-8").startswith("#!/bin/sh\n")
    assert os.access(script, os.X_OK)
