"""One row for each autopilot, and no other place in gcs that asks which autopilot it is."""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

import gcs
from gcs.autopilots.ardupilot import ARDUPILOT
from gcs.autopilots.columns import AutopilotTraits, LinkBehaviour
from gcs.autopilots.protocol_timers import STANDARD, MissionTimers
from gcs.autopilots.px4 import PX4
from gcs.autopilots.stored_fields import StoredAs
from gcs.autopilots.traits import TRAITS, Autopilot, flight_behaviour, link_behaviour, traits_of
from gcs.errors import PeerError
from gcs.mavlink import MavType
from sim_bridge.personality import Intent, by_name

GCS = Path(gcs.__file__).parent
FILES = [file for file in sorted(GCS.rglob("*.py")) if "autopilots" not in file.relative_to(GCS).parts]
KEYS = {known.key for known in Autopilot}
NAMES = "|".join(known.name for known in Autopilot)
MEMBER = re.compile(rf"(\w+\.)*Autopilot(\.({NAMES})|\['({NAMES})'\])")
MENTIONED = re.compile("|".join(("autopilot", *KEYS)), re.IGNORECASE)  # without it `particular` finds nothing
ALLOWED = {("scenario/schema/scenario.py", "ardupilot")}  # the default of mission.autopilot, which users rely on


def particular(tree: ast.AST) -> Iterator[str]:
    """Expressions that name one autopilot: a member, a key, or the number of one."""
    for node in ast.walk(tree):
        text = ast.unparse(node) if isinstance(node, ast.expr) else ""
        match node:
            case ast.Attribute() | ast.Subscript() if MEMBER.fullmatch(text):
                yield text
            case ast.Constant(value=str(key)) if key in KEYS:
                yield key
            case ast.Compare(left, _, others) if "autopilot" in text.lower() and numbers(left, *others):
                yield text
            case ast.Call(args=args) if text.startswith("Autopilot(") and numbers(*args):
                yield text
            case ast.keyword(arg="autopilot", value=value) if numbers(value):
                yield f"autopilot={ast.unparse(value)}"


def numbers(*nodes: ast.AST) -> set[object]:
    """The numbers of autopilots among these expressions."""
    return {node.value for node in nodes if isinstance(node, ast.Constant)} & set(map(int, Autopilot))


def test_only_the_table_names_an_autopilot() -> None:
    for file in FILES:
        place, text = file.relative_to(GCS).as_posix(), file.read_text(encoding="utf-8")
        tree = ast.parse(text if MENTIONED.search(text) else "")
        found = [one for one in particular(tree) if (place, one) not in ALLOWED]
        assert not found, f"gcs/{place} asks for {found}: make it a column of gcs/autopilots/columns.py"


@pytest.mark.parametrize(
    "code",
    [
        "x is Autopilot.PX4",
        "x == traits.Autopilot.ARDUPILOT",
        "Autopilot['PX4']",
        "session.autopilot == 12",
        "Autopilot(3)",
        "f(autopilot=3)",
        "key == 'px4'",
    ],
)
def test_a_branch_on_an_autopilot_is_found(code: str) -> None:
    assert list(particular(ast.parse(code)))


@pytest.mark.parametrize("code", ["Autopilot(number)", "items == 12", "Autopilot.named(key)", "f(autopilot=held)"])
def test_a_lookup_is_no_branch(code: str) -> None:
    assert not list(particular(ast.parse(code)))


def test_every_autopilot_has_a_row() -> None:
    assert set(TRAITS) == set(Autopilot)
    for known in Autopilot:
        assert traits_of(int(known)) is known.traits
        assert link_behaviour(int(known)) is known.traits.link
        assert Autopilot.named(known.key) is known


def test_an_autopilot_without_a_row_has_careful_defaults() -> None:
    assert traits_of(4) is None
    assert link_behaviour(4) == LinkBehaviour()
    assert link_behaviour(4).requests_in_flight == 1
    assert link_behaviour(4).item_storage.of(21).z.stored is StoredAs.EXACT
    assert not link_behaviour(4).item_storage.of(21).param4.survives(0.0, 1.0)


@pytest.mark.parametrize("firmware", list(Autopilot))
def test_the_rows_agree_with_the_recorded_vehicles(firmware: Autopilot) -> None:
    recorded, link = by_name(firmware.key), firmware.traits.link
    assert link.home_is_item_0 == recorded.missions.home_is_item_0
    assert link.mission_files == recorded.missions.as_files
    assert link.integers_in_bytes == recorded.param_traits.bytes_in_float
    assert firmware.traits.missions.items_max <= recorded.missions.storage[0].capacity
    assert (firmware.traits.missions.altitude_decimals == 2) == (recorded.missions.storage[0].altitude_per_m == 100.0)
    assert firmware.traits.flight.takeoff_above_sea == recorded.flight.takeoff_above_sea
    names = {param.name: param.value for param in recorded.params}
    scale = {"ardupilot": 100.0, "px4": 1.0}[firmware.key]  # cm and cm/s
    altitude = {"ardupilot": "RTL_ALT", "px4": "RTL_RETURN_ALT"}[firmware.key]
    assert names[altitude] == firmware.traits.returns.default_altitude_m * scale


def test_timers_of_one_service_stand_in_one_table() -> None:
    """The wait for a MISSION_ACK, and what else both autopilots have in common."""
    for known in Autopilot:
        timers = known.traits.link.timers
        assert (timers.mission.reply_s, timers.mission.ack_s, timers.mission.give_up_s) == (1.5, 2.5, 9.0)
        assert replace(timers, mission=STANDARD.mission) == STANDARD
    with pytest.raises(ValueError, match="timers must be positive"):
        MissionTimers(reply_s=0.0)


@pytest.mark.parametrize(
    ("firmware", "parameter", "model", "unit"),
    [
        (Autopilot.ARDUPILOT, "WPNAV_ACCEL_Z", "vertical_mps2", 0.01),
        (Autopilot.ARDUPILOT, "WPNAV_JERK", "jerk_mps3", 1.0),
        (Autopilot.ARDUPILOT, "WPNAV_RADIUS", "radius_m", 0.01),
        (Autopilot.ARDUPILOT, "WPNAV_SPEED_DN", "sink_mps", 0.01),
        (Autopilot.ARDUPILOT, "WPNAV_SPEED_UP", "climb_mps", 0.01),
        (Autopilot.PX4, "MPC_ACC_DOWN_MAX", "down_mps2", 1.0),
        (Autopilot.PX4, "MPC_ACC_HOR", "acceleration_mps2", 1.0),
        (Autopilot.PX4, "MPC_ACC_UP_MAX", "up_mps2", 1.0),
        (Autopilot.PX4, "MPC_JERK_AUTO", "jerk_mps3", 1.0),
        (Autopilot.PX4, "MPC_XY_TRAJ_P", "turn_share", 1.0),
        (Autopilot.PX4, "MPC_XY_VEL_MAX", "fastest_mps", 1.0),
        (Autopilot.PX4, "MPC_Z_V_AUTO_DN", "sink_mps", 1.0),
        (Autopilot.PX4, "MPC_Z_V_AUTO_UP", "climb_mps", 1.0),
        (Autopilot.PX4, "NAV_ACC_RAD", "radius_m", 1.0),
        (Autopilot.PX4, "NAV_MC_ALT_RAD", "height_radius_m", 1.0),
    ],
)
def test_the_navigator_has_the_recorded_parameters(
    firmware: Autopilot, parameter: str, model: str, unit: float
) -> None:
    recorded = {param.name: param.value for param in by_name(firmware.key).params}
    assert getattr(firmware.navigator, model) == pytest.approx(recorded[parameter] * unit)


@pytest.mark.parametrize("firmware", list(Autopilot))
def test_the_row_and_the_navigator_climb_alike(firmware: Autopilot) -> None:
    navigator, (climb_mps, sink_mps) = firmware.navigator, firmware.traits.missions.climb_mps
    assert (navigator.climb_mps, navigator.sink_mps) == (climb_mps, sink_mps)  # type: ignore[attr-defined]


BOTH = pytest.mark.parametrize("firmware", list(Autopilot))
OTHER_NAMES = {"return": "rtl"}  # of PX4's modes, on the wire


@BOTH
def test_modes_have_the_intent_of_the_recorded_modes(firmware: Autopilot) -> None:
    modes, behaviour = by_name(firmware.key).modes, firmware.traits.flight
    wanted = {
        behaviour.guided: Intent.GUIDED,
        behaviour.mission: Intent.MISSION,
        behaviour.hold: Intent.HOLD,
        behaviour.land: Intent.LAND,
        behaviour.returning: Intent.RETURN,
    }
    for number, intent in wanted.items():
        mode = modes.numbered(number)
        assert mode is not None
        assert mode.intent is intent
    armed_in = modes.numbered(behaviour.armed_in)
    assert armed_in is not None
    assert armed_in.armable
    assert behaviour.two_part_modes == modes.two_part


@BOTH
def test_every_recorded_mode_has_its_name(firmware: Autopilot) -> None:
    for mode in by_name(firmware.key).modes.known:
        name = mode.name.lower()
        assert firmware.traits.flight.mode_name(mode.number).lower() == OTHER_NAMES.get(name, name)


def test_every_published_mode_has_its_own_name() -> None:
    """Copter 4.5 to 4.7 use all numbers up to 29 but these; PX4's are those of its `px4_custom_mode.h`."""
    for firmware, numbers in (
        (ARDUPILOT, sorted({*range(30)} - {8, 10, 12})),
        (
            PX4,
            [main << 16 for main in range(1, 12)]
            + [3 << 16 | sub << 24 for sub in (1, 2)]
            + [4 << 16 | sub << 24 for sub in range(1, 19)],
        ),
    ):
        names = [firmware.flight.mode_name(number) for number in numbers]
        assert not [name for name in names if "mode" in name.lower()]
        assert len(set(names)) == len(names)
        assert sorted(firmware.flight.mode_names) == sorted(numbers)


@pytest.mark.parametrize(
    ("firmware", "number", "name"),
    [
        (PX4, 196608, "POSITION"),  # its failsafe's mode after a lost setpoint stream
        (PX4, 3 << 16 | 1 << 24, "ORBIT"),
        (PX4, 4 << 16 | 9 << 24, "PRECLAND"),
        (PX4, 4 << 16 | 18 << 24, "EXTERNAL8"),
        (PX4, 10 << 16, "TERMINATION"),
        (PX4, 4 << 16 | 99 << 24, "AUTO"),
        (PX4, 99 << 16 | 1 << 24, "mode 99.1"),
        (ARDUPILOT, 27, "AUTO_RTL"),
        (ARDUPILOT, 29, "RATE_ACRO"),
        (ARDUPILOT, 30, "mode 30"),
    ],
)
def test_names_of_modes(firmware: AutopilotTraits, number: int, name: str) -> None:
    assert firmware.flight.mode_name(number) == name


def test_modes_as_commands() -> None:
    ardupilot, px4 = ARDUPILOT.flight, PX4.flight
    assert ardupilot.mode_parameters(ardupilot.land) == (1.0, 9.0)
    assert px4.mode_parameters(px4.land) == (1.0, 4.0, 6.0)
    assert px4.mode_parameters(px4.guided) == (1.0, 6.0, 0.0)


def test_altitudes_of_take_off() -> None:
    assert ARDUPILOT.flight.takeoff_parameters(3.0, 488.0)[6] == 3.0
    assert PX4.flight.takeoff_parameters(3.0, 488.0)[6] == 491.0
    assert math.isnan(PX4.flight.takeoff_parameters(3.0, 488.0)[4])  # at the position it has


@BOTH
def test_ready_as_the_recordings_show_it(firmware: Autopilot) -> None:
    health, estimator = by_name(firmware.key).health, firmware.traits.link.estimator
    name = estimator.message.name
    assert not estimator.is_ready(name, {"flags": int(health.before_ready)})
    assert estimator.is_ready(name, {"flags": int(health.ready)})
    assert not estimator.is_ready("HEARTBEAT", {})


def test_an_autopilot_that_is_not_in_the_table() -> None:
    assert flight_behaviour(1, 3, MavType.QUADROTOR) is ARDUPILOT.flight
    assert flight_behaviour(1, 12, MavType.HEXAROTOR) is PX4.flight
    assert flight_behaviour(1, 3, MavType.GENERIC) is ARDUPILOT.flight  # before it knows its frame
    with pytest.raises(PeerError, match="vehicle 7 runs autopilot number 4"):
        flight_behaviour(7, 4, MavType.QUADROTOR)


@pytest.mark.parametrize(("kind", "words"), [(1, "fixed wing"), (10, "ground rover"), (12, "vehicle of another kind")])
def test_a_plane_or_rover_is_not_flown_by_the_modes_of_a_copter(kind: int, words: str) -> None:
    with pytest.raises(PeerError, match=f"vehicle 7 is a {words}"):
        flight_behaviour(7, 3, kind)
