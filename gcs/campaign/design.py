"""The design of a campaign: which wind, gusts, faults and seed each flight has, drawn before the first one flies.

An option is a distribution of one or more factors: `0..6` (evenly between), `0..6/4` (one of four levels),
`light,moderate` (one of these), `3` (always so), `0..20%` (a share), `any` (of directions, vehicles or times). Draws of
flight i come from SeedSequence([campaign, i]), so that they do not depend on the number of flights; only a Latin
hypercube needs it.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from gcs.campaign.records import TEXT
from gcs.errors import UsageError
from gcs.types import Array

Value = float | str
ANY = "any"
_NUMBER = r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?"
_RANGE = re.compile(rf"({_NUMBER})\.\.({_NUMBER})(%)?(?:/(\d+))?")
_FAULT = re.compile(
    r"(?:(?P<share>[^:%]+%):)?(?P<vehicle>[\w,]+):(?P<kind>(?:up\.|down\.)?[a-z-]+)"
    r"(?:=(?P<value>[^@]+))?(?:@(?P<when>.+))?"
)
_FAULT_HINT = "write e.g. --fault 5%:any:die@any: the chance, the vehicle, the fault and its time after take-off"


class Sampling(StrEnum):
    """How the space of the factors is filled."""

    RANDOM = "random"
    LATIN = "latin"  # Latin hypercube: every factor evenly, whatever the number of flights
    FULL = "full"  # full factorial: every combination of levels in turn


@dataclass(frozen=True)
class Factor:
    """One quantity that differs between flights: one of `levels`, or a number evenly between `low` and `high`."""

    name: str
    levels: tuple[Value, ...] = ()
    low: float = math.nan
    high: float = math.nan

    def at(self, share: float) -> Value:
        """Return the value below which this share of the distribution lies, 0 <= share < 1."""
        if self.levels:
            return self.levels[min(int(share * len(self.levels)), len(self.levels) - 1)]
        return self.low + share * (self.high - self.low)


@dataclass(frozen=True)
class FaultFactors:
    """A fault as text with gaps, and the factors that fill them."""

    number: int
    kind: str
    happens: Factor
    vehicle: Factor
    value: Factor | None = None
    when: Factor | None = None

    @property
    def factors(self) -> tuple[Factor, ...]:
        """Every factor of the fault."""
        return tuple(one for one in (self.happens, self.vehicle, self.value, self.when) if one is not None)

    def text(self, row: dict[str, Value]) -> str:
        """Return the fault of a flight as `gcs fly --fault` takes it; empty where it does not happen."""
        if not row[self.happens.name]:
            return ""
        text = f"{row[self.vehicle.name]}:{self.kind}"
        for mark, factor in (("=", self.value), ("@", self.when)):
            text += "" if factor is None else mark + plain(row[factor.name])
        return text


def parse_factor(option: str, name: str, text: str, any_of: Factor | None = None) -> Factor:
    """Return the factor `name` of an option's text; `any_of` is what `any` means here. Raises UsageError."""
    body = text.strip()
    if body == ANY and any_of is not None:
        return any_of
    if found := _RANGE.fullmatch(body):
        low, high = (float(found[n]) * (0.01 if found[3] else 1.0) for n in (1, 2))
        if not (math.isfinite(low) and math.isfinite(high) and low < high):
            raise UsageError(f"{option} {text}: the range must go up", hint=f"write for example {option} 0..6")
        if found[4] is None:
            return Factor(name, (), low, high)
        if int(found[4]) < 2:
            raise UsageError(f"{option} {text}: a range has two levels or more", hint=f"write {option} 0..6/4")
        return Factor(name, tuple(float(x) for x in np.linspace(low, high, int(found[4]))))
    words = [word.strip() for word in body.split(",")]
    if not all(words) or ".." in body or len(set(words)) < len(words):
        hint = f"write one value, a range as 0..6, or different values as 1,3{'' if any_of is None else ', or any'}"
        raise UsageError(f"{option} {text}: not a distribution of values", hint=hint)
    return Factor(name, tuple(_value(word) for word in words))


def parse_wind(text: str) -> tuple[Factor, Factor]:
    """Return the factors `wind_mps` and `wind_from_deg` of SPEED@FROM. Raises UsageError."""
    speed, at, origin = text.partition("@")
    hint = "write SPEED@FROM, each a value, a range or `any`: 0..6@any"
    if not at:
        raise UsageError(f"--wind {text}: no direction", hint=hint)
    from_deg = parse_factor("--wind", "wind_from_deg", origin, Factor("wind_from_deg", (), 0.0, 360.0))
    found = parse_factor("--wind", "wind_mps", speed), from_deg
    numbers = [x for one in found for x in (one.levels or (one.low, one.high))]
    if any(isinstance(x, str) for x in numbers) or any(isinstance(x, float) and x < 0.0 for x in numbers):
        raise UsageError(f"--wind {text}: speeds and directions are numbers from 0 on", hint=hint)
    return found


def parse_share(option: str, name: str, text: str) -> Factor:
    """Return a factor whose values are shares from 0 to 1. Raises UsageError."""
    found = parse_factor(option, name, text)
    if not all(isinstance(x, float) and 0.0 <= x <= 1.0 for x in found.levels or (found.low, found.high)):
        raise UsageError(f"{option} {text}: not shares between 0 and 100 %", hint=f"write for example {option} 0..20%")
    return found


def parse_fault(text: str, number: int, sysids: Sequence[int], flight_s: float) -> FaultFactors:
    """Return the factors of `[CHANCE%:]VEHICLE:KIND[=VALUE][@TIME]`. Raises UsageError.

    `any` is one of the vehicles, or a time within `flight_s` after take-off. `number` is in the factors' names:
    `fault1_vehicle`.
    """
    found = _FAULT.fullmatch(text.strip())
    if found is None:
        raise UsageError(f"--fault {text}: not a fault", hint=_FAULT_HINT)
    name = f"fault{number}"
    chance = parse_share("--fault", name, found["share"] or "100%")
    if len(chance.levels) != 1 or not isinstance(chance.levels[0], float):
        raise UsageError(f"--fault {text}: the chance is one number", hint=_FAULT_HINT)
    vehicles = Factor(f"{name}_vehicle", tuple(str(sysid) for sysid in sysids))
    vehicle = vehicles
    if found["vehicle"] != ANY:
        vehicle = Factor(vehicles.name, tuple(found["vehicle"].split(",")))
        if unknown := [one for one in vehicle.levels if one != "all" and one not in vehicles.levels]:
            known = ", ".join(map(str, vehicles.levels))
            raise UsageError(f"--fault {text}: vehicle {unknown[0]} is not in this mission, which has {known}")
    value = when = None
    if found["value"] is not None:  # `loss=0..20%` and `at-once|late` are drawn; the values of `delay=0.2,0.1` stay
        one = f"{name}_value"
        drawn = ".." in found["value"]
        words = tuple(found["value"].split("|"))
        value = parse_factor("--fault", one, found["value"]) if drawn else Factor(one, words)
        if not all(words) or len(set(words)) < len(words):
            raise UsageError(f"--fault {text}: empty or equal values", hint="write different values: at-once|late")
    if found["when"] is not None:  # FROM..UNTIL, as `gcs fly` has it
        moment = f"{name}_at_s"
        when = Factor(moment, (), 0.0, flight_s) if found["when"] == ANY else Factor(moment, (found["when"],))
    return FaultFactors(number, found["kind"], Factor(name, (), 0.0, chance.levels[0]), vehicle, value, when)


def shares(factors: Sequence[Factor], campaign: int, flights: int, sampling: Sampling) -> Array:
    """Return the place of every flight in the distribution of every factor, (flights, factors), from 0 to below 1.

    Raises UsageError for a full factorial of a factor without levels.
    """
    drawn = np.array([_generator(campaign, index).random(len(factors)) for index in range(flights)])
    drawn = drawn.reshape(flights, len(factors))
    if sampling is Sampling.LATIN:
        # Strata are dealt anew for another number of flights; the key of their generator is no flight's index.
        deal = np.random.default_rng(np.random.SeedSequence([campaign, flights, len(factors)], spawn_key=(1,)))
        strata = np.stack([deal.permutation(flights) for _ in factors], axis=1) if factors else drawn
        return np.asarray(np.minimum((strata + drawn) / flights, np.nextafter(1.0, 0.0)))
    if sampling is Sampling.FULL:
        index = np.arange(flights)
        for column, factor in enumerate(factors):
            count = len(factor.levels)
            if count == 0:
                text = f"{factor.low:g}..{factor.high:g}"
                raise UsageError(
                    f"a full factorial needs levels of {factor.name}, which is {text}", hint=f"write {text}/4 for four"
                )
            drawn[:, column] = (index % count + 0.5) / count
            index = index // count
    return drawn


def seed_of(campaign: int, index: int) -> int:
    """Return the seed of one flight's noise and gusts, 0 <= seed < 2**32."""
    return int(np.random.SeedSequence([campaign, index]).generate_state(1)[0])


def _generator(campaign: int, index: int) -> np.random.Generator:
    return np.random.default_rng(np.random.SeedSequence([campaign, index]))


def draw(
    factors: Sequence[Factor],
    faults: Sequence[FaultFactors],
    campaign: int,
    flights: int,
    sampling: Sampling = Sampling.RANDOM,
) -> list[dict[str, Value]]:
    """Return a row for each flight: `index`, `seed`, the value of every factor, and every fault as text.

    `fault1` is 1.0 where the fault happens, `fault1_text` what `gcs fly --fault` takes. The factors of a fault that
    does not happen are drawn all the same. Raises UsageError for a full factorial of a factor without levels.
    """
    every = [*factors, *(factor for fault in faults for factor in fault.factors)]
    chance = {fault.happens.name: fault.happens.high for fault in faults}
    placed = shares([_levelled(one) if one.name in chance else one for one in every], campaign, flights, sampling)
    rows = []
    for index, place in enumerate(placed):
        row: dict[str, Value] = {"index": index, "seed": seed_of(campaign, index)}
        for factor, share in zip(every, place.tolist(), strict=True):
            if factor.name not in chance:
                row[factor.name] = factor.at(share)
                continue
            limit = 0.5 if sampling is Sampling.FULL and 0.0 < factor.high < 1.0 else factor.high
            row[factor.name] = float(share < limit)
        for fault in faults:
            row[fault.happens.name + TEXT] = fault.text(row)
        rows.append(row)
    return rows


def plain(value: Value) -> str:
    """Return a value as options take it, exact enough to be read back as the same number."""
    return value if isinstance(value, str) else repr(float(value))


def _levelled(happens: Factor) -> Factor:
    """A full factorial flies with the fault and without it as often, whatever its chance; a certain one always."""
    return Factor(happens.name, ("with", "without") if 0.0 < happens.high < 1.0 else ("always",))


def _value(word: str) -> Value:
    number = word.removesuffix("%")
    if re.fullmatch(_NUMBER, number):
        return float(number) * (0.01 if word.endswith("%") else 1.0)
    return word
