"""The end of a flight: landing orders until they are carried out, and the wait until every vehicle has landed.

A vehicle has landed when it reports itself disarmed. A flight does not end while a vehicle is armed and heard, whether
the ground station, its autopilot or a pilot flies it. It ends when all vehicles have said so twice: one wrong HEARTBEAT
of the last vehicle in the air would leave it alone.
"""

import asyncio
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import partial

from gcs.errors import FlightError, GcsError, OrderError
from gcs.flight.contingency.order_book import StandingOrder
from gcs.flight.contingency.policy import State
from gcs.flight.execution.order_carrier import ATTEMPT_S, FlyingFleet, OrderCarrier
from gcs.flight.execution.takeoff_landing import FlightVehicle
from gcs.link.protocols.command import CommandRefused, CommandSender
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand
from gcs.util.aio import LOOK_S, until

PILOT_WORDS = "a pilot flies it; the flight ends when it has landed"
ORDERED_WORDS = "it was ordered to land; the flight ends when it has landed"
SILENT_WORDS = "not heard: it is not known whether landed"
HANDED_OVER = "is not known to have landed, and is handed over"
_FRESH_S = 1.0
_FORCE = 21196.0  # MAV_CMD_COMPONENT_ARM_DISARM's param2: whatever the vehicle takes itself for
_AGAIN_S = 3.0  # a HEARTBEAT comes once a second
HAND_OVER_WORDS = "fly it by its RC transmitter or another ground station; `gcs attach --land` lands it"


class Custody:
    """The vehicles of `sessions` (by system id) that this process has to bring down: none, until it takes them.

    A vehicle that a pilot or another ground station armed is theirs: it is never taken.
    """

    def __init__(self, sessions: Mapping[int, VehicleSession]) -> None:
        self._sessions = sessions
        self._seen_armed: dict[int, bool] = {}  # of those taken
        self._stops: list[Callable[[], None]] = []

    def take_to_arm(self, sysid: int) -> None:
        """Take charge of a vehicle before it is ordered to arm: its answer may be lost. Raises `FlightError`."""
        self.refuse_armed([sysid])
        self._take(sysid)

    def release(self, sysid: int) -> None:
        """A vehicle stands disarmed on the ground: there is nothing left to bring down."""
        self._seen_armed.pop(sysid, None)

    def take_up(self) -> None:
        """Take the vehicles that are in the air: the operator ordered to continue a flight that was left.

        One that is not heard yet may be there too.
        """
        for sysid, session in self._sessions.items():
            if session.armed or not session.heard:
                self._take(sysid)

    def holds(self, sysid: int) -> bool:
        """Whether a vehicle was taken."""
        return sysid in self._seen_armed

    def may_be_up(self, sysid: int) -> bool:
        """Whether a vehicle was taken and may be armed. After an order to arm, its HEARTBEAT may not say so yet."""
        return self.holds(sysid) and (self._sessions[sysid].armed or not self._seen_armed[sysid])

    def refuse_armed(self, sysids: list[int] | None = None) -> None:
        """Raises `FlightError` if one of these vehicles, or any, is armed and was not taken."""
        asked = self._sessions if sysids is None else sysids
        if foreign := [i for i in asked if self._sessions[i].armed and not self.holds(i)]:
            raise FlightError(
                f"{named(foreign)} armed, and not by this flight.",
                hint="it got no order: leave it to its pilot or ground station until it is disarmed, then fly again; "
                "`--waive disarmed` does not change whose it is",
            )

    def close(self) -> None:
        """Stop listening to the vehicles."""
        for stop in self._stops:
            stop()
        self._stops.clear()

    def _take(self, sysid: int) -> None:
        session = self._sessions[sysid]
        self._seen_armed.setdefault(sysid, session.armed)

        def receive(message: Message) -> None:
            if message.name == "HEARTBEAT" and session.armed and sysid in self._seen_armed:
                self._seen_armed[sysid] = True

        self._stops.append(session.subscribe(receive))


class FleetLanding:
    """Lands the vehicles of a flight that are in its custody, and no others.

    `states` are those of the contingency policy, empty before the take-off.
    """

    def __init__(
        self,
        fleet: FlyingFleet,
        states: Callable[[], Mapping[int, State]],
        report_failure: Callable[[StandingOrder], None],
        report: Callable[[int, str, str], None],
    ) -> None:
        vehicles = fleet.vehicles
        self.custody = Custody({sysid: vehicle.session for sysid, vehicle in vehicles.items()})
        self.orders = OrderCarrier(lambda sysid: vehicles[sysid].session.armed, self.is_heard, self.custody.holds)
        self._fleet = fleet
        self._vehicles = vehicles
        self._states = states
        self._report_failure = report_failure
        self._report = report
        self._reported: set[int] = set()

    def is_heard(self, sysid: int) -> bool:
        """Whether a vehicle is within reach."""
        if self._states().get(sysid) is State.LOST:
            return False
        return self._vehicles[sysid].session.silent_s() <= self._fleet.options.limits.vehicle_lost_s

    def not_landed(self) -> list[int]:
        """Return the vehicles that do not report themselves disarmed: those in the air, and those not heard."""
        return [i for i, v in self._vehicles.items() if v.session.armed or not self.is_heard(i)]

    def order(self, vehicle: FlightVehicle, *, planned: bool = False) -> None:
        """Order a landing until the vehicle shows it; failures become events.

        `planned`: as the plan wants it. Then an order that a repetition carried out did not fail.
        """
        land = partial(self._fleet.land, vehicle.sysid)
        self.orders.start(vehicle.sysid, "land", land, self._report_failure, planned=planned)

    def disarm(self, vehicle: FlightVehicle, on_ground: Callable[[], bool], reason: str) -> None:
        """Order a vehicle that failed at its take-off to disarm, as soon as it is on the ground, until it has.

        One that does not lift takes itself for flying, and refuses: then it is forced.
        """
        session, sysid = vehicle.session, vehicle.sysid

        def stands() -> bool:
            return on_ground() and session.fresh("LOCAL_POSITION_NED", _FRESH_S) is not None

        async def stop() -> None:
            if not stands():
                await self._fleet.land(sysid)
                await until(lambda: stands() or not session.armed, ATTEMPT_S, f"vehicle {sysid}: the ground")
            for force in (0.0, _FORCE):
                with suppress(CommandRefused):
                    await session.command(MavCommand.COMPONENT_ARM_DISARM, 0.0, force)
                    break
            await session.wait_for(lambda _: not session.armed, ATTEMPT_S, "a disarmed HEARTBEAT", or_latest=True)

        self._report(sysid, "ordered to disarm", f"A vehicle that fails at its take-off stops its motors: it {reason}")
        self.orders.start(sysid, "disarm", stop, self._report_failure)

    def send_once(self) -> None:
        """Send every vehicle the order to land once, without waiting for an acknowledgement."""
        now_s = asyncio.get_running_loop().time()
        for vehicle in self._ours_aloft():
            land = vehicle.behaviour.mode_parameters(vehicle.behaviour.land)
            command = CommandSender(MavCommand.DO_SET_MODE, land, vehicle.session.exchange)
            with suppress(Exception):  # the others get theirs
                for message in command.start(now_s):
                    vehicle.session.send(message)

    async def land_all(self) -> None:
        """Land all vehicles within reach that no pilot flies; wait until every vehicle has landed or is out of reach.

        An order that stands goes on, so that this may be called again where it failed.
        """
        ordered: set[int] = set()
        while True:
            for vehicle in self._ours_aloft():
                sysid = vehicle.sysid
                if self.is_heard(sysid) and sysid not in ordered and not self.orders.stands(sysid):
                    self.order(vehicle)  # a vehicle that was silent gets it when it is heard
                    ordered.add(sysid)
            if not any(self.orders.stands(sysid) for sysid in self._vehicles) and await self._all_down():
                return
            self._report_pilots()
            await asyncio.sleep(LOOK_S)

    async def until_landed(self) -> None:
        """Wait as long as a vehicle is armed and heard."""
        while not await self._all_down():
            self._report_pilots()
            await asyncio.sleep(LOOK_S)

    async def _all_down(self) -> bool:
        """Whether no vehicle is armed and heard, by two HEARTBEATs of each; a silent one is not waited for long."""
        loop = asyncio.get_running_loop()
        end_s = loop.time() + _AGAIN_S
        ours = [v.session for i, v in self._vehicles.items() if self.custody.holds(i) and self.is_heard(i)]
        said_s = [(session, session.latest_s["HEARTBEAT"]) for session in ours]
        while not self.aloft():
            if loop.time() >= end_s or all(session.latest_s["HEARTBEAT"] > at_s for session, at_s in said_s):
                return True
            await asyncio.sleep(LOOK_S)
        return False

    def of_pilots(self) -> list[int]:
        """Return the vehicles that are still in the air if pilots fly all of them."""
        aloft, states = self.aloft(), self._states()
        return aloft if all(states.get(sysid) is State.LEFT for sysid in aloft) else []

    def _report_pilots(self) -> None:
        """Report once that only vehicles of pilots are still in the air."""
        for sysid in set(self.of_pilots()) - self._reported:
            self._report(sysid, "still in the air", PILOT_WORDS)
            self._reported.add(sysid)

    def aloft(self) -> list[int]:
        """Return the vehicles of this flight that are armed and heard."""
        return [i for i, v in self._vehicles.items() if v.session.armed and self.custody.holds(i) and self.is_heard(i)]

    def hand_over(self) -> None:
        """Report each vehicle that is not known to have landed: from now on it is flown by others."""
        states = self._states()
        for sysid in self._vehicles:
            if states.get(sysid) is State.LOST:
                continue  # its loss was reported
            heard = self.is_heard(sysid)
            if self.custody.may_be_up(sysid) and (self._vehicles[sysid].session.armed or not heard):
                why = "still armed" if heard else SILENT_WORDS
                self._report(sysid, HANDED_OVER, f"{why}: {HAND_OVER_WORDS}")

    def report_airborne(self) -> None:
        """Report the vehicles that are still in the air, and what becomes of them: Ctrl-C came once more."""
        states = self._states()
        for sysid, vehicle in self._vehicles.items():
            if vehicle.session.armed and self.custody.holds(sysid):
                ours = PILOT_WORDS if states.get(sysid) is State.LEFT else ORDERED_WORDS
                self._report(sysid, "still in the air", ours if self.is_heard(sysid) else SILENT_WORDS)

    def words(self) -> str:
        """Return which vehicles reported a landing, and which did not."""
        left = self.not_landed()
        if not left:
            return "all vehicles have landed"
        lost = [i for i in left if not self.is_heard(i)]
        aloft = [i for i in left if i not in lost]
        parts = [f"{named(lost)} {SILENT_WORDS}"] if lost else []
        parts += [f"{named(aloft)} still armed"] if aloft else []
        landed = [i for i in self._vehicles if i not in left]
        return "; ".join([*([f"{named(landed)} landed"] if landed else []), *parts])

    def raise_failed_orders(self, stopped: BaseException | None = None) -> None:
        """Raises OrderError if a vehicle refused or did not answer an order. `stopped` ended the flight early.

        A planned landing did not fail where the vehicle landed, however late its answers came.
        """
        left = self.not_landed()
        failed = "; ".join(str(order) for order in self.orders.failed if not order.planned or order.sysid in left)
        if failed:
            because = f"{stopped.message} " if isinstance(stopped, GcsError) else ""
            raise OrderError(
                f"{because}{failed}. At the end: {self.words()}.",
                hint="search for vehicles that did not report a landing at their last reported position",
            ) from stopped

    def _ours_aloft(self) -> list[FlightVehicle]:
        """Vehicles of this flight that may be airborne, but those of a pilot. A silent one may receive."""
        states = self._states()
        return [v for i, v in self._vehicles.items() if self.custody.may_be_up(i) and states.get(i) is not State.LEFT]


def named(sysids: list[int]) -> str:
    """Vehicles as words."""
    return f"vehicle{'s' if len(sysids) > 1 else ''} {', '.join(map(str, sysids))}"
