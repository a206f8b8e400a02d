"""Returns from any instant of a plan: boxes against the motion that is flown, and spans against brute force."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import gcs
from gcs.errors import UsageError
from gcs.mission.proving.break_off_returns import ReturnSeparation, returned
from gcs.mission.proving.plan_tracks import plan_tracks
from gcs.mission.proving.track import FleetMotion
from gcs.mission.returns.return_routes import ReturnRoutes
from gcs.mission.returns.routed_returns import routed_returns
from gcs.mission.returns.rtl_altitudes import plan_returns
from gcs.mission.returns.rtl_cases import ReturnTo
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.proof.subdivision import Looks, Proof, plain_cells, settle
from gcs.types import Array
from tests.unit.mission.proving.test_prove import check_of
from tests.unit.plan.problems import changed

RETURN = gcs.BreakOff("return")
DISK = {"north_m": 30.0, "east_m": 10.0, "radius_m": 6.0}
MOVING = DISK | {"radius_m": 3.0, "moves": [[0.0, 0.0, 0.0], [60.0, 20.0, -20.0]]}


def beside(plan: Plan, *zones: dict[str, object]) -> Plan:
    """The plan with zones on its way: its own flight does not keep out of them, its returns must."""
    return replace(plan, scenario=changed(plan.scenario, no_fly=list(zones)))


def families(plan: Plan) -> list[ReturnSeparation]:
    """Returns to homes, and to the nearest ends."""
    return returned(plan, FleetMotion.of(plan_tracks(plan), np.zeros(0)), None, 1.0)[1]


def places_m(family: ReturnSeparation, t_s: Array, after_s: Array) -> Array:
    """Places (V, N, M, 3) of returns from instants (N,) at times since (M,), as the ground station flies them."""
    plan, routes = family.plan, ReturnRoutes(family.plan)
    cases = {case.to: case for case in routed_returns(plan, routes, plan.clamped(t_s))}
    case = cases.get(family.to, cases[min(cases)])
    tops_m = plan.pads_ned_m[:, 2] - np.array(family.returns.altitudes_m)
    motion = case.motion(tops_m, family.returns.speeds)
    found = motion.places_at(np.tile(after_s, (len(motion.times_s), 1)))
    return found.reshape(len(plan.sysids), len(t_s), len(after_s), 3)


@pytest.mark.parametrize("zones", [(), (DISK,), (MOVING,)], ids=["free", "disk", "moving"])
def test_boxes_hold_every_return_of_a_span(hop: Plan, zones: tuple[dict[str, object], ...]) -> None:
    plan = beside(hop, *zones)
    rng, count = np.random.default_rng(0), 60
    for family in families(plan):
        edges_s = np.union1d(family.motion.edges_s, np.arange(-50.0, 200.0, 10.0))
        start_s = rng.uniform(plan.t_start_s, plan.t_end_s, count)
        lasts_s = np.where(rng.random(count) < 0.1, 0.0, 10.0 ** rng.uniform(-3.0, 0.0, count))
        inner_s = edges_s[np.minimum(np.searchsorted(edges_s, start_s, side="right"), len(edges_s) - 1)]
        end_s = np.minimum(start_s + lasts_s, np.minimum(inner_s, plan.t_end_s))
        begin_s = rng.uniform(0.0, 60.0, count)
        until_s = begin_s + 10.0 ** rng.uniform(-3.0, 1.0, count)
        row = rng.integers(0, len(plan.sysids), count)
        cells = plain_cells(np.stack([row, row], axis=1), start_s, end_s)
        (firsts, counts), tubes, (rows, _), sure = family._tubes(cells)
        assert sure[rows].sum() > (0.4 if zones else 0.9) * count
        bent = 0
        for n in np.flatnonzero(sure[rows]).tolist():
            option = firsts[rows[n]] + np.arange(counts[rows[n]])
            box = tubes.boxes(option, np.full(len(option), begin_s[n]), np.full(len(option), until_s[n]))
            flown = places_m(family, np.linspace(start_s[n], end_s[n], 4), np.linspace(begin_s[n], until_s[n], 6))[
                row[n]
            ]
            inside = np.all((flown[:, :, None] >= box.low - 1e-7) & (flown[:, :, None] <= box.high + 1e-7), axis=(1, 3))
            assert inside.any(axis=1).all(), (n, row[n], start_s[n], end_s[n], begin_s[n], until_s[n])
            bent += any(len(way) > 2 for way, _ in family._known[row[n], start_s[n], end_s[n]] or ())
        if family.to is ReturnTo.HOME:
            assert (bent > 0) == bool(zones)


@pytest.mark.slow
def test_returns_are_proved_or_the_spans_are_those_of_brute_force(hop: Plan) -> None:
    tracks = plan_tracks(hop)
    proved = gcs.prove(tracks, None, hop.scenario, abort=RETURN, plan=hop)
    assert proved.ok, proved
    names = [check.name for check in proved.checks if "return" in check.name and "separation" in check.name]
    assert len(names) == 3
    t_s = np.linspace(hop.t_start_s, hop.t_end_s, 400)
    for family in families(hop):
        flown = places_m(family, t_s, np.linspace(0.0, 80.0, 400))
        least_m = min(float(np.linalg.norm(flown[a] - flown[b], axis=-1).min()) for a, b in ((0, 1), (0, 2), (1, 2)))
        check = check_of(proved, f"separation, broken off to return to {family.to.words}")
        assert check.proved <= least_m + 1e-6
        assert check.limit == plan_returns(hop, hop.autopilots).required_m


def test_returns_are_those_of_a_plan_in_its_own_scenario(hop: Plan) -> None:
    tracks = plan_tracks(hop)
    with pytest.raises(UsageError, match="vehicles of a plan alone"):
        gcs.prove(tracks, None, hop.scenario, abort=RETURN)
    with pytest.raises(UsageError, match="own scenario"):
        gcs.prove(tracks, None, beside(hop, DISK).scenario, abort=RETURN, plan=hop)


@pytest.mark.parametrize("from_s", [20.0, 22.0, 36.0])
def test_returns_round_a_zone_are_proved_with_few_boxes(hop: Plan, from_s: float) -> None:
    """Where a way's duration is vague, instants are divided before times since: else there are millions of boxes."""
    family = families(beside(hop, DISK))[0]
    cells = family.cells()
    cells = cells[(cells.start_s >= from_s) & (cells.end_s <= from_s + 2.0)]
    assert len(cells)
    proof, looks = Proof.begun((1, 1), 2), Looks(1_500)
    settle(family, cells, proof, looks)
    assert looks.left > 0
    assert proof.proved[0, 0] > 0.0
    assert any(len(way) > 2 for options in family._known.values() for way, _ in options or ())


def test_what_a_time_limit_leaves_is_undecided_in_named_spans(hop: Plan) -> None:
    plan = beside(hop, DISK)
    report = gcs.prove(plan_tracks(plan), None, plan.scenario, abort=RETURN, plan=plan, limit_s=1e-3)
    check = check_of(report, "separation, broken off to return to home")
    assert check.verdict == "undecided"
    assert "time limit" in str(check)
    spans = [span for span in report.unsafe if span.name == check.name]
    assert spans
    assert {span.verdict for span in spans} == {"undecided"}
    assert min(span.start_s for span in spans) <= 10.0
    assert max(span.end_s for span in spans) >= 20.0
