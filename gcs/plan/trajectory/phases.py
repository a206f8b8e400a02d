"""The phases of a flight, from take-off to landing."""

from __future__ import annotations

from dataclasses import dataclass

from gcs.scenario.schema.scenario import Scenario


@dataclass(frozen=True)
class Phase:
    """A named part of the flight."""

    name: str  # takeoff, hover, run-up, mission, arrival-hover, landing
    start_s: float
    end_s: float

    @property
    def duration_s(self) -> float:
        """Its length."""
        return self.end_s - self.start_s


def phases_of(scenario: Scenario) -> tuple[Phase, ...]:
    """The phases in order. They meet to the last bit; phases of no length are left out."""
    ground = scenario.ground_phases
    run_up_s = ground.run_up_s if any(scenario.start.velocity_mps) else 0.0
    phases = [Phase("mission", 0.0, scenario.time.flight_s)]
    for name, length in (("run-up", run_up_s), ("hover", ground.hover_s), ("takeoff", ground.takeoff_s)):
        if length > 0:
            phases.insert(0, Phase(name, phases[0].start_s - length, phases[0].start_s))
    for name, length in (("arrival-hover", ground.hover_s), ("landing", ground.landing_s)):
        if length > 0:
            phases.append(Phase(name, phases[-1].end_s, phases[-1].end_s + length))
    return tuple(phases)
