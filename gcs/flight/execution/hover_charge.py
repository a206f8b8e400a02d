"""The charge that a flight needs, by the current of the hover before T0; without a reserve, the flight ends there."""

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack

from gcs.errors import FlightError
from gcs.flight.contingency.energy_choice import ChargeWatch
from gcs.flight.execution.order_carrier import FlyingFleet
from gcs.flight.monitoring.own_battery import ChargeRule, measured_draw
from gcs.flight.setup.own_process import in_own_process
from gcs.link.wire.message import Message
from gcs.plan.trajectory.energy import BatteryModel, battery_model
from gcs.plan.trajectory.plan import Plan

_FEW = 12  # vehicles
_LISTEN_S = 2.0  # of vehicle time: SYS_STATUS comes twice a second
_RULE = "The current in the hover replaces that of the plan"


async def model_of(plan: Plan) -> BatteryModel:
    """Return the use of a plan's vehicles. A large fleet's takes seconds, in which heartbeats would wait."""
    if len(plan.sysids) > _FEW:
        return await in_own_process(battery_model, plan)
    return battery_model(plan)


async def check_hover(
    fleet: FlyingFleet, charge: ChargeWatch, rule: ChargeRule, report: Callable[[int, str, str], None]
) -> None:
    """Measure the current of hovering vehicles, and scale their needs by it.

    A vehicle that reports no current keeps the need of its pre-flight. Raises `FlightError` if one would end the plan
    with less than the reserve.
    """
    found, power = await _statuses(fleet), fleet.plan.scenario.vehicle.power
    least, short = (1.0, 0, ""), []
    for sysid, messages in found.items():
        fields = [message.fields for message in messages]
        battery = rule.batteries.get(sysid)
        if not fields or battery is None or fields[-1]["battery_remaining"] < 0:
            continue
        current_A, volt = measured_draw(messages)
        scale = battery.measured_scale(power, charge.model, current_A, volt)
        charge.expect(sysid, battery.scale(power) if scale is None else scale)
        if scale is None:
            continue
        left = fields[-1]["battery_remaining"] / 100.0
        end = rule.left_at_end(fleet.plan, charge.model, sysid, left, scale)
        what = f"draws {current_A:.1f} A of {battery} in the hover: the plan needs {left - end:.0%} of {left:.0%} left"
        least = min(least, (end, sysid, what))
        if end < rule.reserve:
            short.append(f"vehicle {sysid} {what}")
    if least[2]:
        report(least[1], least[2], _RULE)
    if short:
        raise FlightError(
            f"the start was aborted: {'; '.join(short)}. {rule.reserve:.0%} must be left at the end.",
            hint="fly a shorter plan, or larger batteries; `--reserve` is what must be left, `--waive battery` flies "
            "once in spite of it",
        )


async def _statuses(fleet: FlyingFleet) -> Mapping[int, Sequence[Message]]:
    """The SYS_STATUS messages of every vehicle in the next `_LISTEN_S`."""
    found: dict[int, list[Message]] = {sysid: [] for sysid in fleet.vehicles}
    with ExitStack() as stack:
        for sysid, vehicle in fleet.vehicles.items():
            stack.callback(vehicle.session.subscribe(found[sysid].append))
        await fleet.time.until(fleet.time.sure_s() + _LISTEN_S)
    return {sysid: [one for one in every if one.name == "SYS_STATUS"] for sysid, every in found.items()}
