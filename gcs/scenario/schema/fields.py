"""The number types of scenario tables, the base of a table, and the error for keys that disagree inside it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Self

from pydantic import BaseModel, ConfigDict, Field, Strict, model_validator

from gcs.scenario.validation.toml_lines import Key

# Strict: TOML has its own types, so the text "5" or the value true is a mistake and not a number.
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NonNegative = Annotated[Number, Field(ge=0)]
Share = Annotated[Number, Field(ge=0, lt=1)]
Truth = Annotated[bool, Strict()]
Point = tuple[Number, Number]
Vector = tuple[Number, Number, Number]
PositiveVector = tuple[Positive, Positive, Positive]
NonNegativeVector = tuple[NonNegative, NonNegative, NonNegative]

Finding = tuple[Key, str]  # a key inside a table, () for the table itself, and what is wrong with it
Findings = Iterator[Finding]


class Disagreement(ValueError):
    """Keys of one table that are each valid, but not together."""

    def __init__(self, found: list[Finding]) -> None:
        super().__init__("; ".join(": ".join((*map(str, key), text)) for key, text in found))
        self.found = tuple(found)


class Part(BaseModel):
    """The base of every table: immutable, no unknown keys, no silent conversions, no keys that disagree."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        if found := list(self.disagreements()):
            raise Disagreement(found)
        return self

    def disagreements(self) -> Findings:
        """Yield the keys of this table that disagree."""
        return iter(())
