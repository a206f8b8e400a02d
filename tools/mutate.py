"""Mutation check: puts one small bug at a time into random lines of the code and lists those that no test notices.

    ./tools/run python tools/mutate.py                               # 60 lines of the six folders that protect a flight
    ./tools/run python tools/mutate.py gcs/plan/nlp --count 20 --seed 7
    ./tools/run python tools/mutate.py --list                        # only print what would be changed

A bug is a sign, a comparison, a unit, an index, a branch that is left out. Each is tried in a copy of the tree on the
tests near the changed module: those of its folder, and those that import it. `--whole` tries survivors on every test of
`unit`, `property` and `golden`. A survivor is a missing test, or code that nothing needs.
"""

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import accumulate
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = (
    "gcs/plan/verification",
    "gcs/plan/nlp",
    "gcs/mission/waypoints",
    "gcs/link/protocols/mission",
    "gcs/flight/contingency",
    "gcs/scenario/validation",
)
COPIED = ("gcs", "sim_bridge", "tools", "tests", "missions", "docs")
IMPORTERS_MAX = 12
LIMIT_S = 600.0  # tests that take longer have noticed a bug that never ends
SWAPPED: dict[type[ast.AST], str] = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.MatMult: "*", ast.FloorDiv: "/", ast.Mod: "//",
    ast.Lt: ">=", ast.LtE: "<", ast.Gt: "<=", ast.GtE: ">", ast.Eq: "!=", ast.NotEq: "==",
    ast.In: "not in", ast.NotIn: "in", ast.Is: "is not", ast.IsNot: "is", ast.And: "or", ast.Or: "and",
}  # fmt: skip
RENAMED = {
    "min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "sin": "cos", "cos": "sin", "any": "all",
    "all": "any", "radians": "degrees", "degrees": "radians", "round": "int", "floor": "ceil", "ceil": "floor",
    "argmin": "argmax", "argmax": "argmin", "start_s": "end_s", "end_s": "start_s", "abs": "float",
}  # fmt: skip


@dataclass(frozen=True)
class Bug:
    """One change of a file: the text `was` at a place becomes `now`."""

    file: Path
    line: int
    begin: int  # offset in the text of the file
    was: str
    now: str

    def __str__(self) -> str:
        row = (ROOT / self.file).read_text(encoding="utf-8").splitlines()[self.line - 1].strip()
        return f"{self.file}:{self.line}: `{row}`: {' '.join(self.was.split())} becomes {self.now.strip() or 'nothing'}"


Span = Callable[[ast.expr | ast.stmt], tuple[int, int]]  # where a node begins and ends in the text of its file


def bugs_of(file: Path) -> Iterator[Bug]:
    """Every bug of one file that still is Python and not the same program."""
    text = (ROOT / file).read_text(encoding="utf-8")
    rows = text.splitlines(keepends=True)
    starts = list(accumulate(map(len, rows), initial=0))

    def at(line: int, column: int) -> int:
        return starts[line - 1] + len(rows[line - 1].encode()[:column].decode())

    def span(node: ast.expr | ast.stmt) -> tuple[int, int]:
        assert node.end_lineno and node.end_col_offset is not None
        return at(node.lineno, node.col_offset), at(node.end_lineno, node.end_col_offset)

    tree = ast.parse(text)
    same = ast.dump(tree)
    for node in _walked(tree):
        for begin, end, now in _changes(node, text, span):
            try:
                changed = ast.dump(ast.parse(text[:begin] + now + text[end:]))
            except SyntaxError:
                continue
            if changed != same:
                yield Bug(file, text.count("\n", 0, begin) + 1, begin, text[begin:end], now)


def _walked(node: ast.AST) -> Iterator[ast.AST]:
    """All nodes of bodies, defaults and tables, the outer ones first. Annotations, decorators and texts are left out.

    Errors too: what one says is tested by its class and its numbers. Python 3.11 does not tell columns inside a text.
    """
    inner: Iterable[ast.AST] = ast.iter_child_nodes(node)
    match node:
        case ast.JoinedStr():
            return
        case ast.Call(ast.Name(name)) if name[0].isupper() and name.endswith("Error"):
            return
        case ast.Call(function, arguments, keywords):
            inner = [function, *arguments, *(k.value for k in keywords if k.arg != "strict")]
        case ast.AnnAssign(value=value):
            inner = [value] if value else []
        case ast.ClassDef(body=body):
            inner = body
        case ast.FunctionDef(args=args, body=body) | ast.AsyncFunctionDef(args=args, body=body):
            inner = [*args.defaults, *(d for d in args.kw_defaults if d), *body]
    yield node
    for one in inner:
        yield from _walked(one)


def _changes(node: ast.AST, text: str, span: Span) -> Iterator[tuple[int, int, str]]:
    """What can be changed of one node: from where to where in the text, and what stands there then."""
    match node:
        case ast.BinOp(left, op, right) if type(op) in SWAPPED and not _is_text_or_list(left):
            yield from _operator(left, op, right, text, span)
        case ast.Compare(left, [op, *_], [right, *_]) | ast.BoolOp(op, [left, right]):
            yield from _operator(left, op, right, text, span)
        case ast.UnaryOp(ast.USub() | ast.Not(), operand):  # a sign or a `not` is lost
            begin, inner = span(node)[0], span(operand)[0]
            if inner > begin:
                yield begin, inner, "" if "(" not in text[begin:inner] else "("
        case ast.Constant(bool(value)):
            yield (*span(node), str(not value))
        case ast.Constant(int(value)):
            yield (*span(node), repr(value + 1))
        case ast.Constant(float(value)):
            yield (*span(node), repr(value * 2 or 1.0))
        case ast.Name(name) if name in RENAMED:
            yield (*span(node), RENAMED[name])
        case ast.Attribute(_, name) if name in RENAMED:
            end = span(node)[1]
            yield end - len(name), end, RENAMED[name]
        case ast.If(test):  # a branch is never taken, or always
            yield from ((*span(test), now) for now in ("False", "True"))


def _is_text_or_list(node: ast.expr) -> bool:
    return isinstance(node, ast.JoinedStr | ast.List | ast.Tuple) or (
        isinstance(node, ast.Constant) and isinstance(node.value, str)
    )


def _operator(left: ast.expr, op: ast.AST, right: ast.expr, text: str, span: Span) -> Iterator[tuple[int, int, str]]:
    """The text between two operands holds the operator, brackets and maybe a comment."""
    begin, end = span(left)[1], span(right)[0]
    between = text[begin:end]
    if "#" not in between:
        yield begin, end, f"{')' * between.count(')')} {SWAPPED[type(op)]} {'(' * between.count('(')}"


def drawn(folders: list[str], count: int, seed: int) -> list[Bug]:
    """So many lines by chance, one bug for each."""
    files = [
        f.relative_to(ROOT)
        for name in folders
        for f in sorted((ROOT / name).rglob("*.py") if (ROOT / name).is_dir() else [ROOT / name])
    ]
    lines: dict[tuple[Path, int], list[Bug]] = {}
    for file in files:
        for bug in bugs_of(file):
            lines.setdefault((bug.file, bug.line), []).append(bug)
    chance = random.Random(seed)
    return [chance.choice(lines[place]) for place in chance.sample(sorted(lines), min(count, len(lines)))]


def nearby(file: Path) -> list[str]:
    """The tests of the module's folder, and those of any folder without sockets that import the module."""
    name = ".".join(file.with_suffix("").parts)
    package, module = name.rpartition(".")[::2]
    folder = Path("tests/unit", *file.parts[1 if file.parts[0] == "gcs" else 0 : -1])
    while not (ROOT / folder).is_dir():
        folder = folder.parent
    own = sorted(str(test.relative_to(ROOT)) for test in (ROOT / "tests/unit").rglob(f"test_{file.stem}.py"))
    found = set()
    for place in ("unit", "property", "golden"):
        for test in sorted((ROOT / "tests" / place).rglob("test_*.py")):
            text = test.read_text(encoding="utf-8")
            inside = (ROOT / folder) in test.parents
            if not inside and (name in text or f"from {package} import {module}" in text):
                found.add(str(test.relative_to(ROOT)))
    known = sorted(found) if len(found) <= IMPORTERS_MAX else []  # what half of the tests use has tests of its own
    return [*own, str(folder), *known]  # the likeliest first: the first failure ends it


class Copy:
    """A copy of the tree in which bugs are put and tests run."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        for name in COPIED:
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in ("pyproject.toml", "README.md", "CONTRIBUTING.md", "CHANGELOG.md", "requirements.lock"):
            shutil.copy(ROOT / name, folder / name)

    def notices(self, bug: Bug, tests: list[str]) -> bool:
        """Whether a test fails, or none ends in time."""
        file = self._folder / bug.file
        text = file.read_text(encoding="utf-8")
        file.write_text(text[: bug.begin] + bug.now + text[bug.begin + len(bug.was) :], encoding="utf-8")
        command = [sys.executable, "-m", "pytest", "-n", "0", "-x", "-q", "-p", "no:cacheprovider", *tests]
        try:
            ended = subprocess.run(
                command, cwd=self._folder, timeout=LIMIT_S, check=False, capture_output=True,
                env={**os.environ, "PYTHONPATH": str(self._folder), "PYTHONDONTWRITEBYTECODE": "1"},
            )  # fmt: skip
            return ended.returncode != 0
        except subprocess.TimeoutExpired:
            return True
        finally:
            file.write_text(text, encoding="utf-8")


def main() -> int:
    """Run it; 1 where a bug was not noticed."""
    cli = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    cli.add_argument("folders", nargs="*", default=list(FOLDERS), help="folders or files of the code to change")
    cli.add_argument("--count", type=int, default=60, help="so many lines at most")
    cli.add_argument("--seed", type=int, default=1, help="another seed draws other lines")
    cli.add_argument("--tests", nargs="+", help="these tests, not those near each module")
    cli.add_argument("--whole", action="store_true", help="try what nearby tests do not notice on all without sockets")
    cli.add_argument("--list", action="store_true", help="print what would be changed and run nothing")
    asked = cli.parse_args()
    bugs = drawn(asked.folders, asked.count, asked.seed)
    if asked.list:
        print(*bugs, sep="\n")
        return 0
    # All is read before the first is tried: who works on while it runs changes neither the lines nor the tests.
    tried = [(bug, str(bug), asked.tests or nearby(bug.file)) for bug in bugs]
    missed = 0
    with tempfile.TemporaryDirectory(prefix="skein-mutants-") as folder:
        copy = Copy(Path(folder))
        for number, (bug, words, tests) in enumerate(tried, 1):
            began = time.monotonic()
            caught = copy.notices(bug, tests)
            if not caught and asked.whole:
                caught = copy.notices(bug, ["tests/unit", "tests/property", "tests/golden"])
            missed += not caught
            print(
                f"{number:3d} {'caught  ' if caught else 'SURVIVED'} {time.monotonic() - began:4.0f} s  {words}",
                flush=True,
            )
    print(f"{len(bugs) - missed} of {len(bugs)} bugs noticed (seed {asked.seed})")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
