"""The house keeps its plan: who may import whom, what every file opens with, and how long it may grow."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
LEAVES = {"gcs.aio", "gcs.errors", "gcs.files", "gcs.frames", "gcs.mavlink", "gcs.physics", "gcs.autopilots"}
LAYERS = ("scenario", "plan", "mission", "link", "flight", "cli")
# `plan` and `link` never meet, save in `flight`.
FORBIDDEN = {("link", "plan"), ("link", "scenario")}
BRIDGE_MAY = LEAVES | {"gcs.scenario", "gcs.link", "gcs.mission.model"}
LONGEST = 400

Import = tuple[str, bool]


def modules(*folders: str) -> list[Path]:
    return sorted(file.relative_to(ROOT) for folder in folders for file in (ROOT / folder).rglob("*.py"))


def name_of(file: Path) -> str:
    return ".".join(file.with_suffix("").parts).removesuffix(".__init__")


def imports(file: Path) -> Iterator[str]:
    """Every module imported anywhere in the file; `from a import b` counts as a.b where that is a module."""
    package = name_of(file).split(".") if file.name == "__init__.py" else name_of(file).split(".")[:-1]
    for node in ast.walk(ast.parse((ROOT / file).read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = (
                ".".join([*package[: len(package) + 1 - node.level], node.module or ""]) if node.level else node.module
            )
            assert base is not None
            base = base.rstrip(".")
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                yield inner if is_module(inner) else base


def is_module(name: str) -> bool:
    path = ROOT / Path(*name.split("."))
    return path.is_dir() or path.with_suffix(".py").is_file()


def within(name: str, package: str) -> bool:
    return name == package or name.startswith(f"{package}.")


def is_leaf(name: str) -> bool:
    return any(within(name, leaf) for leaf in LEAVES)


GCS, BRIDGE = modules("gcs"), modules("sim_bridge")


def test_the_files_are_found() -> None:
    assert Path("gcs/physics/quadrotor.py") in GCS
    assert "gcs.physics.quadrotor" in set(imports(Path("gcs/scenario/environment/terrain.py")))


@pytest.mark.parametrize("file", GCS, ids=str)
def test_a_layer_knows_itself_those_to_its_left_and_the_leaves(file: Path) -> None:
    ours = name_of(file)
    known = {name for name in imports(file) if within(name, "gcs") and not is_leaf(name)} - {"gcs"}
    if is_leaf(ours):
        assert not known, f"{ours} is a leaf"
        return
    if ours == "gcs":
        return  # the public face may show any room
    layer = ours.split(".")[1]
    assert layer in LAYERS, f"{ours} is in no layer: name it in {Path(__file__).name}"
    allowed = LAYERS[: LAYERS.index(layer) + 1]
    for name in known:
        other = name.split(".")[1]
        assert other in allowed, f"{ours} imports {name}, to its right"
        assert (layer, other) not in FORBIDDEN, f"{ours} imports {name}"


@pytest.mark.parametrize("file", GCS, ids=str)
def test_the_ground_station_does_not_know_the_emulated_vehicles(file: Path) -> None:
    assert not [name for name in imports(file) if within(name, "sim_bridge")]


@pytest.mark.parametrize("file", BRIDGE, ids=str)
def test_the_emulated_vehicles_know_physics_and_the_link_only(file: Path) -> None:
    for name in imports(file):
        if within(name, "gcs"):
            assert any(within(name, room) for room in BRIDGE_MAY), f"{name_of(file)} imports {name}"


@pytest.mark.parametrize("file", [*GCS, *BRIDGE], ids=str)
def test_casadi_lives_in_the_planner_and_pymavlink_in_the_codec(file: Path) -> None:
    names = set(imports(file))
    if not within(name_of(file), "gcs.plan"):
        assert not [name for name in names if within(name, "casadi")]
    if name_of(file) != "gcs.link.wire.codec":
        assert not [name for name in names if within(name, "pymavlink")]
    if not within(name_of(file), "gcs.link.mavsdk"):
        assert not [name for name in names if within(name, "mavsdk")]


@pytest.mark.parametrize("file", modules("gcs", "sim_bridge", "tools"), ids=str)
def test_a_module_opens_by_saying_what_it_is_and_stays_short(file: Path) -> None:
    text = (ROOT / file).read_text(encoding="utf-8")
    assert ast.get_docstring(ast.parse(text)) or not text.strip(), f"{file} has no docstring"
    assert len(text.splitlines()) <= LONGEST, f"{file} is longer than {LONGEST} lines: two ideas?"


@pytest.mark.parametrize("room", ("microservices", "mission_protocol", "ftp"))
def test_a_machine_of_the_link_has_no_clock_no_socket_and_no_sleep(room: str) -> None:
    """The protocol machines are told the time; only endpoints touch the world."""
    machines = modules(f"gcs/link/{room}")
    assert machines
    for file in machines:
        assert not {"time", "socket", "asyncio", "threading", "select", "random"} & set(imports(file)), file
