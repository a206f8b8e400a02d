"""Starts `sim-bridge` with a flight and stops it at the flight's end.

The process reads a pipe from its parent and stops when that closes, so it never outlives its parent. Station and
vehicles share one time (`LockstepEndpoint`), which begins at the same instant in every flight: the same plan, seed,
wind and faults are the same flight to the last bit.
"""

from __future__ import annotations

import asyncio
import os
import signal
import socket
import subprocess
import sys
import tempfile
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

from gcs.errors import LinkError, UsageError, read_error_text
from gcs.flight.contingency.choices import NavigatorChoice
from gcs.link.endpoints.lockstep_endpoint import LockstepEndpoint
from gcs.scenario.schema.scenario import Scenario

EPOCH_UNIX_S = 1_767_268_800  # 2026-01-01 12:00 UTC: at noon no mission waits across midnight
_START_TIMEOUT_S = 600.0  # at the lowest priority beside other work it takes minutes; a process that fails ends at once
_STOP_TIMEOUT_S = 10.0


@dataclass(frozen=True)
class Emulated:
    """How vehicles are emulated in a flight without a link: the options of `sim-bridge`."""

    speedup: str = "10"
    seed: int = 0
    faults: tuple[str, ...] = ()
    wind: str | None = None  # SPEED@FROM; None: the scenario's
    gusts: str | None = None


@dataclass(frozen=True)
class SimulatorOptions:
    """The options of `sim-bridge` for one flight."""

    scenario: Path
    emulated: Emulated
    log: Path = Path(os.devnull)  # its stderr
    truth: Path | None = None
    navigator: NavigatorChoice = NavigatorChoice.IDEAL


def refuse_wrong_options(scenario: Scenario, emulated: Emulated) -> None:
    """Have the simulator read its own options before anything is planned or written. Raises UsageError."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "scenario.json"
        file.write_text(scenario.model_dump_json())
        line = _command_line(SimulatorOptions(file, emulated))
        try:
            done = subprocess.run(
                [*line, "--check"], stdin=subprocess.DEVNULL, capture_output=True, timeout=_START_TIMEOUT_S, check=False
            )
        except subprocess.TimeoutExpired:
            raise _started_late() from None
    if done.returncode != 0:
        raise _refused(done.returncode, done.stderr.decode(errors="replace"))


def _started_late() -> LinkError:
    return LinkError(
        f"the simulator did not start within {_START_TIMEOUT_S:g} s.",
        hint="free the machine's processors, then fly again",
    )


def _refused(code: int | None, said: str) -> UsageError | LinkError:
    if code != UsageError.exit_code:
        return LinkError(f"the simulator did not start: {said.strip() or f'exit code {code}, no message'}")
    message, hint = read_error_text(said)
    return UsageError(message, hint=hint)


@asynccontextmanager
async def simulator(options: SimulatorOptions) -> AsyncIterator[LockstepEndpoint]:
    """Yield the link to the vehicles; the file of true states is written when the block ends.

    Raises LinkError with the process's stderr when it does not start.
    """
    ours, theirs = socket.socketpair()
    with ours:
        with theirs, options.log.open("wb") as log:
            process = await asyncio.create_subprocess_exec(
                *_command_line(options),
                *("--link", f"lockstep:{theirs.fileno()}"),
                pass_fds=(theirs.fileno(),),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                stderr=log,
                start_new_session=True,  # Ctrl-C is ours to handle: the vehicles land first
            )
        try:
            line = b""
            if process.stdout is not None:
                try:
                    async with asyncio.timeout(_START_TIMEOUT_S):
                        line = await process.stdout.readline()
                except TimeoutError:
                    raise _started_late() from None
            if not line:
                await process.wait()
                said = options.log.read_text(errors="replace").strip() if options.log.is_file() else ""
                raise _refused(process.returncode, said)
            yield LockstepEndpoint(ours)
        finally:
            await _stop(process)


def _command_line(options: SimulatorOptions) -> list[str]:
    how = options.emulated
    line = [sys.executable, "-m", "sim_bridge", os.fspath(options.scenario), "--epoch", str(EPOCH_UNIX_S)]
    line += ["--speedup", how.speedup, "--seed", str(how.seed), "--nav", options.navigator, "--until-eof"]
    given = [("--truth", options.truth), ("--wind", how.wind), ("--gusts", how.gusts)]
    for name, value in (*given, *(("--fault", fault) for fault in how.faults)):
        line += [name, os.fspath(value)] if value is not None else []
    return line


async def _stop(process: asyncio.subprocess.Process) -> None:
    if process.returncode is None:
        with suppress(ProcessLookupError):
            process.send_signal(signal.SIGTERM)
    try:
        async with asyncio.timeout(_STOP_TIMEOUT_S):
            await process.communicate()
    except TimeoutError:
        with suppress(ProcessLookupError):
            process.kill()
        await process.wait()
