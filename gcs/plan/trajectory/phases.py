"""The phases of a flight, from take-off to landing."""

from dataclasses import dataclass
from enum import StrEnum

from gcs.scenario.schema.scenario import Scenario
from gcs.scenario.values.own_landing import landing_s


class PhaseKind(StrEnum):
    """The parts of a flight, in order; their values are those of plan files and of `Plan.hash`."""

    TAKEOFF = "takeoff"
    HOVER = "hover"
    RUN_UP = "run-up"
    MISSION = "mission"
    ARRIVAL_HOVER = "arrival-hover"
    LANDING = "landing"

    __repr__ = str.__repr__  # a plan's hash is made from it


@dataclass(frozen=True)
class Phase:
    """A part of the flight."""

    name: PhaseKind
    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """Its duration."""
        return self.end_s - self.start_s


def phases_of(scenario: Scenario) -> tuple[Phase, ...]:
    """The phases in order. They meet to the last bit; phases of no length are left out."""
    ground = scenario.ground_phases
    run_up_s = ground.run_up_s if any(scenario.start.velocity_mps) else 0.0
    phases = [Phase(PhaseKind.MISSION, 0.0, scenario.time.flight_s)]
    for name, length in (
        (PhaseKind.RUN_UP, run_up_s),
        (PhaseKind.HOVER, ground.hover_s),
        (PhaseKind.TAKEOFF, ground.takeoff_s),
    ):
        if length > 0:
            phases.insert(0, Phase(name, phases[0].start_s - length, phases[0].start_s))
    for name, length in ((PhaseKind.ARRIVAL_HOVER, ground.hover_s), (PhaseKind.LANDING, landing_s(scenario))):
        if length > 0:
            phases.append(Phase(name, phases[-1].end_s, phases[-1].end_s + length))
    return tuple(phases)
