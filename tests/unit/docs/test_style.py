"""Words that the field does not use stay out of what people read."""

from __future__ import annotations

import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

# What people read says the field's word. Each pattern: what to write in its place.
LEFT_OUT = {
    r"who(?:ever|mever)?|whom": "the vehicle, the planner, the operator, you",
    r"nobody|no one": "no vehicle, no file: name it",
    r"(?:some|every|any)(?:body|one)": "all vehicles, an operator, you: name it",
    r"(?:closed|forbidden) areas?": "no-fly zone",
    r"(?:goes|go|going|gone|went|calls?|called|calling|fly|flies|flown|ways?|straight) home": "return (RTL)",
    r'(?<!")swarms(?!")': "PSO (particle swarm optimisation)",
    r"broken by": "violated by",
    r"(?:does|do|did) not hold": "failed verification",
    r"manners": "behaviour, traits",
    r"by heart": "known",
    r"by custom": "by default",
    r"(?:is|are|was|were|be|been|as) told": "reported, sent, received: name the actor",
    r"patience": "timeout",
    r"he|she|his|her|him": "it, its, you",
}
PATTERNS = [(re.compile(rf"(?<![\w`])(?:{word})(?![\w`])", re.IGNORECASE), say) for word, say in LEFT_OUT.items()]
COMMENT = re.compile(r"<!--.*?-->")
READ = ("README.md", "CHANGELOG.md", "CONTRIBUTING.md", "docs", "missions", "gcs", "sim_bridge", "tools")


def prose(file: Path) -> Iterator[tuple[int, str]]:
    """Lines of a document outside its code blocks and comments; strings, docstrings and comments of a program."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".py":
        for token in tokenize.generate_tokens(io.StringIO(text).readline):
            if token.type in (tokenize.STRING, tokenize.COMMENT):
                yield from enumerate(token.string.split("\n"), start=token.start[0])
        return
    in_block = False
    for number, line in enumerate(text.split("\n"), start=1):
        in_block ^= line.startswith("```")
        if not in_block:
            yield number, COMMENT.sub("", line)


def read_files(place: Path) -> list[Path]:
    """What people read below a place; templates and scenarios are TOML."""
    if place.is_file():
        return [place]
    return sorted(file for file in place.rglob("*") if file.suffix in (".py", ".md", ".toml"))


def test_left_out_words_stay_out(repo_root: Path) -> None:
    files = [file for place in READ for file in read_files(repo_root / place)]
    found = [
        f"{file.relative_to(repo_root)}:{number}: {match[0]!r}: write {say}"
        for file in files
        for number, line in prose(file)
        for pattern, say in PATTERNS
        for match in pattern.finditer(line)
    ]
    assert not found, "\n".join(found)


def test_a_left_out_word_is_found(tmp_path: Path) -> None:
    program = tmp_path / "program.py"
    program.write_text('"""Return altitudes of all vehicles."""\nwho = 1  # Whoever leaves\n')
    lines = [line for _, line in prose(program)]
    assert [bool(PATTERNS[0][0].search(line)) for line in lines] == [False, True]
