"""Every command with options and files of somebody who wishes it ill: a documented exit code, a sentence, no traceback.

Code 70 says that the program has a bug. No argument and no file reaches it.
"""

from __future__ import annotations

import json
import os
import random
import shutil
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from gcs.cli.main import run

CODES = {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12}
NUMBERS = (
    *("nan", "inf", "-inf", "1e400", "-1", "1e308", "", "9" * 5000, "٣", "0x10", " 5 "),
    *("2147483648", "99999999999999999999"),
)
WORDS = (
    "",
    "\n",
    "\0",
    "a\0b",
    "é",
    "\udcff",
    "-",
    "--",
    "[red]",
    "{}",
    "%s",
    "A" * 100_000,
    "../..",
    "nan,nan,nan",
    "0=0",
)
PLACES = (
    *(
        ".",
        "folder",
        "/dev/full",
        "/dev/zero",
        "/dev/null",
        "/proc/x",
        "/proc/self/x",
        "/proc/self/mem",
        "fifo",
        "loop",
    ),
    *("dangling", "text", "text/x", "nowhere/x", "x" * 300, "/", "", "\0", "n\udcff.plan", "n\udcff", "~", "key"),
)
LINKS = (
    *("udpin::", "udpin:x:y", "tcp:", "serial:", "udpout:127.0.0.1:0", "udpin:127.0.0.1:99999", "udpin:256.1.1.1:1"),
    *(
        "udpout:" + "a" * 300 + ":1",
        "udpin:\0:1",
        "udpin:[::1",
        "udpin:127.0.0.1:٣",
        "serial:folder",
        "http://x",
        "é:1:1",
    ),
    *("tcp:127.0.0.1:1", "serial:/dev/x:9" + "9" * 5000, "udpin:127.0.0.1:" + "9" * 5000, "serial:/dev/zero:57600"),
)
FAULTS = (
    *(
        "99:die@5",
        "1:die@nan",
        "all:loss=nan",
        "all:loss=2",
        "0:die",
        "1:delay=1e400",
        "1:stuck=gyro@5..1",
        "x",
        "²:die",
    ),
    *("1:motor=1.5", "1:wind=nan", "1:loss=", "1:die@upload:x", "1" * 5000 + ":die", "1:die@upload:-5", "1:die@inf"),
)
LISTENING = ["--link", "udpin:127.0.0.1:0", "--listen", "0.01"]


def quick() -> Iterator[list[str]]:
    """Lines that fail before anything is planned or verified."""
    for place in (*PLACES, *WORDS):
        for command in ("show", "verify", "check", "report", "attach", "replay"):
            yield [command, place]
        yield ["replan", place, "--at", "5"]
        yield ["restore", place, "--link", "udpin:127.0.0.1:0"]
        yield ["check", "a.waypoints", "--terrain", place]
        yield ["export", place, "--to", "out"]
        yield ["upload", place, "--link", "udpin:127.0.0.1:0", "--dry-run"]
        yield ["diff", place, "--link", "udpin:127.0.0.1:0"]
        yield ["fly", place, "--sim"]
        yield ["attach", "--to", place]
        yield ["vehicles", "--signing-key-file", place, *LISTENING]
    for number in NUMBERS:
        yield ["check", "a.waypoints", "--separation", number]
        yield ["replan", "hop.skein", "--at", number]
        yield ["new", "made", "--at", number, "0", "0"]
        yield ["new", "made", "--at", "0", "0", number]
        for command in (["vehicles"], ["tell", "land"], ["download", "--to", "out"]):
            yield [*command, "--listen", number, "--link", "none"]
        for option in ("--speedup", "--seed", "--gates", "--reserve", "--bogus"):
            yield ["fly", "nowhere", "--sim", option, number]
        yield ["export", "nowhere", "--to", "out", "--gates", number]
        yield ["export", "nowhere", "--to", "out", "--smooth", number]
        yield ["replay", "nowhere", "--speed", number]
    for word in (*WORDS, *NUMBERS):
        for option in ("--mode", "--on-loss", "--on-leader-loss", "--nav", "--waive", "--transfer", "--map"):
            yield ["fly", "nowhere", "--sim", option, word]
        for option in ("--format", "--autopilot", "--altitude", "--start"):
            yield ["export", "nowhere", "--to", "out", option, word]
        yield ["check", "a.waypoints", "--autopilot", word]
        yield ["check", "a.waypoints", "--timing", word]
        yield ["tell", word, *LISTENING]
        yield ["tell", "land", "--vehicles", word, "--link", "none"]
        yield ["vehicles", "--backend", word, *LISTENING]
        yield [word]
    for link in (*LINKS, *WORDS):
        for command in (["vehicles"], ["tell", "land"], ["download", "--to", "out"]):
            yield [*command, "--link", link, "--listen", "0.01"]


def thorough() -> Iterator[list[str]]:
    """Lines that plan, verify, draw or start a process first."""
    for place in PLACES:
        yield ["export", "hop.skein", "--to", place, "--format", "rally"]
        yield ["show", "hop.skein", "--picture", place]
        yield ["show", "hop.skein", "--picture", place + ".png"]
        yield ["fly", "hop.skein", "--sim", "--to", place, "--fault", "99:die"]
        yield ["download", "--to", place, *LISTENING]
        yield ["plan", "meadow", "--to", place]
        yield ["replan", "hop.skein", "--at", "5", "--to", place]
    for number in NUMBERS:
        yield ["replan", "hop.skein", "--at", "5", "--disk", f"{number},0,5"]
        yield ["replan", "hop.skein", "--at", "5", "--disk", f"0,0,{number}"]
        yield ["replan", "hop.skein", "--at", "5", "--state", f"{number},0,5"]
        yield ["export", "hop.skein", "--to", "out", "--gates", number, "--format", "plan"]
        yield ["export", "hop.skein", "--to", "out", "--smooth", number, "--format", "setpoints"]
    for fault in FAULTS:
        yield ["fly", "hop.skein", "--sim", "--fault", fault]
    for wind in ("nan@0", "3@nan", "inf@0", "3", "3@", "@", "-1@0", "1e400@0", "3@99999", "\0"):
        yield ["fly", "hop.skein", "--sim", "--wind", wind]
        yield ["fly", "hop.skein", "--sim", "--gusts", wind]


@pytest.fixture
def place(tmp_path: Path, hop_file: Path, repo_root: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with good files and bad places, as the current one."""
    shutil.copy(hop_file, tmp_path / "hop.skein")
    shutil.copy(repo_root / "missions/simulation1/expected/uav1.waypoints", tmp_path / "a.waypoints")
    (tmp_path / "folder").mkdir()
    (tmp_path / "text").write_text("no such thing")
    (tmp_path / "key").write_bytes(b"\xff" * 5)
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "dangling").symlink_to("nowhere/x")
    os.mkfifo(tmp_path / "fifo")
    (tmp_path / os.fsdecode(b"n\xff.plan")).write_text("QGC")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@contextmanager
def at_most(seconds: int, line: list[str]) -> Iterator[None]:
    """Fail when the block takes longer: it hangs."""

    def hangs(*_: object) -> None:
        raise TimeoutError(f"{line} hangs")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def ends_well(line: list[str], as_json: bool, capsys: pytest.CaptureFixture[str]) -> None:
    shown = [argument[:60] for argument in line]
    with at_most(120, shown):
        code = run([*line, "--json"] if as_json else line)
    said = capsys.readouterr()
    assert code in CODES, (shown, code, said.err, said.out)
    assert "Traceback" not in said.err, shown
    if as_json and line[0] != "schema":
        told = json.loads(said.out)
        assert "NaN" not in said.out
        assert code in {0, 11} or told["error"]["message"], shown
    elif code not in (0, 11):
        assert said.err.startswith("error: ") or "\nerror: " in said.err, (shown, said.err)


def chosen(lines: Iterator[list[str]], count: int | None, seed: int) -> list[tuple[list[str], bool]]:
    dice = random.Random(seed)
    every = list(lines)
    dice.shuffle(every)
    return [(line, dice.random() < 0.5) for line in every[:count]]


@pytest.mark.parametrize(("count", "seed"), [(25, 1), pytest.param(200, 2, marks=pytest.mark.slow)])
def test_no_argument_reaches_a_bug(place: Path, capsys: pytest.CaptureFixture[str], count: int, seed: int) -> None:
    for line, as_json in chosen(quick(), count, seed):
        ends_well(line, as_json, capsys)
    left = {path.name for path in place.iterdir()}
    assert not {name for name in left if name.startswith(".") or name in ("out", "flights")}, left


@pytest.mark.parametrize(
    ("line", "code", "words"),
    [
        pytest.param(
            ["fly", "hop.skein", "--sim", "--fault", "99:die@5"],
            2,
            "vehicle 99 is not in this mission",
            marks=pytest.mark.slow,
        ),
        (["fly", "hop.skein", "--sim", "--speedup", "inf"], 2, "--speedup inf: not a speed"),
        (["fly", "hop.skein", "--sim", "--to", "/proc/x"], 2, "/proc/x"),
        (["export", "hop.skein", "--to", "/proc/x"], 6, "/proc/"),
        (["show", "fifo"], 3, "fifo: is a pipe, not a file"),
        (["check", "/dev/zero"], 6, "/dev/zero: is a device, not a file"),
        (["verify", "folder"], 6, "folder: is a folder, not a file"),
        (["vehicles", "--listen", "inf"], 2, "--listen inf: not from 0.01 to 3600 s"),
        (["check", "a.waypoints", "--separation", "inf"], 2, "--separation inf: not from 0.001 to 1000000 m"),
    ],
)
def test_what_is_wrong_is_said_in_a_sentence(
    place: Path, line: list[str], code: int, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(line) == code
    assert words in capsys.readouterr().err
    assert not (place / "flights").exists()


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_no_argument_at_all_reaches_a_bug(place: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    for line, as_json in chosen(iter([*quick(), *thorough()]), None if seed == 0 else 300, seed):
        ends_well(line, as_json, capsys)
