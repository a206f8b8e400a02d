"""What a campaign is asked to fly, by its options or a TOML file with the same names, and the design drawn from it."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import fields
from importlib.metadata import version
from pathlib import Path

from pydantic import ConfigDict, TypeAdapter, ValidationError
from pydantic.dataclasses import dataclass as checked_dataclass

from gcs.campaign.campaign_flight import code_digest, emulated
from gcs.campaign.design import (
    Factor,
    FaultFactors,
    Sampling,
    Value,
    draw,
    parse_factor,
    parse_fault,
    parse_share,
    parse_wind,
)
from gcs.campaign.varied_plan import refuse_unknown_keys
from gcs.errors import FileFormatError, UsageError
from gcs.flight.contingency.choices import FlightMode, NavigatorChoice, OnLeaderLoss, OnLoss, TimeKeeping
from gcs.flight.contingency.options import FlightOptions
from gcs.flight.run import refuse_late_starts
from gcs.flight.setup.simulator_process import Emulated, refuse_wrong_options
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import Scenario
from gcs.types import JsonObject
from gcs.util.bounded_file import UPLOAD_RECORD, read_file

_PROBES = 200  # rows of the design among which every kind of condition is looked for


@checked_dataclass(frozen=True, config=ConfigDict(extra="forbid"))
class CampaignOptions:
    """All that decides the results of a campaign beside its plan. Texts are distributions, as `gcs.campaign.design`."""

    flights: int = 100
    seed: int = 0
    wind: str | None = None
    gusts: str | None = None
    loss: str | None = None
    faults: tuple[str, ...] = ()
    vary: tuple[str, ...] = ()
    sampling: Sampling = Sampling.RANDOM
    mode: FlightMode = FlightMode.STREAM
    nav: NavigatorChoice = NavigatorChoice.AUTO
    follow: bool = False
    on_loss: OnLoss = OnLoss.LAND
    on_leader_loss: OnLeaderLoss = OnLeaderLoss.PROMOTE
    until: str | None = None

    @classmethod
    def of(cls, given: Mapping[str, object]) -> CampaignOptions:
        """Return the options of these values by name. Raises UsageError."""
        try:
            found = TypeAdapter(cls).validate_python(dict(given))
        except ValidationError as error:
            first = error.errors()[0]
            key = ".".join(map(str, first["loc"]))
            raise UsageError(
                f"{key}: {first['msg']}", hint="see gcs campaign --help for the names and values"
            ) from None
        if found.flights < 1 or found.seed < 0:
            raise UsageError(f"{found.flights} flights, seed {found.seed}: at least 1 flight, and a seed from 0 on")
        if found.follow and found.mode is not FlightMode.STREAM:
            raise UsageError("--follow needs a setpoint stream", hint="give --mode stream")
        _ = found.width, found.factors  # refused before anything is planned
        return found

    @classmethod
    def recorded(cls, record: JsonObject) -> CampaignOptions:
        """Return the options that `campaign.json` has. Raises UsageError."""
        return cls.of({name: value for name, value in record.items() if name in {one.name for one in fields(cls)}})

    @property
    def width(self) -> float | None:
        """The width of the interval of the pass rate that ends the campaign, 0 to 1. Raises UsageError."""
        if self.until is None:
            return None
        levels = parse_share("--until", "until", self.until).levels
        if len(levels) != 1 or not isinstance(levels[0], float) or not levels[0] > 0.0:
            raise UsageError(f"--until {self.until}: not a width", hint="write for example --until 2%")
        return levels[0]

    @property
    def keeping(self) -> TimeKeeping:
        """How flights keep time."""
        return TimeKeeping(self.mode, True, self.nav)

    @property
    def choices(self) -> FlightOptions:
        """What flights do in a crisis."""
        return FlightOptions(follow=self.follow, on_loss=self.on_loss, on_leader_loss=self.on_leader_loss)

    @property
    def factors(self) -> tuple[Factor, ...]:
        """The factors of the design beside those of faults. Raises UsageError."""
        found: list[Factor] = []
        if self.wind is not None:
            found += parse_wind(self.wind)
        if self.gusts is not None:
            found.append(parse_factor("--gusts", "gusts", self.gusts))
        if self.loss is not None:
            found.append(parse_share("--loss", "loss", self.loss))
        found += self._varied
        return tuple(found)

    @property
    def _varied(self) -> list[Factor]:
        found = []
        for text in self.vary:
            key, equals, values = text.partition("=")
            if not equals or not all(key.split(".")) or "." not in key:
                raise UsageError(
                    f"--vary {text}: not a key of the scenario and its values",
                    hint="write for example --vary vehicle.mass_kg=1.8..2.4",
                )
            found.append(parse_factor("--vary", key, values))
        return found

    def fault_factors(self, sysids: tuple[int, ...], flight_s: float) -> tuple[FaultFactors, ...]:
        """The factors of all faults; `any` time is within `flight_s` after take-off. Raises UsageError."""
        return tuple(parse_fault(text, n, sysids, flight_s) for n, text in enumerate(self.faults, 1))

    def design(self, plan: Plan) -> list[dict[str, Value]]:
        """Return one row for each flight. Raises UsageError."""
        flight_s = plan.flight_s - plan.t_start_s
        return draw(self.factors, self.fault_factors(plan.sysids, flight_s), self.seed, self.flights, self.sampling)

    def record(self, plan: Plan) -> JsonObject:
        """Return what `campaign.json` has: with another value, results do not belong together."""
        options = TypeAdapter(CampaignOptions).dump_python(self, mode="json")
        return {
            "mission": plan.scenario.name,
            **options,
            "plan_hash": plan.hash,
            "version": version("skein-gcs"),
            "code": code_digest(),
        }

    def refuse(self, scenario: Scenario) -> None:
        """Raise UsageError for options that do not fit a scenario, as the simulator reads them: before planning."""
        if self.mode is FlightMode.MISSION:
            refuse_late_starts(scenario)
        refuse_unknown_keys(scenario, (one.name for one in self._varied))
        rows = draw(
            self.factors,
            self.fault_factors(tuple(scenario.formation.sysids), scenario.time.flight_s or 0.0),
            self.seed,
            min(self.flights, _PROBES),
            self.sampling,
        )
        # One flight that has every kind of fault, at every level of gusts.
        every = [emulated(row) for row in rows]
        faults = {fault.partition("=")[0].partition("@")[0]: fault for one in every for fault in one.faults}
        for gusts in {one.gusts: one for one in every}.values():
            refuse_wrong_options(scenario, Emulated("max", 0, tuple(faults.values()), gusts.wind, gusts.gusts))


def read_design(file: Path) -> JsonObject:
    """Return the options that a TOML file has. Raises FileFormatError."""
    try:
        found = tomllib.loads(read_file(file, UPLOAD_RECORD, hint="name a TOML file").decode())
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise FileFormatError(f"{file} is not a TOML file: {problem}.") from None
    return found
