"""A sentence of the paper that can be tested: what it says, how it is read, what was measured, and the verdict.

Knows: how claims are kept and printed. Does not know: flights.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any


@dataclass(frozen=True)
class Claim:
    """`measured` is a template over `numbers`; `why` explains the verdict and holds no number of its own."""

    place: str  # section of the paper
    figures: tuple[int, ...]
    says: str
    measured: str
    numbers: dict[str, float]
    holds: bool
    why: str
    reading: str = ""  # where its words leave a choice: the sense in which it is judged


def kept(claims: list[Claim], prefix: str) -> list[dict[str, Any]]:
    """For the record: numbers as plain floats, numbered with a prefix."""
    return [
        asdict(claim)
        | {
            "id": f"{prefix}{number}",
            "figures": list(claim.figures),
            "numbers": {key: float(value) for key, value in claim.numbers.items()},
            "holds": bool(claim.holds),
        }
        for number, claim in enumerate(claims, start=1)
    ]


def verdict(claim: dict[str, Any]) -> str:
    """The verdict on a sentence of the paper."""
    if not claim["holds"]:
        return "**not confirmed**"
    return "confirmed as read" if claim.get("reading") else "confirmed"


def table(claims: list[dict[str, Any]], decided_by: list[str] | None = None) -> list[str]:
    """A row for each; `decided_by` names the unstated values that decide it, sentence by sentence."""
    lines = [
        "| | the paper says | measured | | why | unstated values that decide it |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for claim, decides in zip(claims, decided_by or ["not varied"] * len(claims), strict=True):
        measured = claim["measured"].format(**claim["numbers"])
        says = f"{claim['place']}: {claim['says']}"
        if claim.get("reading"):
            says += f"<br>*read as:* {claim['reading']}"
        lines.append(f"| {claim['id']} | {says} | {measured} | {verdict(claim)} | {claim['why']} | {decides} |")
    return lines


def beside(picture: str, number: int, caption: str, claims: list[dict[str, Any]]) -> list[str]:
    """A figure and what the paper says of it, side by side."""
    said = [f"{c['id']}: {c['says']} – {verdict(c)}" for c in claims if number in c["figures"]]
    text = "<br>".join(said) or "no sentence of its own that could be tested"
    return [
        f"| Fig. {number}: {caption} | what the paper says of it |",
        "| --- | --- |",
        f"| ![Fig. {number}: {caption}]({picture}) | {text} |",
        "",
    ]
