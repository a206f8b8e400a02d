"""Tables of Markdown."""

from collections.abc import Iterable, Sequence


def rows(cells: Iterable[Sequence[str]]) -> str:
    """A line for each row, with bars within cells escaped."""
    return "".join("| " + " | ".join(text.replace("|", "\\|") for text in row) + " |\n" for row in cells)


def table(header: Sequence[str], cells: Iterable[Sequence[str]]) -> str:
    """Header and rows."""
    return rows([header, ["---"] * len(header), *cells])
