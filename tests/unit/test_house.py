"""The structure of the code: what each folder may import, how large files may grow, and where libraries are known.

Every rule names folders; a folder that does not exist fails, so that a rename cannot turn a rule off.
"""

from __future__ import annotations

import ast
import re
from collections import Counter
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

from gcs.cli.command_table import COMMANDS
from tools.house import imports, imports_between_folders, modules, name_of, ours, parsed, path_of

ROOT = Path(__file__).resolve().parents[2]
LEAVES = (
    "gcs/errors.py",
    "gcs/frames.py",
    "gcs/mavlink.py",
    "gcs/mavlink_names.py",
    "gcs/physics",
    "gcs/util",
    "gcs/types.py",
)
LAYERS = (
    "gcs/autopilots",
    "gcs/scenario",
    "gcs/plan",
    "gcs/mission",
    "gcs/link",
    "gcs/flight",
    "gcs/campaign",
    "gcs/page",
    "gcs/cli",
)
# `plan` and `link` never meet, save in `flight`.
FORBIDDEN = {("gcs/link", "gcs/plan"), ("gcs/link", "gcs/scenario")}
BRIDGE_MAY = (*LEAVES, "gcs/autopilots", "gcs/scenario", "gcs/link", "gcs/mission/model.py")
# One library, one place: everybody else asks that place.
ONLY_IN = {
    "casadi": "gcs/plan",
    "pymavlink": "gcs/link/wire/codec.py",
    "mavsdk": "gcs/link/session",
    "nicegui": "gcs/page",
    "dask": "gcs/campaign/campaign_cluster.py",
    "distributed": "gcs/campaign",
}
# State machines and formulas: time is an argument, seeds are injected, bytes are handed over.
SANS_IO = (
    "gcs/autopilots",
    "gcs/flight/contingency/climb_watch.py",
    "gcs/flight/contingency/conflict_prediction.py",
    "gcs/flight/contingency/decisions.py",
    "gcs/flight/contingency/detection.py",
    "gcs/flight/contingency/energy_choice.py",
    "gcs/flight/contingency/manoeuvres.py",
    "gcs/flight/contingency/mode_changes.py",
    "gcs/flight/contingency/order_book.py",
    "gcs/flight/contingency/policy.py",
    "gcs/flight/contingency/policy_rows.py",
    "gcs/flight/execution/leader_follower.py",
    "gcs/flight/execution/setpoint_schedule.py",
    "gcs/link/protocols",
    "gcs/link/session/routing_table.py",
    "gcs/link/session/unknown_systems.py",
    "gcs/link/wire/codec.py",
    "gcs/link/wire/frame_scanner.py",
    "gcs/link/wire/message.py",
    "gcs/link/wire/signing.py",
    "gcs/mavlink.py",
    "gcs/mission",
    "gcs/physics",
    "sim_bridge/autopilot",
    "sim_bridge/dynamics",
    "sim_bridge/faults",
    "sim_bridge/missions",
    "sim_bridge/personality",
    "sim_bridge/protocol/telemetry",
)
OUTSIDE_WORLD = {"time", "socket", "asyncio", "threading", "select", "random"}
LONGEST = 400
HELD_MIN = 3  # modules and folders that a folder holds
DEPTH_MAX = 3  # folders below gcs and sim_bridge
# Files of one name in several folders, where it means the same thing in each.
SAME_SENSE = {
    "__main__.py": "`python -m` of the package",
    "export.py": "the command calls the function",
    "plan.py": "the command makes the value",
}


ARGUMENTS_MAX = 7
# Keywords of the public API, which stay as they are; each body makes one value of them at once. A command has an
# argument for each option, because typer reads them from its signature.
MANY_ARGUMENTS = {"gcs/mission/export/export.py: export", "gcs/flight/run.py: fly", "sim_bridge/fleet.py: __init__"}
# Objects of libraries, which are set up by their attributes; ours are changed by their own methods. An error on its way
# is told where it happened.
SET_FROM_OUTSIDE = {
    "gcs/campaign/campaign_cluster.py": "a worker's nanny of Dask",
    "gcs/campaign/campaign_flight.py": "threading.Timer",
    "gcs/cli/flights/replay_view.py": "a table of rich",
    "gcs/cli/shared/safe_stdout.py": "the streams of the process",
    "gcs/flight/assessment/criterion.py": "a member of an Enum, in its __new__",
    "gcs/flight/recording/flight_state.py": "an error of a flight",
    "gcs/link/wire/codec.py": "the encoder of pymavlink",
    "gcs/mavlink.py": "a member of an Enum, in its __new__",
    "gcs/mission/formats/maps/kml.py": "documents of simplekml",
    "gcs/mission/formats/skyc.py": "zipfile.ZipInfo",
    "gcs/util/bounded_xml.py": "the parser of expat",
}


def within(file: Path, *places: str) -> bool:
    return any(file == Path(place) or Path(place) in file.parents for place in places)


GCS, BRIDGE = modules("gcs"), modules("sim_bridge")
ALL = [*GCS, *BRIDGE]
FOLDERS = sorted({file.parent for file in ALL})


def test_every_file_and_folder_named_here_exists() -> None:
    modules(*LEAVES, *LAYERS, *BRIDGE_MAY, *ONLY_IN.values(), *SANS_IO)
    names = {file.name for file in ALL}
    assert set(SAME_SENSE) <= names
    assert Path("gcs/types.py") in set(ours(Path("gcs/scenario/environment/terrain.py")))


def layer_of(file: Path) -> str:
    """The layer of a file. The public face of the package may show any folder, and is in none."""
    if file in (Path("gcs/__init__.py"), Path("gcs/__main__.py")):
        return ""
    layer = next((place for place in LAYERS if within(file, place)), None)
    assert layer or within(file, *LEAVES), f"{file} is in no layer"
    return layer or "leaf"


def allowed_of(layer: str) -> tuple[str, ...]:
    """What a layer may import."""
    if layer == "leaf":
        return LEAVES
    return (*LEAVES, *(left for left in LAYERS[: LAYERS.index(layer) + 1] if (layer, left) not in FORBIDDEN))


def test_a_layer_knows_itself_those_to_its_left_and_the_leaves() -> None:
    wrong = [
        f"{file} imports {other}"
        for file in GCS
        if (layer := layer_of(file))
        for other in ours(file)
        if other != Path("gcs/__init__.py") and not within(other, *allowed_of(layer))
    ]
    assert not wrong


def test_ground_station_and_emulated_vehicles_share_physics_and_the_link_only() -> None:
    wrong = [f"{file} imports {other}" for file in GCS for other in ours(file) if within(other, "sim_bridge")]
    allowed = ("sim_bridge", *BRIDGE_MAY)
    wrong += [f"{file} imports {other}" for file in BRIDGE for other in ours(file) if not within(other, *allowed)]
    assert not wrong


def test_no_file_imports_itself_through_others() -> None:
    graph = {file: {other for other in ours(file) if other.name != "__init__.py"} - {file} for file in ALL}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail("a circle of imports: " + " -> ".join(map(str, error.args[1])))


def test_each_library_is_known_in_one_place() -> None:
    for library, place in ONLY_IN.items():
        wrong = [file for file in ALL if any(name.split(".")[0] == library for name in imports(file))]
        assert not [str(file) for file in wrong if not within(file, place)], f"{library} is for {place} alone: ask it"


def test_a_state_machine_has_no_clock_no_socket_and_no_sleep() -> None:
    used = {str(file): OUTSIDE_WORLD & {name.split(".")[0] for name in imports(file)} for file in modules(*SANS_IO)}
    assert not {file: names for file, names in used.items() if names}


def test_a_module_opens_by_saying_what_it_is_and_stays_short() -> None:
    for file in modules("gcs", "sim_bridge", "tools"):
        text = (ROOT / file).read_text(encoding="utf-8")
        assert ast.get_docstring(parsed(file)) or not text.strip(), f"{file} has no docstring"
        assert len(text.splitlines()) <= LONGEST, f"{file} is longer than {LONGEST} lines: two ideas?"


def test_no_folder_imports_itself_through_others() -> None:
    try:
        TopologicalSorter(imports_between_folders()).prepare()
    except CycleError as error:
        pytest.fail("a circle of folders: " + " -> ".join(map(str, error.args[1])))


def mutual_neighbours(graph: dict[str, set[str]]) -> set[tuple[str, str]]:
    """Pairs that import each other with all that is in them. A parent's own modules, `a.*`, lie beside its folders."""
    between = set()
    for folder, others in graph.items():
        for other in others:
            paths = [[*name.split("."), "*"] for name in (folder, other)]
            same = next(n for n, (mine, theirs) in enumerate(zip(*paths, strict=False)) if mine != theirs)
            mine, theirs = (".".join(path[: same + 1]) for path in paths)
            between.add((mine, theirs))
    return {pair for pair in between if pair[::-1] in between}


def test_no_two_neighbouring_folders_import_each_other_with_all_that_is_in_them() -> None:
    assert not mutual_neighbours(imports_between_folders())


@pytest.mark.parametrize(
    ("graph", "found"),
    [
        ({"a.b": {"a.c"}, "a.c": {"a.b"}}, {"a.b", "a.c"}),
        ({"a.b.x": {"a.c"}, "a.c": {"a.b.y"}}, {"a.b", "a.c"}),  # by different folders in a.b
        ({"a": {"a.b"}, "a.b": {"a"}}, {"a.*", "a.b"}),
        ({"a": {"a.b"}, "a.b.x": {"a"}}, {"a.*", "a.b"}),  # a grandchild imports what joins its parent
        ({"a": {"a.b", "a.c"}, "a.c": {"a.b"}, "b": {"a.c"}}, set()),
    ],
)
def test_folders_that_import_each_other_are_found(graph: dict[str, set[str]], found: set[str]) -> None:
    assert {name for pair in mutual_neighbours(graph) for name in pair} == found


def named_in_docstring(folder: Path) -> set[str]:
    """The folders and layers that a folder says it may import."""
    text = " ".join((ast.get_docstring(parsed(folder / "__init__.py")) or "").split())
    told = re.search(r"It may import (.*?)\.(?: |$)", text)
    return set(re.split(r", | and ", told[1])) if told else set()


def test_every_folder_says_what_it_may_import_and_imports_that() -> None:
    """Leaves may be imported everywhere. Another layer is named as a whole, a folder of the same layer by itself."""
    graph = imports_between_folders()
    for folder in FOLDERS:
        name = name_of(folder / "__init__.py")
        if name in ("gcs", "sim_bridge"):
            continue
        used = set()
        for other in graph[name]:
            mine, theirs = (".".join(x.split(".")[: 2 if x.startswith("gcs") else 1]) for x in (name, other))
            short = (lambda x: x) if mine == "sim_bridge" else (lambda x: x.removeprefix("gcs."))
            if other != "gcs" and not within(Path(*other.split(".")), *LEAVES):
                used.add(short(other if mine == theirs else theirs))
        assert named_in_docstring(folder) == used, f"{folder}/__init__.py"


def test_a_folder_holds_three_or_more_and_lies_three_deep_at_most() -> None:
    for folder in FOLDERS:
        held = [file for file in ALL if file.parent == folder and file.name not in ("__init__.py", "__main__.py")]
        held += [other for other in FOLDERS if other.parent == folder]
        assert len(held) >= HELD_MIN, f"{folder} holds {len(held)} modules and folders"
        assert len(folder.parts) - 1 <= DEPTH_MAX, f"{folder} lies too deep"
        assert (ROOT / folder / "__init__.py").is_file(), f"{folder} does not say what it is for"


def functions(file: Path) -> list[ast.FunctionDef | ast.AsyncFunctionDef]:
    return [node for node in ast.walk(parsed(file)) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def argument_count(function: ast.FunctionDef | ast.AsyncFunctionDef) -> int:
    given = (*function.args.posonlyargs, *function.args.args, *function.args.kwonlyargs)
    return sum(one.arg not in ("self", "cls") for one in given)


def test_values_that_belong_together_are_one_argument() -> None:
    commands = {f"{path_of(row.module)}: {row.name.replace('-', '_')}" for row in COMMANDS.values()}
    commands.add("sim_bridge/cli.py: fly")
    many = {f"{f}: {one.name}" for f in ALL for one in functions(f) if argument_count(one) > ARGUMENTS_MAX}
    assert many - commands == MANY_ARGUMENTS


def assigned_attributes(tree: ast.AST) -> list[ast.Attribute]:
    """The attributes that are assigned anywhere in a tree."""
    found: list[ast.expr] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign):
            found += [one for target in node.targets for one in getattr(target, "elts", [target])]
        elif isinstance(node, ast.AugAssign | ast.AnnAssign):
            found.append(node.target)
    return [one for one in found if isinstance(one, ast.Attribute)]


def own(attribute: ast.Attribute) -> bool:
    return isinstance(attribute.value, ast.Name) and attribute.value.id in ("self", "cls")


def set_from_outside(tree: ast.Module) -> set[str]:
    """The attributes that a module assigns, and that no class of the module has."""
    classes = [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]
    fields = {
        node.target.id
        for one in classes
        for node in one.body
        if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name)
    }
    fields |= {one.attr for kind in classes for one in assigned_attributes(kind) if own(one)}
    return {one.attr for one in assigned_attributes(tree) if not own(one)} - fields


def test_an_object_is_changed_by_its_own_module_only() -> None:
    assert {str(file) for file in ALL if set_from_outside(parsed(file))} == SET_FROM_OUTSIDE.keys()


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("vehicle.store.rejects = True", {"rejects"}),
        ("a, b.c = 1, 2", {"c"}),
        ("one.sent += 1", {"sent"}),
        ("class A:\n def f(self, other):\n  self.sent = other.sent = 1", set()),
        ("class A:\n sent: int = 0\ndef f(a):\n a.sent = 1", set()),
        ("class A:\n def f(self):\n  self.part.sent = 1", {"sent"}),
    ],
)
def test_attributes_that_are_set_from_outside_are_found(text: str, found: set[str]) -> None:
    assert set_from_outside(ast.parse(text)) == found


def test_a_file_name_means_one_thing() -> None:
    names = Counter(file.name for file in ALL if file.name != "__init__.py")
    assert {name for name, count in names.items() if count > 1} == set(SAME_SENSE)


def test_a_public_class_name_means_one_thing() -> None:
    places: dict[str, list[str]] = {}
    for file in ALL:
        for node in parsed(file).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places.setdefault(node.name, []).append(str(file))
    assert not {name: files for name, files in places.items() if len(files) > 1}


def test_unit_tests_mirror_the_folders() -> None:
    for folder in {file.parent for file in (ROOT / "tests" / "unit").rglob("test_*.py")}:
        inside = folder.relative_to(ROOT / "tests" / "unit")
        assert any((ROOT / base / inside).is_dir() for base in ("gcs", ".")), f"tests/unit/{inside} mirrors no folder"
