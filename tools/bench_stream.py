"""How punctual is the setpoint stream? Six vehicles at 50 Hz, two hundred at 10 Hz, over UDP on this machine.

./tools/run python tools/bench_stream.py [--seconds 60] [--case 6x50 200x10 mavsdk6x50] [--json FILE]
                                          [--beside nothing|process|thread|loop]

A process of its own plays the vehicles: heartbeats, clocks, positions at 10 Hz each, and a socket each whose datagrams
the kernel stamps as they arrive. The ground station is `gcs.link.session.linked_fleet` with the schedule and the
messages of `gcs fly`, in another process, whose processor time is reported. `late` is arrival minus the deadline
on the vehicle's own clock (its estimate on the ground included), `interval` how far the time between two arrivals is
from the period; MAVSDK's offboard has no deadlines, its setpoints are set in time by a loop of ours. Per vehicle, all
together. With `--beside` the ground station computes the returns of missions/field again and again, as it does
in flight: in a process of its own, or for comparison in a thread or on the event loop itself.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import resource
import select
import socket
import struct
import subprocess
import sys
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from gcs.aio import ended, sleep_sharply
from gcs.autopilots.traits import Autopilot
from gcs.flight.offboard.deadlines import Grid, Scheduler
from gcs.flight.offboard.reference_trajectory import PlanReference
from gcs.flight.offboard.setpoint_messages import Streamed, send_due, wait_s
from gcs.flight.setup.own_process import in_own_process
from gcs.link.session.linked_fleet import LinkedFleet
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from gcs.mission.failsafe.rtl_altitudes import plan_returns
from gcs.mission.model import SetpointStream
from gcs.plan.planner import make_plan
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.load import load_scenario

CASES = {"6x50": (6, 50.0), "200x10": (200, 10.0), "mavsdk6x50": (6, 50.0)}
AGE_S = 100.0  # of a vehicle when the benchmark begins
TELEMETRY_HZ = 10.0
SO_TIMESTAMPNS = 35
SETTLE_S = 3.0
FIELD = Path(__file__).resolve().parents[1] / "missions" / "field"


def vehicles(count: int, port: int, seconds: float, out: Path) -> None:
    """Play `count` vehicles that call `port`; what they receive goes to a file: system id, arrival, stamp in ms."""
    boot_unix_s = time.time() - AGE_S
    codecs = [Codec(n, 1) for n in range(1, count + 1)]
    sockets = []
    for _ in codecs:
        sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        sock.bind(("127.0.0.1", 0))
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        sock.setblocking(False)
        sockets.append(sock)
    rows = {sock.fileno(): n for n, sock in enumerate(sockets)}
    poll = select.epoll()
    for sock in sockets:
        poll.register(sock, select.EPOLLIN)
    heard: list[tuple[int, float, int]] = []
    begin_s, tick = time.monotonic(), 0
    while time.monotonic() - begin_s < seconds:
        # Vehicles do not speak at once: a tenth of them every hundredth of a second.
        while time.monotonic() - begin_s >= tick / (10.0 * TELEMETRY_HZ):
            for n in range(tick % 10, count, 10):
                for message in telemetry(tick // 10, boot_unix_s):
                    sockets[n].sendto(codecs[n].encode(message), ("127.0.0.1", port))
            tick += 1
        for file, _ in poll.poll(0.001):
            n = rows[file]
            hear(sockets[n], n + 1, codecs[n], port, heard)
    np.savez(out, heard=np.array(heard, dtype=np.float64), boot_unix_s=boot_unix_s)


def hear(sock: socket.socket, sysid: int, codec: Codec, port: int, heard: list[tuple[int, float, int]]) -> None:
    """Take in what waits at one socket; commands are obeyed in word."""
    while True:
        try:
            data, ancillary, _, _ = sock.recvmsg(2048, 64)
        except BlockingIOError:
            return
        seconds, nanoseconds = struct.unpack("qq", ancillary[0][2])
        if len(data) >= 12 and int.from_bytes(data[7:10], "little") == 84:
            if data[10 + 50] != sysid:  # MAVSDK notifies every subscriber of every message
                continue
            heard.append((sysid, seconds + nanoseconds / 1e9, int.from_bytes(data[10:14], "little")))
            continue
        for message in codec.decode(data, ("127.0.0.1", port)):
            if message.name == "COMMAND_LONG" and message.fields["target_system"] in (0, sysid):
                fields = {"command": message.fields["command"], "result": 0, "target_system": message.sysid}
                sock.sendto(codec.encode(Message("COMMAND_ACK", fields)), ("127.0.0.1", port))


def telemetry(turn: int, boot_unix_s: float) -> list[Message]:
    """What one vehicle says in its `turn`-th tenth of a second."""
    now_s = time.time()
    boot_ms = round((now_s - boot_unix_s) * 1e3)
    axes = dict.fromkeys(("x", "y", "z", "vx", "vy", "vz"), 0.0)
    said = [Message("LOCAL_POSITION_NED", {"time_boot_ms": boot_ms, **axes})]
    if turn % 10 == 0:
        modes = {"base_mode": 157, "custom_mode": 6 << 16, "system_status": 4, "mavlink_version": 3}
        said.insert(0, Message("HEARTBEAT", {"type": 2, "autopilot": 12, **modes}))
    if turn % 5 == 0:
        said.append(Message("SYSTEM_TIME", {"time_unix_usec": round(now_s * 1e6), "time_boot_ms": boot_ms}))
    return said


async def compute(plan: Plan | None, beside: str) -> None:
    """Compute the returns of a plan until cancelled."""
    while plan is not None:
        work = partial(plan_returns, plan, Autopilot.PX4)
        if beside == "process":
            await in_own_process(plan_returns, plan, Autopilot.PX4)
        elif beside == "thread":
            await asyncio.to_thread(work)
        else:
            work()
            await asyncio.sleep(0.5)


async def ours(count: int, rate_hz: float, port: int, seconds: float, beside: str) -> dict[str, float]:
    """Stream to them as `gcs fly` does."""
    plan = make_plan(load_scenario(FIELD)) if beside != "nothing" else None
    async with LinkedFleet.open(f"udpin:127.0.0.1:{port}") as fleet:
        sessions = await fleet.vehicles(range(1, count + 1), 20.0)
        loop = asyncio.get_running_loop()
        while not all(s.clock.ready for s in sessions.values()):
            await asyncio.sleep(0.05)
        await asyncio.sleep(SETTLE_S)
        stream = setpoints(count, rate_hz, seconds)
        now_unix_s = max(t for s in sessions.values() if (t := s.clock.now_unix_s(loop.time())) is not None)
        grid = Grid.of(stream.t_s, rate_hz)
        scheduler = Scheduler(grid, float(np.ceil(now_unix_s + 0.5)))
        streamed = {}
        for row, (sysid, session) in enumerate(sessions.items()):
            scheduler.start(sysid, 0, len(stream.t_s))
            streamed[sysid] = Streamed(session.station, session.clock, np.zeros(3), PlanReference(stream, row))
        before = processor_s()
        began_s = loop.time()
        computing = asyncio.ensure_future(compute(plan, beside))
        while not scheduler.finished:
            send_due(scheduler, streamed.values(), lambda sysid, m: sessions[sysid].send(m), loop.time())
            await sleep_sharply(wait_s(scheduler, streamed.values(), loop.time(), 0.05))
        await ended(computing)
        took_s = loop.time() - began_s
        sent = sum(progress.sent for progress in scheduler.streams.values())
        return {"sent": sent, "asked": count * len(grid.t_s), "cpu": (processor_s() - before) / took_s}


def mavsdk_offboard(count: int, rate_hz: float, port: int, seconds: float) -> dict[str, float]:
    """The same by MAVSDK: position, velocity, acceleration, set in a loop with absolute deadlines."""
    import mavsdk  # noqa: PLC0415
    from mavsdk.plugins.offboard import AccelerationNed, Offboard, PositionNedYaw, VelocityNedYaw  # noqa: PLC0415

    configuration = mavsdk.Configuration.create_with_component_type(mavsdk.ComponentType.GROUND_STATION)
    sdk = mavsdk.Mavsdk(configuration)
    sdk.add_any_connection(f"udpin://127.0.0.1:{port}")
    while len([s for s in sdk.get_systems() if s.is_connected() and s.has_autopilot()]) < count:
        time.sleep(0.05)
    pilots = [Offboard(s) for s in sdk.get_systems()]
    numbers = PositionNedYaw(1.0, 2.0, -3.0, 0.0), VelocityNedYaw(0.1, 0.0, 0.0, 0.0), AccelerationNed(0.0, 0.1, 0.0)
    time.sleep(SETTLE_S)
    for pilot in pilots:
        pilot.set_position_velocity_acceleration_ned(*numbers)
        pilot.start()
    before, began_s = processor_s(), time.monotonic()
    steps = round(seconds * rate_hz)
    for k in range(steps):
        time.sleep(max(0.0, began_s + k / rate_hz - time.monotonic()))
        for pilot in pilots:
            pilot.set_position_velocity_acceleration_ned(*numbers)
    took_s = time.monotonic() - began_s
    used = (processor_s() - before) / took_s
    sdk.destroy()
    return {"sent": steps * count, "asked": steps * count, "cpu": used}


def setpoints(count: int, rate_hz: float, seconds: float) -> SetpointStream:
    """Anything that moves."""
    t_s = np.rint(np.arange(0, round(seconds * rate_hz)) * 1e3 / rate_hz) / 1e3
    wave = np.broadcast_to(np.stack([np.sin(t_s), np.cos(t_s), -5.0 + 0.0 * t_s], axis=-1), (count, len(t_s), 3))
    return SetpointStream(tuple(range(1, count + 1)), t_s, wave, wave, wave, np.zeros((count, len(t_s))))


def processor_s() -> float:
    """Processor time of this process."""
    used = resource.getrusage(resource.RUSAGE_SELF)
    return used.ru_utime + used.ru_stime


def measure(case: str, seconds: float, beside: str) -> dict[str, Any]:
    """Run one case and look at what arrived."""
    count, rate_hz = CASES[case]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "heard.npz"
        line = [
            sys.executable,
            __file__,
            "--vehicles",
            str(count),
            str(port),
            str(seconds + (15.0 if beside == "nothing" else 60.0)),
            str(out),
        ]
        others = subprocess.Popen(line)
        try:
            run = mavsdk_offboard if case.startswith("mavsdk") else None
            said = (
                run(count, rate_hz, port, seconds) if run else asyncio.run(ours(count, rate_hz, port, seconds, beside))
            )
            others.wait(120.0)
        finally:
            others.kill()
            others.wait()
        with np.load(out) as archive:
            heard, boot_unix_s = archive["heard"], float(archive["boot_unix_s"])
    return {"case": case, "rate_hz": rate_hz, **said, **figures(heard, boot_unix_s, rate_hz, count, seconds, case)}


def figures(
    heard: np.ndarray, boot_unix_s: float, rate_hz: float, count: int, seconds: float, case: str
) -> dict[str, float]:
    """What the arrivals say, in ms."""
    gaps, late = [], []
    for sysid in range(1, count + 1):
        mine = heard[heard[:, 0] == sysid]
        arrived = mine[:, 1]
        if case.startswith("mavsdk"):
            arrived = arrived[arrived >= arrived[-1] - seconds + 0.5]  # after the first words
        gaps.append(np.abs(np.diff(arrived) - 1.0 / rate_hz))
        late.append(arrived - (boot_unix_s + mine[-len(arrived) :, 2] / 1e3))
    interval_ms, late_ms = 1e3 * np.concatenate(gaps), 1e3 * np.concatenate(late)
    found = {"arrived": float(len(heard))}
    for name, values in (("interval", interval_ms), ("late", late_ms)):
        if name == "late" and case.startswith("mavsdk"):
            continue
        for word, figure in (("p50", np.median(values)), ("p99", np.percentile(values, 99)), ("max", values.max())):
            found[f"{name}_{word}_ms"] = float(figure)
    return found


def main() -> None:
    """Run the cases asked for and show a table."""
    if sys.argv[1:2] == ["--vehicles"]:
        vehicle_count, port, run_s, out = sys.argv[2:6]
        vehicles(int(vehicle_count), int(port), float(run_s), Path(out))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--case", nargs="+", choices=CASES, default=list(CASES))
    parser.add_argument("--beside", choices=("nothing", "process", "thread", "loop"), default="nothing")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    results = [measure(case, options.seconds, options.beside) for case in options.case]
    table = Table(
        "case", "sent", "asked", "Hz each", "interval p50/p99/max, ms", "late p50/p99/max, ms", "CPU, one core"
    )
    for r in results:
        count, _ = CASES[r["case"]]
        spread = [
            "/".join(f"{r[f'{n}_{w}_ms']:.2f}" for w in ("p50", "p99", "max")) if f"{n}_p50_ms" in r else "–"
            for n in ("interval", "late")
        ]
        rate = r["arrived"] / count / options.seconds
        table.add_row(r["case"], f"{r['sent']:.0f}", f"{r['asked']:.0f}", f"{rate:.2f}", *spread, f"{r['cpu']:.0%}")
    Console(width=140).print(table)
    if options.json:
        options.json.write_text(json.dumps(results, indent=2) + "\n")


if __name__ == "__main__":
    main()
