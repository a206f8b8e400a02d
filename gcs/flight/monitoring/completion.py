"""Finds which vehicles flew the plan to its end, by their own boot clocks and the places where they came down."""

import math
from collections.abc import Collection, Mapping

import numpy as np

from gcs.flight.monitoring.monitor import VehicleView
from gcs.plan.trajectory.plan import Plan

LONGEST_SILENCE_S = 600.0  # a longer step of a boot clock is a jump; emulated time runs on while a machine is busy
SLACK_S, SLACK_SHARE = 5.0, 0.02  # reports are late, by more where vehicles are emulated faster than real time
PLACE_M = 5.0  # off its landing point a vehicle did not fly the plan, whatever its time


class Completion:
    """Whether vehicles flew the plan to its end: reported boot times in, what is missing of the plan out.

    GNSS time may jump, and a wrong common time ends a flight early without any incident. A boot clock does not jump.
    """

    def __init__(self, plan: Plan) -> None:
        self._plan = plan
        self._boot_s: dict[int, float] = {}
        self._flown_s = dict.fromkeys(plan.sysids, 0.0)
        self._begin_s: float | None = None  # plan time
        self._short: dict[int, float] = {}  # seconds flown, of vehicles whose landing began too early
        self._broke_off = False

    def follow(self, plan: Plan) -> None:
        """The vehicles fly another plan to its end."""
        self._plan = plan

    def receive(self, sysid: int, boot_ms: int, *, armed: bool) -> None:
        """Add the boot time since the last report to the time flown, if the vehicle is armed and the plan has begun.

        Steps back, and steps above 600 s, are jumps of the clock and add nothing.
        """
        boot_s = boot_ms / 1e3
        step_s = boot_s - self._boot_s.get(sysid, boot_s)
        self._boot_s[sysid] = boot_s
        if armed and 0.0 < step_s <= LONGEST_SILENCE_S and self._begin_s is not None:
            self._flown_s[sysid] += step_s

    def begins(self, t_s: float) -> None:
        """The vehicles fly the plan, which is at its time `t_s` by the common time."""
        self._begin_s = t_s

    def lands(self, sysids: Collection[int], *, broke_off: bool = False) -> None:
        """These vehicles, which fly the plan and are heard, have reached its landing by the common time.

        `broke_off`: before that, no vehicle flew the plan any more.
        """
        self._broke_off = broke_off
        enough_s = self._flight_s - SLACK_S - SLACK_SHARE * self._flight_s
        self._short = {i: self._flown_s[i] for i in sysids if self._flown_s[i] < enough_s}

    def missing(self, views: Mapping[int, VehicleView]) -> list[str]:
        """Return in words what was not flown. `views`: the vehicles that flew the plan, as last reported."""
        words = [
            f"vehicle {sysid} flew {flown_s:.0f} s of {self._flight_s:.0f} s until the landing, by its own clock"
            for sysid, flown_s in self._short.items()
        ]
        if self._broke_off:
            words.append("no vehicle flew it to its landing")
        far_m = max(PLACE_M, 3.0 * self._plan.scenario.judge.arrival_position_m)
        for sysid, view in views.items():
            place = self._plan.landing_points_ned_m[self._plan.sysids.index(sysid)]
            off_m = float(np.hypot(*(view.position_ned_m - place)[:2]))
            if math.isfinite(off_m) and off_m > far_m:
                words.append(f"vehicle {sysid} came down {off_m:.1f} m from its landing point (limit {far_m:g} m)")
        return words

    @property
    def _flight_s(self) -> float:
        """How long the plan takes from where it was begun to its landing."""
        landing_s = self._plan.landing_s
        return 0.0 if self._begin_s is None else max(landing_s - self._begin_s, 0.0)
