"""`--page`: the command prints an address, keeps the page open, and ends well at Ctrl-C."""

from __future__ import annotations

import json
import re
import signal
import subprocess
import urllib.request
from collections.abc import Sequence
from pathlib import Path

import pytest

from gcs.cli.main import run
from tests.kept import GCS
from tests.real_flights import FOLDER, unpacked

PLAN = FOLDER / "px4-1.17dev-stream" / "plan.skein"
ADDRESS = re.compile(r"http://127\.0\.0\.1:\d+/\?token=[\w-]+")


def opened(arguments: Sequence[str]) -> tuple[int, str, bytes]:
    """Exit status and output of a command that is stopped when its page answers, and what the page answered."""
    with subprocess.Popen([*GCS, *arguments], stdout=subprocess.PIPE, text=True) as command:
        assert command.stdout is not None
        lines: list[str] = []
        while not (found := ADDRESS.search("".join(lines))):
            lines.append(command.stdout.readline())
            assert lines[-1], f"it ended: {lines}"
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        opener.open(found[0]).read()
        scene = opener.open(found[0].partition("?")[0] + "scene").read()
        command.send_signal(signal.SIGINT)
        lines.append(command.stdout.read())
        return command.wait(), "".join(lines), scene


@pytest.mark.slow
def test_a_plan_has_a_page_until_ctrl_c() -> None:
    code, said, scene = opened(["show", str(PLAN), "--page"])
    assert code == 0 and "\npage: http" in said
    assert json.loads(scene)["scene"]["kind"] == "plan"


@pytest.mark.slow
def test_a_recorded_flight_has_a_page_and_json_has_its_address(tmp_path: Path) -> None:
    folder = unpacked("px4-1.17dev-stream", tmp_path)
    code, said, scene = opened(["replay", str(folder), "--page", "--json", "--until", "60"])
    assert code == 0 and ADDRESS.fullmatch(json.loads(said)["page"])
    shown = json.loads(scene)["scene"]
    assert shown["kind"] == "replay" and shown["events"][-1]["t_s"] <= 60.0


def test_a_page_and_a_picture_are_two_commands(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["replay", "flights/any", "--page", "--picture", "any.png"]) == 2
    assert "--picture and --page exclude each other" in capsys.readouterr().err


@pytest.mark.parametrize("command", [["show", str(PLAN)], ["replay", "flights/any"]])
def test_without_the_library_the_command_says_how_to_get_it(
    command: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gcs.page.page_feed.find_spec", lambda name: None)
    assert run([*command, "--page"]) == 2
    assert "pip install 'skein-gcs[page]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--page-address", "192.168.1.5"], "--page-address needs a page"),
        (["--page", "--page-control"], "--page-control is for other machines"),
        (["--page", "--page-address", "0.0.0.0"], "not an address that other machines reach"),
        (["--page", "--page-address", "127.0.0.1"], "not an address that other machines reach"),
        (["--page", "--page-address", "my-laptop"], "not an address that other machines reach"),
    ],
)
def test_a_page_is_shown_to_other_machines_only_at_an_address_of_theirs(
    options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["fly", str(PLAN), "--sim", *options]) == 2
    assert words in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--tiles", "https://a.example/{z}/{x}/{y}.png"], "--tiles needs a page"),
        (["--page", "--tiles", "https://a.example/{z}/{x}.png"], "not an address of map tiles"),
        (["--page", "--tiles", "a.example/{z}/{x}/{y}.png"], "not an address of map tiles"),
        (["--page", "--tiles", "file:///{z}/{x}/{y}.png"], "not an address of map tiles"),
        (["--page", "--tiles", "https://a.example; script-src https://b.example/{z}/{x}/{y}"], "not an address of map"),
        (["--page", "--tiles", "https://me:word@a.example/{z}/{x}/{y}.png"], "not an address of map tiles"),
    ],
)
@pytest.mark.parametrize("command", [["show", str(PLAN)], ["replay", "flights/any"], ["fly", "field", "--sim"]])
def test_a_map_comes_from_an_address_of_tiles(
    command: list[str], options: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run([*command, *options]) == 2
    assert words in capsys.readouterr().err
