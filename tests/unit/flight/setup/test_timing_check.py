"""Pre-flight in mission mode: arrival times rest on parameters that the vehicle may have otherwise."""

from __future__ import annotations

import asyncio
from collections.abc import Sequence
from typing import cast

import pytest

from gcs.autopilots.parameter_names import in_units_of, spellings
from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerTimeout
from gcs.flight.monitoring.preflight_check import PreflightCheck
from gcs.flight.setup.timing_check import timing_check
from gcs.link.protocols.parameter_transfer import REAL32, Parameter
from gcs.link.session.vehicle_api import Loadable
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.mission.model import Home, VehicleMission


class Vehicle:
    """A vehicle with the assumed parameters, some of them changed, under their old names or their new ones."""

    sysid = 2

    def __init__(self, autopilot: Autopilot, changed: dict[str, float], *, new: bool = False) -> None:
        self.autopilot = autopilot
        self.asked: list[str] = []
        self._new = new
        self._values = autopilot.navigator.parameters | changed

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        self.asked += names
        return {name: self._own(name) for name in names}

    def _own(self, name: str) -> Parameter:
        if name not in self._values:
            raise PeerTimeout(f"vehicle 2 does not answer for parameter {name}.")
        own = spellings(self.autopilot, name)[-1 if self._new else 0]
        return Parameter(own, in_units_of(self.autopilot, own, name, self._values[name]), REAL32)


def checked(vehicle: Vehicle, *given: tuple[str, float]) -> PreflightCheck:
    load = VehicleLoad(VehicleMission(2, Home(0.0, 0.0, 0.0), (), ()), parameters=given)
    return asyncio.run(timing_check(cast("Loadable", vehicle), load))


@pytest.mark.parametrize("known", Autopilot)
@pytest.mark.parametrize("new", [False, True])
def test_every_parameter_that_differs_is_named_with_both_values(known: Autopilot, new: bool) -> None:
    assert checked(Vehicle(known, {}, new=new)).ok
    for name, assumed in known.navigator.parameters.items():
        check = checked(Vehicle(known, {name: 1.1 * assumed + 0.1}, new=new))
        own = spellings(known, name)[-1 if new else 0]
        there, here = (in_units_of(known, own, name, value) for value in (1.1 * assumed + 0.1, assumed))
        assert not check.go
        assert check.measured == f"{own} is {there:g}, assumed {here:g}"


def test_a_parameter_that_the_upload_sets_is_not_compared() -> None:
    vehicle = Vehicle(Autopilot.ARDUPILOT, {"WPNAV_SPEED_UP": 100.0})
    assert not checked(vehicle).ok
    vehicle.asked.clear()
    assert checked(vehicle, ("WPNAV_SPEED_UP", 150.0)).ok
    assert "WPNAV_SPEED_UP" not in vehicle.asked


def test_a_parameter_that_is_not_told_is_a_no_go() -> None:
    vehicle = Vehicle(Autopilot.PX4, {})
    del vehicle._values["NAV_ACC_RAD"]
    check = checked(vehicle)
    assert (check.ok, check.measured) == (False, "vehicle 2 does not answer for parameter NAV_ACC_RAD")
