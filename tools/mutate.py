"""Mutation check: puts one small bug at a time into random lines of the code and lists those that no test notices.

    ./tools/run python tools/mutate.py                               # 60 lines of the six folders that protect a flight
    ./tools/run python tools/mutate.py gcs/plan/nlp --count 20 --seed 7
    ./tools/run python tools/mutate.py --list                        # only print what would be changed

A bug is a sign, a comparison, a unit, an index, a branch that is left out. Each is tried in a copy of the tree on the
tests near the changed module: those of its folder, and those that import it. `--whole` tries survivors on every test of
`unit`, `property` and `golden`. A survivor is a missing test, or code that nothing needs.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
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


class _Places(ast.NodeVisitor):
    """Every change that can be made in the bodies and tables of one module; annotations and texts are left alone."""

    def __init__(self, file: Path, text: str) -> None:
        self._file = file
        self._text = text
        self._starts = [0]
        for line in text.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))
        self.found: list[Bug] = []

    def _at(self, line: int, column: int) -> int:
        row = self._text[self._starts[line - 1] : self._starts[line]]
        return self._starts[line - 1] + len(row.encode()[:column].decode())

    def _span(self, node: ast.AST) -> tuple[int, int]:
        assert isinstance(node, ast.expr | ast.stmt) and node.end_lineno and node.end_col_offset is not None
        return self._at(node.lineno, node.col_offset), self._at(node.end_lineno, node.end_col_offset)

    def _change(self, node: ast.AST, begin: int, end: int, now: str) -> None:
        line = self._text.count("\n", 0, begin) + 1
        self.found.append(Bug(self._file, line, begin, self._text[begin:end], now))

    def _operator(self, left: ast.expr, right: ast.expr, swapped: str) -> None:
        """The text between two operands holds the operator, brackets and maybe a comment."""
        begin, end = self._span(left)[1], self._span(right)[0]
        between = self._text[begin:end]
        if "#" not in between:
            kept = "".join(c if c in "()\n" else " " for c in between)
            closing, opening = kept.count(")"), kept.count("(")
            self._change(left, begin, end, f"{')' * closing} {swapped} {'(' * opening}")

    def visit_BinOp(self, node: ast.BinOp) -> None:
        """Arithmetic."""
        text = isinstance(node.left, ast.JoinedStr) or (
            isinstance(node.left, ast.Constant) and isinstance(node.left.value, str)
        )
        if type(node.op) in SWAPPED and not text and not isinstance(node.left, ast.List | ast.Tuple):
            self._operator(node.left, node.right, SWAPPED[type(node.op)])
        self.generic_visit(node)

    def visit_Compare(self, node: ast.Compare) -> None:
        """The first comparison of a chain."""
        self._operator(node.left, node.comparators[0], SWAPPED[type(node.ops[0])])
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        """The first of several."""
        if len(node.values) == 2:
            self._operator(node.values[0], node.values[1], SWAPPED[type(node.op)])
        self.generic_visit(node)

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        """A sign or a `not` is lost."""
        begin = self._span(node)[0]
        inner = self._span(node.operand)[0]
        if isinstance(node.op, ast.USub | ast.Not) and inner > begin:
            self._change(node, begin, inner, "" if "(" not in self._text[begin:inner] else "(")
        self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> None:
        """A number is another."""
        if isinstance(node.value, bool):
            self._change(node, *self._span(node), str(not node.value))
        elif isinstance(node.value, int | float):
            number = node.value + 1 if isinstance(node.value, int) else node.value * 2 or 1.0
            self._change(node, *self._span(node), repr(number))

    def visit_Name(self, node: ast.Name) -> None:
        """A function is its opposite."""
        if node.id in RENAMED:
            self._change(node, *self._span(node), RENAMED[node.id])

    def visit_Attribute(self, node: ast.Attribute) -> None:
        """The same behind a dot."""
        if node.attr in RENAMED:
            end = self._span(node)[1]
            self._change(node, end - len(node.attr), end, RENAMED[node.attr])
        self.generic_visit(node)

    def visit_If(self, node: ast.If) -> None:
        """A branch is never taken, or always."""
        for now in ("False", "True"):
            self._change(node, *self._span(node.test), now)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        """Texts for people are not looked at: what an error says is tested by its class and its numbers."""
        if not (isinstance(node.func, ast.Name) and node.func.id[0].isupper() and node.func.id.endswith("Error")):
            for inner in (node.func, *node.args, *(k.value for k in node.keywords if k.arg != "strict")):
                self.visit(inner)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        """The value, not the annotation."""
        if node.value:
            self.visit(node.value)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        """The body, not the decorators."""
        for inner in node.body:
            self.visit(inner)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        """Defaults and the body."""
        for inner in (*node.args.defaults, *(d for d in node.args.kw_defaults if d), *node.body):
            self.visit(inner)

    def visit_JoinedStr(self, node: ast.JoinedStr) -> None:
        """Not inside a text: columns of its parts are not told by Python 3.11."""

    visit_AsyncFunctionDef = visit_FunctionDef  # type: ignore[assignment]


def bugs_of(file: Path) -> Iterator[Bug]:
    """Every bug of one file that still is Python and not the same program."""
    text = (ROOT / file).read_text(encoding="utf-8")
    places = _Places(file, text)
    tree = ast.parse(text)
    places.visit(tree)
    same = ast.dump(tree)
    for bug in places.found:
        try:
            changed = ast.dump(ast.parse(text[: bug.begin] + bug.now + text[bug.begin + len(bug.was) :]))
        except SyntaxError:
            continue
        if changed != same:
            yield bug


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
