"""The picture and the table of folders in docs/design.md, in the order of imports."""

import ast
from collections.abc import Iterator
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

from tools.markdown import table

ROOT = Path(__file__).resolve().parent.parent
WIDTH = 104  # characters of a line of the picture


def modules(*places: str) -> list[Path]:
    """The Python files of folders, or single files. A place that does not exist raises AssertionError."""
    found: list[Path] = []
    for place in places:
        path = ROOT / place
        files = [path] if path.suffix == ".py" else sorted(path.rglob("*.py"))
        assert files and all(file.is_file() for file in files), f"{place} does not exist: was it renamed?"
        found += [file.relative_to(ROOT) for file in files]
    return found


def name_of(file: Path) -> str:
    """The dotted name of a module, or of the folder of an `__init__`."""
    return ".".join(file.with_suffix("").parts).removesuffix(".__init__")


@cache
def parsed(file: Path) -> ast.Module:
    """The syntax tree of a file of this project."""
    return ast.parse((ROOT / file).read_text(encoding="utf-8"))


@cache
def imports(file: Path) -> frozenset[str]:
    """Every module imported anywhere in the file; `from a import b` counts as a.b where that is a module."""
    return frozenset(_imports(file))


def _imports(file: Path) -> Iterator[str]:
    for node in ast.walk(parsed(file)):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.module and not node.level, f"{file}: imports are absolute here"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if path_of(inner) else node.module


@cache
def path_of(name: str) -> Path | None:
    """The file, or the `__init__` of the folder, of one of our modules."""
    path = Path(*name.split("."))
    for file in (path.with_suffix(".py"), path / "__init__.py"):
        if (ROOT / file).is_file():
            return file
    return None


def ours(file: Path) -> Iterator[Path]:
    """The files of this project that a file imports."""
    yield from (path for name in imports(file) if (path := path_of(name)) and path.parts[0] in ("gcs", "sim_bridge"))


@cache
def imports_between_folders() -> dict[str, set[str]]:
    """Folder -> folders whose modules its own modules import. `__init__` and `__main__` of the tops show anything."""
    graph: dict[str, set[str]] = {}
    for file in modules("gcs", "sim_bridge"):
        mine = graph.setdefault(name_of(file.parent / "__init__.py"), set())
        if file.name != "__main__.py" and file not in (Path("gcs/__init__.py"), Path("sim_bridge/__init__.py")):
            mine |= {name_of(other.parent / "__init__.py") for other in ours(file)}
    return {folder: others - {folder} for folder, others in graph.items()}


def sentences(folder: str) -> tuple[str, str]:
    """What a folder is for, and what it may import beside leaves, as its `__init__` says it."""
    path = path_of(folder)
    assert path
    first, _, last = " ".join((ast.get_docstring(parsed(path)) or "").split()).partition(" It ")
    return first, last.removeprefix("may import ").removesuffix(".") if last.startswith("may") else ""


def house() -> tuple[str, str]:
    """The picture, one line for each layer, and the table of all folders."""
    graph = imports_between_folders()
    sorter = TopologicalSorter({folder: sorted(graph[folder]) for folder in sorted(graph)})
    order = [folder for folder in sorter.static_order() if folder not in ("gcs", "sim_bridge")]
    own = {name_of(file.parent / "__init__.py") for file in modules("gcs", "sim_bridge") if file.name != "__init__.py"}
    layers: dict[str, list[str]] = {"leaves": [*sorted(path.stem for path in (ROOT / "gcs").glob("[!_]*.py"))]}
    for folder in (folder for folder in order if folder in own):
        top, _, inner = folder.removeprefix("gcs.").partition(".")
        if top in ("physics", "util"):
            layers["leaves"].append(top)
        elif inner and top != "sim_bridge":
            layers.setdefault(top, []).append(inner.replace(".", "/"))
        else:
            layers.setdefault(top, []).append(inner.replace(".", "/") if inner else top)
    layered = ("autopilots", "scenario", "plan", "mission", "link", "flight", "campaign", "page", "cli")
    wanted = ("leaves", *layered, "sim_bridge")
    drawn = "".join(_line(name, layers[name], " " if name == "leaves" else " < ") for name in wanted)
    rows = ((f"`{folder.replace('.', '/')}`", *sentences(folder)) for folder in sorted(order))
    return f"```text\n{drawn}```\n", table(("folder", "what it is for", "what it may import beside leaves"), rows)


def _line(name: str, folders: list[str], sign: str) -> str:
    lines = [f"{name:12}"]
    for position, folder in enumerate(folders):
        piece = folder + (sign if position + 1 < len(folders) else "")
        if len(lines[-1]) + len(piece.rstrip()) > WIDTH:
            lines.append(" " * 12)
        lines[-1] += piece
    return "".join(f"{line.rstrip()}\n" for line in lines)
