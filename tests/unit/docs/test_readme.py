"""What the documents tell people to type is typed here.

Blocks ```sh and ```python of README.md, docs/**/*.md and missions/*/README.md run from top to bottom in a copy of the
tree (with -m slow), each document in a copy of its own. An HTML comment on the line before a
block says when not to: `<!-- run: in tests/x.py -->` names the test that does it instead (which must exist), `<!--
run: no, because ... -->` gives a reason. In an sh block a line may begin with `$ `; then the lines without it are what
the command prints.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import pytest

from tests.kept import SHARING

ROOT = Path(__file__).resolve().parents[3]
COPIED = ("README.md", "docs", "gcs", "missions", "sim_bridge", "pyproject.toml", "requirements.lock", "tools")
BLOCK = re.compile(
    r"(?:^<!-- run: (?P<note>[^\n]*?) -->\n+)?^```(?P<language>sh|python)\n(?P<code>.*?)^```$", re.M | re.S
)
SETUP = "./tools/run "


@dataclass(frozen=True)
class Block:
    document: str
    line: int
    language: str
    code: str
    note: str

    @property
    def commands(self) -> str:
        """The lines to type: all, or those behind `$ ` where the block shows output too."""
        lines = self.code.splitlines()
        if any(line.startswith("$ ") for line in lines):
            lines = [line[2:] for line in lines if line.startswith("$ ")]
        return "\n".join(lines)


def blocks_of(text: str, document: str) -> list[Block]:
    return [
        Block(document, text.count("\n", 0, m.start("code")), m["language"], m["code"], m["note"] or "")
        for m in BLOCK.finditer(text)
    ]


def documents() -> list[Path]:
    return [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md")), *sorted(ROOT.glob("missions/*/README.md"))]


def name_of(file: Path) -> str:
    return str(file.relative_to(ROOT))


BLOCKS = {name_of(file): blocks_of(file.read_text(encoding="utf-8"), name_of(file)) for file in documents()}
ALL = [block for blocks in BLOCKS.values() for block in blocks]


@pytest.mark.slow
@pytest.mark.parametrize("document", [name for name, blocks in BLOCKS.items() if any(not b.note for b in blocks)])
def test_the_blocks_of_a_document_run(document: str, tmp_path: Path) -> None:
    runnable = [block for block in BLOCKS[document] if not block.note]
    copy = tmp_path / "skein"
    copy.mkdir()
    for name in COPIED:
        if (ROOT / name).is_dir():
            shutil.copytree(ROOT / name, copy / name)
        elif (ROOT / name).exists():
            shutil.copy(ROOT / name, copy / name)
    # The environment is there already: only what stands behind `./tools/run` is of interest.
    (copy / "tools" / "run").write_text('#!/bin/sh\nexec "$@"\n')
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    places = f"{SHARING['PYTHONPATH']}{os.pathsep}{copy}"
    environment = {**os.environ, "PATH": path, "PYTHONPATH": places, "MPLBACKEND": "Agg"}
    for block in runnable:
        command = ["sh", "-euc", block.commands] if block.language == "sh" else [sys.executable, "-c", block.code]
        done = subprocess.run(
            command, cwd=copy, env=environment, capture_output=True, text=True, timeout=400, check=False
        )
        where = f"{block.document}:{block.line}"
        assert done.returncode == 0, f"{where} ended with {done.returncode}\n{done.stdout}\n{done.stderr}"


def test_what_does_not_run_here_has_a_test_or_a_reason() -> None:
    for block in ALL:
        where = f"{block.document}:{block.line}"
        if block.note.startswith("in "):
            assert (ROOT / block.note.removeprefix("in ")).is_file(), f"{where}: {block.note}"
        elif block.note:
            assert re.match(r"no, because \S", block.note), f"{where}: {block.note}"


def test_long_commands_are_left_to_the_end_to_end_test() -> None:
    """A flight takes most of a minute: one test flies it, and the block names that test. The tutorial flies its own."""
    for block in ALL:
        quick = block.document == "docs/tutorial.md" and "--sim --speedup max" in block.commands
        quick = quick or block.document.startswith("docs/examples/")
        heavy = not quick and re.search(r"\bgcs fly\b|\bpytest\b|\bsim-bridge\b", block.commands)
        assert not heavy or block.note, f"{block.document}:{block.line}: put `<!-- run: in tests/... -->` before it"


def test_examples_are_short_and_stand_in_their_index() -> None:
    index = (ROOT / "docs" / "examples" / "index.md").read_text(encoding="utf-8")
    pages = [name for name in BLOCKS if name.startswith("docs/examples/") and not name.endswith("index.md")]
    assert len(pages) == 6
    for name in pages:
        assert f"({Path(name).name})" in index
        assert BLOCKS[name] and all(len(block.code.splitlines()) < 40 and not block.note for block in BLOCKS[name])


def test_links_inside_the_repository_lead_somewhere() -> None:
    for document in documents():
        for target, anchor in re.findall(r"\]\(([^)#]*?)(?:#([^)]*))?\)", document.read_text(encoding="utf-8")):
            if "://" in target or target.startswith("mailto:"):
                continue
            there = document.parent / target if target else document
            assert there.exists(), f"{document.name}: {target}"
            assert not anchor or anchor in anchors(there), f"{document.name}: {target}#{anchor}"


@cache
def anchors(file: Path) -> set[str]:
    """What links to headings may name, as they are made on GitHub."""
    headings = re.findall(r"^#+ +(.+?) *$", file.read_text(encoding="utf-8"), re.M)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_the_tutorial_shows_the_scenario_that_gcs_new_writes(tmp_path: Path) -> None:
    file = tmp_path / "plans" / "first" / "scenario.toml"
    subprocess.run([Path(sys.executable).parent / "gcs", "new", "plans/first"], cwd=tmp_path, check=True)
    (shown,) = re.findall(
        r"^```toml\n(.*?)^```$", (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8"), re.M | re.S
    )
    assert shown == file.read_text(encoding="utf-8")


def test_the_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) < 120


def test_the_harness_reads_blocks_notes_and_prompts() -> None:
    text = (
        "x\n```sh\necho 1\n```\n<!-- run: in tests/a.py -->\n\n```sh\n$ echo 2\n2\n$ echo 3\n3\n```\n"
        "```toml\na = 1\n```\n```python\nprint(4)\n```\n"
    )
    found = blocks_of(text, "X.md")
    assert [(b.line, b.language, b.commands, b.note) for b in found] == [
        (2, "sh", "echo 1", ""),
        (7, "sh", "echo 2\necho 3", "in tests/a.py"),
        (16, "python", "print(4)", ""),
    ]
