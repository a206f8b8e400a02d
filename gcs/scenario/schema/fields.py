"""The number types of scenario tables, the base of a table, and the error for keys that disagree inside it."""

from collections.abc import Iterator
from functools import lru_cache
from typing import Annotated, Any, ClassVar, Self, get_args

from pydantic import BaseModel, ConfigDict, Field, GetJsonSchemaHandler, Strict, model_validator
from pydantic_core import CoreSchema

from gcs.scenario.schema.degree_keys import DegreeKeys
from gcs.scenario.schema.mistake import sentence
from gcs.scenario.schema.toml_lines import Key, Table

# Strict: TOML has its own types, so the text "5" or the value true is a mistake and not a number.
Number = Annotated[float, Strict(), Field(allow_inf_nan=False)]
Share = Annotated[Number, Field(ge=0, lt=1)]
Truth = Annotated[bool, Strict()]

FLIGHT_MAX_S = 7200
FARTHEST_M = 100_000  # from the origin: distances in the local frame err by 4e-5 there

# Ranges wider than any quadrotor needs, yet such that products and squares of them stay numbers, and so that counts of
# points and steps made from them stay small.
Coordinate = Annotated[Number, Field(ge=-FARTHEST_M, le=FARTHEST_M)]  # m
Height = Annotated[Number, Field(ge=-10_000, le=10_000)]  # m
Length = Annotated[Number, Field(ge=0.001, le=100_000)]  # m
Distance = Annotated[Number, Field(ge=0, le=100_000)]  # m
Seconds = Annotated[Number, Field(ge=0.01, le=FLIGHT_MAX_S)]
Speed = Annotated[Number, Field(ge=0.001, le=340)]  # m/s, up to that of sound
Acceleration = Annotated[Number, Field(ge=0.0001, le=1000)]  # m/s^2
Jerk = Annotated[Number, Field(ge=0.01, le=10_000)]  # m/s^3
Turn = Annotated[Number, Field(ge=-36_000, le=36_000)]  # degrees, up to a hundred turns
TurnRate = Annotated[Number, Field(ge=0.001, le=10_000)]  # degrees/s
Force = Annotated[Number, Field(ge=0, le=100_000)]  # N
Torque = Annotated[Number, Field(ge=1e-9, le=100_000)]  # N or N m
Weight = Annotated[Number, Field(ge=0, le=1e6)]  # of a term of the objective

Point = tuple[Coordinate, Coordinate]
Place = tuple[Coordinate, Coordinate, Height]
_Component = Annotated[Number, Field(ge=-1000, le=1000)]
Direction = tuple[_Component, _Component, _Component]


def left_out(text: str) -> Any:
    """A key that a file may leave out, and that nothing writes where its value is None."""
    return Field(default=None, description=text, exclude_if=lambda value: value is None)


# A key inside a table, () for the table itself; what is wrong with it; perhaps what to do.
Finding = tuple[Key, str] | tuple[Key, str, str]
Findings = Iterator[Finding]


class Disagreement(ValueError):
    """Keys of one table that are each valid, but not together."""

    def __init__(self, found: list[Finding]) -> None:
        self.found = [(key, text, "".join(step)) for key, text, *step in found]
        super().__init__("; ".join(": ".join((*map(str, key), sentence(*said))) for key, *said in self.found))


class Part(BaseModel):
    """The base of every table: immutable, no unknown keys, no silent conversions, no keys that disagree."""

    model_config = ConfigDict(extra="forbid", frozen=True)
    degree_keys: ClassVar[tuple[DegreeKeys, ...]] = ()  # that a file may have instead of those in metres

    @classmethod
    def __get_pydantic_json_schema__(cls, core: CoreSchema, handler: GetJsonSchemaHandler) -> Table:
        schema = handler(core)
        for keys in cls.degree_keys:
            keys.add_to(handler.resolve_ref_schema(schema))
        return schema

    @model_validator(mode="after")
    def _agrees(self) -> Self:
        if found := list(self._disagreements()):
            raise Disagreement(found)
        return self

    def _disagreements(self) -> Findings:
        return iter(())


@lru_cache
def _inner_tables(model: type[Part]) -> dict[str, type[Part]]:
    """The keys of a table that hold tables, and the models of these."""
    found = {name: _part_in(model_field.annotation) for name, model_field in model.model_fields.items()}
    return {name: part for name, part in found.items() if part is not None}


def _part_in(annotation: object) -> type[Part] | None:
    if isinstance(annotation, type) and issubclass(annotation, Part):
        return annotation
    return next((part for part in map(_part_in, get_args(annotation)) if part is not None), None)


def tables(model: type[Part], table: Table, key: Key = ()) -> Iterator[tuple[Key, type[Part], Table]]:
    """A table and those inside it, with their keys and models. Each may be changed before those inside it come."""
    yield key, model, table
    for name, part in _inner_tables(model).items():
        value = table.get(name)
        if isinstance(value, dict):
            table[name] = dict(value)
            yield from tables(part, table[name], (*key, name))
        elif isinstance(value, list | tuple):
            table[name] = [dict(one) if isinstance(one, dict) else one for one in value]
            for row, one in enumerate(table[name]):
                if isinstance(one, dict):
                    yield from tables(part, one, (*key, name, row))
