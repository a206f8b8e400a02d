"""Work in a process of its own: its result, its failures, and that nothing of it is left behind."""

from __future__ import annotations

import ast
import asyncio
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from gcs.errors import ScenarioError
from gcs.flight.setup.own_process import OwnProcessEnded, in_own_process

ROOT = Path(__file__).resolve().parents[4]
# Functions that compute for longer than a setpoint may be late. Coroutines hand them over.
HEAVY = {
    *("build_loads", "build_missions", "build_safety", "build_stream", "export", "make_missions", "make_plan"),
    *("plan_returns", "replan", "run_all", "verify"),
}


def refuse(text: str) -> None:
    raise ScenarioError(text, hint="mend it")


def print_and_return(value: int) -> int:
    print("a library prints where the result goes")
    return value


def survive_sigterm(value: int) -> int:
    os.kill(os.getpid(), signal.SIGTERM)
    return value


def exit_at_once() -> None:
    os._exit(0)


def write_pid_and_stay(path: str) -> None:
    Path(path).write_text(str(os.getpid()))
    time.sleep(600.0)


def test_the_result_comes_from_another_process() -> None:
    assert asyncio.run(in_own_process(os.getpid)) != os.getpid()


def test_what_the_work_prints_is_not_its_result() -> None:
    assert asyncio.run(in_own_process(print_and_return, 7)) == 7


def test_an_error_arrives_with_its_hint() -> None:
    with pytest.raises(ScenarioError, match="too steep") as caught:
        asyncio.run(in_own_process(refuse, "too steep"))
    assert caught.value.hint == "mend it"


def test_a_process_that_ends_early_is_an_error_and_not_a_wait() -> None:
    with pytest.raises(OwnProcessEnded, match="exit_at_once"):
        asyncio.run(in_own_process(exit_at_once))


def is_alive(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    return stat.exists() and stat.read_text().rpartition(")")[2].split()[0] != "Z"


def test_the_process_ends_with_a_cancelled_caller(tmp_path: Path) -> None:
    note = tmp_path / "pid"

    async def cancelled() -> None:
        task = asyncio.ensure_future(in_own_process(write_pid_and_stay, str(note)))
        while not note.is_file() or not note.read_text():
            await asyncio.sleep(0.02)
        task.cancel()
        await asyncio.gather(task, return_exceptions=True)

    asyncio.run(cancelled())
    assert not is_alive(int(note.read_text()))


def test_the_process_ends_with_a_killed_caller(tmp_path: Path) -> None:
    note = tmp_path / "pid"
    code = (
        "import asyncio; from tests.unit.flight.setup.test_own_process import write_pid_and_stay;"
        "from gcs.flight.setup.own_process import in_own_process;"
        f"asyncio.run(in_own_process(write_pid_and_stay, {str(note)!r}))"
    )
    caller = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT)
    end_s = time.monotonic() + 60.0
    while not note.is_file() or not note.read_text():
        assert time.monotonic() < end_s
        time.sleep(0.02)
    caller.send_signal(signal.SIGKILL)
    caller.wait()
    while is_alive(int(note.read_text())):
        assert time.monotonic() < end_s
        time.sleep(0.02)


def heavy_calls(path: Path, root: Path = ROOT) -> list[str]:
    """Calls of heavy functions in coroutines of a file, those that a plain function of the file makes included."""
    tree = ast.parse(path.read_text())
    functions = {n.name: n for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}

    def called(node: ast.AST, seen: frozenset[str]) -> list[str]:
        found = []
        for call in ast.walk(node):
            if not isinstance(call, ast.Call):
                continue
            name = call.func.id if isinstance(call.func, ast.Name) else ""
            if name in HEAVY:
                found.append(f"{path.relative_to(root)}:{call.lineno}: {name}")
            elif name in functions and name not in seen:
                found += called(functions[name], seen | {name})
        return found

    coroutines = [n for n in ast.walk(tree) if isinstance(n, ast.AsyncFunctionDef)]
    return [line for coroutine in coroutines for line in called(coroutine, frozenset())]


def test_no_coroutine_computes_for_long() -> None:
    files = [path for room in ("flight", "link", "cli") for path in (ROOT / "gcs" / room).rglob("*.py")]
    assert len(files) > 50
    assert [line for path in files for line in heavy_calls(path)] == []


def test_a_coroutine_that_computes_is_found(tmp_path: Path) -> None:
    sample = tmp_path / "sample.py"
    sample.write_text("def _inner(p):\n    return plan_returns(p)\n\nasync def fly(p):\n    return _inner(p)\n")
    assert heavy_calls(sample, tmp_path) == ["sample.py:2: plan_returns"]


def test_a_signal_to_all_processes_of_a_service_leaves_the_end_to_the_caller() -> None:
    assert asyncio.run(in_own_process(survive_sigterm, 3)) == 3
