"""Orders that change the plan in flight, carried out: planned in a process of its own, then streamed to all vehicles.

`plan_change` decides; this module has the process, the clocks and the events.
"""

import asyncio
import math
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

from gcs.autopilots.traits import Autopilot
from gcs.errors import FlightError, GcsError
from gcs.flight.contingency.choices import FlightMode, OnLoss
from gcs.flight.contingency.lost_vehicle import on_its_way, way_home, where_it_stopped
from gcs.flight.contingency.manoeuvres import MotionReference
from gcs.flight.contingency.plan_change import ATTEMPTS, PlanChange, Planning
from gcs.flight.contingency.policy import IN_FORMATION, State
from gcs.flight.execution.executor import ContingencyExecutor
from gcs.flight.execution.hover_charge import model_of
from gcs.flight.execution.order_carrier import FlyingFleet
from gcs.flight.monitoring.progress import ALL_VEHICLES, AskedOrder, Event, PlanForecast
from gcs.flight.recording.flight_folder import PLAN, later_plans
from gcs.flight.setup.own_process import in_own_process
from gcs.flight.setup.plan_worker import WAIT_S, PlanWorker, Replacement
from gcs.flight.setup.planner_process import PlannerProcess
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.plan.formation_orders import Avoid, CloseRanks, FlyHome, Hold, PlanOrder
from gcs.plan.replanning.plan_pieces import continued
from gcs.plan.trajectory.plan import Plan
from gcs.scenario.schema.scenario import NoFlyZone
from gcs.util.aio import ended
from gcs.util.steady_loop import follows

_GONE = frozenset({State.LOST, State.RETURNING, State.LANDING})
_WHO = 80  # characters of who asked
_LIMIT_S = 100.0  # for one plan: no solver may keep all later orders from being heard
_OURSELVES = "this program"  # as who asked
NEW_PLAN = "fly a new plan"


class PlanOrders:
    """Changes of one flight's plan, from T0 to its landing. `run` beside the flight; `follow` takes each new plan."""

    def __init__(
        self,
        fleet: FlyingFleet,
        contingency: ContingencyExecutor,
        folder: Path | None,
        on_event: Callable[[Event], None],
        follow: Callable[[Plan], None],
    ) -> None:
        self._fleet, self._contingency, self._folder = fleet, contingency, folder
        self._on_event, self._follow = on_event, follow
        scenario, self._loop = fleet.plan.scenario, asyncio.get_running_loop()
        self._change = PlanChange(scenario.mission.setpoint_rate_hz, fleet.options.lead_s)
        self._rest = fleet.plan.sysids  # the vehicles that the plan is for
        # Those that the others were asked to fly on without, or that were never heard.
        self._gone = {sysid for sysid, state in contingency.policy.states.items() if state is State.LOST}
        self._t0_s = fleet.monitor.t0_s
        self._came_up: tuple[NoFlyZone, ...] = ()  # zones that the ways back are made round
        self._failed: set[str] = set()  # what looking ahead met, told once
        self._streams = fleet.options.mode is FlightMode.STREAM
        self._prepared = None if folder is None else folder / PLAN  # with the returns that were made before the flight
        self._worker = PlannerProcess(PlanWorker, fleet.plan, folder, self._prepared)
        self._count = 1 if folder is None else 1 + len(later_plans(folder))  # of a flight that is taken up again
        self._asked: asyncio.Queue[Planning] = asyncio.Queue()
        self._returns: asyncio.Future[None] | None = None  # being planned for the flown plan
        self._answer: asyncio.Future[str] | None = None

    def ask(self, order: PlanOrder, by: str) -> tuple[int, ...]:
        """Have the formation fly another plan; return its vehicles. Raises FlightError where it cannot.

        The plan is made from now on: `events.jsonl` has what came of it, and `answer` returns it.
        """
        now_s, by = self._now_s(), by[:_WHO]
        self._tell(f"were asked to {order} by {by}", "", {"order": str(order), "by": by})
        try:
            if why := self._why_not(order):
                self._change.note(order, now_s, self._fleet.plan)
                why += f"; {self._change.instead}" if isinstance(order, Avoid) and self._change.instead else ""
                raise FlightError(f"the formation would not {order}: {why}.", hint=self._next())
            planning = self._change.ask(order, by, now_s, self._fleet.plan)
        except FlightError as refusal:
            self._tell("keep their plan", f"refused: {refusal.message}")
            raise
        finally:
            self._zones_count()
        self._answer = self._loop.create_future()
        self._asked.put_nowait(planning)
        return order.sysids if isinstance(order, CloseRanks) else self._rest

    async def propose(self, order: PlanOrder) -> PlanForecast:
        """Return what an order would lead to now; nobody flies it. Raises as `ask` and `answer` do."""
        if why := self._why_not(order):
            raise FlightError(f"the formation would not {order}: {why}.", hint=self._next())
        begin_s = self._change.would_begin_s(order, self._now_s())
        # Whoever no longer waits for it leaves the planner's process as it is.
        found: PlanForecast = await asyncio.shield(asyncio.ensure_future(self._worker.call("propose", order, begin_s)))
        return found

    async def answer(self) -> str:
        """Return in words what came of the last order. Raises FlightError where it was refused."""
        if self._answer is None:
            raise FlightError("no change of the plan was asked.", hint="ask for one first")
        return await asyncio.shield(self._answer)

    async def run(self) -> None:
        """Plan what is asked, and brake where that is due, until cancelled."""
        beside = asyncio.ensure_future(self._look_ahead())
        try:
            if self._streams and not follows(self._loop):  # for emulated time the first order can wait as long
                await self._rehearse()
            while True:
                await self._carry_out(await self._asked.get())
        finally:
            await ended(beside, *([] if self._returns is None else [self._returns]))
            await self._worker.close()
            for left in () if self._folder is None else self._folder.glob("plan-*.made"):
                left.unlink(missing_ok=True)
            self._answered(FlightError("the flight is over.", hint="see its report"))

    async def _rehearse(self) -> None:
        """Build the programs now, so that the first order finds them built; a plan that has none says so when asked."""
        with suppress(Exception):
            self._change.rehearsed(await self._worker.call("rehearse"))

    async def _carry_out(self, planning: Planning) -> None:
        """Plan until a plan is in time, and fly it; or refuse."""
        if isinstance(planning.order, Avoid) and self._change.would_be_late(self._now_s()):
            await self._brake_together()
        order, began_s = self._with_zones(planning.order), time.perf_counter()  # emulated time stands
        self._change.begin(self._now_s())
        try:
            if isinstance(order, FlyHome) and await self._begin_return(planning, order, WAIT_S):
                return
            while (now := self._change.pending) is not None:
                made = await self._planned(order, now.begin_s)
                if why := self._why_not(order):
                    raise FlightError(f"{why}.")
                if self._change.in_time(self._now_s()):
                    self._fly(planning, made, time.perf_counter() - began_s)
                    break
            else:
                raise FlightError(
                    f"no plan was made in time in {ATTEMPTS} attempts, {time.perf_counter() - began_s:.1f} s."
                )
        except Exception as failure:  # no order ends a flight
            if isinstance(order, FlyHome) and await self._begin_return(planning, order, math.inf):
                return
            why = _reason(failure).rstrip(".")
            instead = self._change.refused(order, self._fleet.plan, self._now_s())
            self._zones_count()
            self._tell("keep their plan", f"not {order}: {why}; {instead}")
            self._answered(FlightError(f"the formation does not {order}: {why}; {instead}."))
            if isinstance(order, CloseRanks):
                self._stay_open(order.sysids)
            elif math.isfinite(self._change.brakes_at_s):
                await self._brake_together()
            return
        await self._adopt()

    def _with_zones(self, order: PlanOrder) -> PlanOrder:
        """A way home is planned round the zones that nothing else was planned round."""
        return replace(order, zones=self._change.zones) if isinstance(order, FlyHome) else order

    async def _planned(self, order: PlanOrder, begin_s: float) -> Replacement:
        """The plan that carries out an order; raises its reason where there is none."""
        name, given = f"plan-{self._count + 1}", self._change.given
        try:
            async with asyncio.timeout(_LIMIT_S):  # its process ends then, and another one takes its place
                made: Replacement = await self._worker.call("change", order, begin_s, name, given)
        except TimeoutError:
            raise FlightError(f"no plan was found in {_LIMIT_S:g} s.") from None
        return made

    async def _begin_return(self, planning: Planning, order: FlyHome, within_s: float) -> bool:
        """Have the formation go over to the next prepared return that begins within a time; return whether it does."""
        began_s = time.perf_counter()
        from_s, name = self._change.soonest_s(self._now_s()), f"plan-{self._count + 1}"
        asked = self._worker.call("fly_home", order, from_s, within_s, name, self._change.given)
        try:
            made: Replacement | None = await asked
        except Exception:  # it is planned
            return False
        if made is None or self._why_not(planning.order):
            return False
        if not self._change.can_begin(made.plan.t_start_s, self._now_s()):
            return False
        self._change.prepared()
        self._fly(planning, made, time.perf_counter() - began_s, "prepared before the flight, verified")
        await self._adopt()
        return True

    async def _brake_together(self) -> None:
        """Have the formation brake as one before new zones; else each vehicle does so by itself when it is due."""
        order, began_s = Hold(self._change.zones), time.perf_counter()
        now_s = self._now_s()
        planning = Planning(order, _OURSELVES, now_s, now_s, self._change.brake_begins_s(now_s))
        try:
            made = await self._planned(order, planning.begin_s)
        except Exception as failure:
            self._tell("do not brake as one", _reason(failure))
            return
        if not self._why_not(order) and self._change.can_begin(planning.begin_s, self._now_s()):
            self._fly(planning, made, time.perf_counter() - began_s)
            await self._adopt()

    def _fly(self, planning: Planning, made: Replacement, took_s: float, how: str = "planned and verified") -> None:
        fleet, new = self._fleet, made.plan
        flown = continued(fleet.plan, new)
        self._count += 1
        self._rest = new.sysids
        file = None
        if made.file is not None:
            file = made.file.with_name(f"plan-{self._count}.skein")
            with suppress(OSError):  # a full disk keeps nobody on a plan that leads into a zone
                made.file.replace(file)
        fleet.streamer.follow_plan(flown, made.stream)
        self._follow(flown)
        self._change.changed(planning.order, flown, new.t_start_s, self._now_s())
        self._worker.next_makes(PlanWorker, flown, self._folder, self._prepared, made.proposal)
        self._zones_count()
        words = f"{planning.order}, asked by {planning.by}; {how} in {took_s:.2f} s"
        data = {"order": str(planning.order), "asked_t_s": planning.asked_s, "begins_t_s": new.t_start_s}
        data |= {"planned_s": took_s, "file": None if file is None else file.name}
        self._tell(f"{NEW_PLAN} from t = {new.t_start_s:.2f} s on", words, data)
        if planning.by != _OURSELVES:
            self._answered(f"a new plan is flown from t = {new.t_start_s:.2f} s on: {words}")

    async def _adopt(self) -> None:
        """The planner goes on from the new plan; its returns are planned beside the next order."""
        try:
            await self._worker.call("adopt")
        except Exception:  # the next process begins with the new plan
            await self._worker.close()
        if self._returns is not None:
            await ended(self._returns)
        self._returns = asyncio.ensure_future(self._make_returns())
        if not follows(self._loop) and self._asked.empty():
            await self._rehearse()

    async def _make_returns(self) -> None:
        """Plan the returns of the flown plan, and compute its energy needs: that takes longer than planning."""
        plan = self._fleet.plan
        kinds = tuple(Autopilot(vehicle.session.autopilot) for vehicle in self._fleet.vehicles.values())
        try:
            returns = await in_own_process(plan_returns, plan, kinds)
        except Exception as failure:
            self._tell("have no new return altitudes", _reason(failure))
            return
        model = await model_of(plan)
        if plan is self._fleet.plan:  # else those of the next plan follow
            self._contingency.return_from(plan, returns, model)

    def _zones_count(self) -> None:
        """Zones that came up count for every way back, and for whether the plan may be gone on with."""
        self._contingency.operator.block(self._change.blocked)
        if self._came_up != (came_up := self._change.zones):
            self._came_up = came_up
            self._contingency.avoid(came_up)

    async def _look_ahead(self) -> None:
        """Close the ranks when a vehicle left, and brake in time. A failure of one stops neither."""
        while True:
            await self._fleet.time.comes_to(self._fleet.time.sure_s() + 0.1)
            for look in (self._brake, self._close_ranks):
                try:
                    look()
                except Exception as failure:
                    if (why := _reason(failure)) not in self._failed:
                        self._failed.add(why)
                        self._tell("are not looked after", why)

    def _brake(self) -> None:
        """Have the vehicles brake that fly the plan where it is due; one that flies it again later brakes then.

        Those that return or land by themselves are left at that.
        """
        if self._t0_s != self._fleet.monitor.t0_s:  # the plan waited: what is ahead is another part of it
            self._t0_s = self._fleet.monitor.t0_s
            self._change.watch(self._fleet.plan, self._now_s())
            self._zones_count()
        self._change.brakes(self._now_s())
        states = self._contingency.policy.states
        if self._change.has_braked and (flying := [i for i, state in states.items() if state in IN_FORMATION]):
            self._contingency.ask(AskedOrder.HOLD, flying, f"this program: {self._change.blocked}")

    def _close_ranks(self) -> None:
        """Have the others fly on without vehicles that are lost, or that fly or land by themselves."""
        states, options = self._contingency.policy.states, self._fleet.options
        gone = {i for i in self._rest if states[i] in _GONE}
        if options.on_loss is not OnLoss.CLOSE or not gone - self._gone or self._change.pending is not None:
            return
        self._gone |= gone
        if not (rest := tuple(i for i in self._rest if states[i] in IN_FORMATION)):
            return
        try:
            zones = tuple(zone for sysid in sorted(gone) for zone in self._zones_of(sysid, rest))
            self.ask(CloseRanks(rest, zones), _OURSELVES)
        except FlightError:
            self._stay_open(rest)
        except Exception:  # where it may be is not known
            self._stay_open(rest)
            raise

    def _zones_of(self, sysid: int, rest: tuple[int, ...]) -> tuple[NoFlyZone, ...]:
        """Where a vehicle that left may be from now on."""
        plan, view, now_s = self._fleet.plan, self._fleet.monitor.views[sysid], self._now_s()
        reference = self._fleet.streamer.streamed[sysid].reference
        state, row = self._contingency.policy.states[sysid], plan.sysids.index(sysid)
        if state is State.RETURNING and isinstance(reference, MotionReference):
            return (on_its_way(plan, reference, now_s),)
        stopped = where_it_stopped(plan, view.position_ned_m, view.velocity_ned_mps)
        if state is State.LANDING:
            return (stopped,)
        rtl_up_m = self._contingency.charge.returns.altitudes_m[row]
        return (stopped, *way_home(plan, row, view.position_ned_m, rtl_up_m, now_s, rest))

    def _stay_open(self, rest: tuple[int, ...]) -> None:
        """No plan for the rest: where a vehicle is lost the others land, else they keep theirs with its empty place."""
        states = self._contingency.policy.states
        if any(states[i] is State.LOST for i in set(self._rest) - set(rest)):
            self._contingency.ranks_stay_open()

    def _why_not(self, order: PlanOrder) -> str:
        """Why the formation cannot change its plan now, in words; empty if it can."""
        states = self._contingency.policy.states
        if not self._streams:
            return "missions on board keep the plan that was uploaded"
        if self._contingency.waits:
            return "the plan waits until all vehicles go on"
        needed = order.sysids if isinstance(order, CloseRanks) else self._rest
        if away := [sysid for sysid in needed if states[sysid] is not State.FLYING]:
            return f"vehicle {away[0]} is {states[away[0]].value}"
        return ""

    def _next(self) -> str:
        """What the operator can order instead: vehicles that wait do not go on into a new zone."""
        if not self._contingency.waits:
            return "order hold, return or land"
        return "order return or land" if self._change.blocked else "order continue, return or land"

    def _now_s(self) -> float:
        return self._fleet.time.sure_s() - self._fleet.monitor.t0_s

    def _tell(self, what: str, rule: str, data: dict[str, object] | None = None) -> None:
        now_s = self._fleet.time.sure_s()
        self._on_event(Event(now_s, now_s - self._fleet.monitor.t0_s, ALL_VEHICLES, what, rule, data))

    def _answered(self, answer: str | FlightError) -> None:
        if self._answer is None or self._answer.done():
            return
        if isinstance(answer, str):
            self._answer.set_result(answer)
            return
        self._answer.set_exception(answer)
        self._answer.exception()  # nobody may wait for it


def _reason(failure: Exception) -> str:
    return failure.message if isinstance(failure, GcsError) else f"{type(failure).__name__}: {failure}"
