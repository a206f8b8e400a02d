"""Parameters against both emulated autopilots' tables: values as values or as bits, silence, lost questions."""

from __future__ import annotations

import asyncio
import math
import random
import struct
from collections.abc import Sequence

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.errors import PeerError, PeerTimeout, UsageError
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.parameter_transfer import (
    REAL32,
    Parameter,
    ParameterReader,
    ParameterWriter,
    as_kind,
    decode,
    encode,
    set_request,
)
from gcs.link.session.upload_fleet import preview
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.link.wire.message import GROUND, Message, Station
from gcs.mavlink import ParameterType
from gcs.mission.model import Home, VehicleMission
from sim_bridge.personality import by_name
from sim_bridge.protocol.param_server import ParamServer

VEHICLE = Station(3, 1)
NAMES = {Autopilot.ARDUPILOT: ("RTL_ALT", "WPNAV_SPEED_UP", "FENCE_ENABLE", "RTL_LOIT_TIME", "FENCE_ALT_MAX"),
         Autopilot.PX4: ("RTL_RETURN_ALT", "MAV_SYS_ID", "GF_ACTION", "MPC_XY_CRUISE", "SYS_AUTOSTART")}  # fmt: skip
WHOLE = {Autopilot.ARDUPILOT: ("RTL_ALT", 2150), Autopilot.PX4: ("GF_ACTION", 3)}
BOTH = pytest.mark.parametrize("autopilot", [Autopilot.ARDUPILOT, Autopilot.PX4])


def table(autopilot):
    return ParamServer(by_name(autopilot.key), VEHICLE.sysid)


def talk(machine, params, loss=0.0, seed=0, meddle=lambda message: [message]):
    chance = random.Random(seed)
    now_s, out = 0.0, machine.start(0.0)
    while not machine.done:
        answers = []
        for message in out:
            if chance.random() >= loss:
                answers += params.receive(Message(message.name, message.fields, *GROUND))
        out = []
        now_s += 0.01
        for answer in answers:
            for heard in meddle(answer):
                if chance.random() >= loss:
                    out += machine.receive(Message(heard.name, heard.fields, *VEHICLE), now_s)
        if not out and not machine.done:
            now_s = machine.deadline_s
            out = machine.tick(now_s)
    return machine


@BOTH
@pytest.mark.parametrize("loss", [0.0, 0.4])
def test_parameters_are_read_and_set_and_put_back(autopilot, loss):
    params = table(autopilot)
    reader = talk(ParameterReader(NAMES[autopilot], Exchange(VEHICLE, autopilot)), params, loss)
    assert reader.error is None
    before = [reader.values[name] for name in NAMES[autopilot]]
    assert [p.value for p in before] == [params[name] for name in NAMES[autopilot]]
    name, value = WHOLE[autopilot]
    kind = reader.values[name].kind
    assert kind != REAL32
    writer = talk(ParameterWriter([Parameter(name, value, kind)], Exchange(VEHICLE, autopilot)), params, loss, 1)
    assert writer.error is None
    assert params[name] == value
    assert talk(ParameterWriter(before, Exchange(VEHICLE, autopilot)), params, loss, 2).error is None
    assert [params[p.name] for p in before] == [p.value for p in before]


def test_px4_puts_integers_as_bits_and_ardupilot_as_values():
    parameter = Parameter("X", 1, 6)
    assert encode(parameter, in_bytes=False) == 1.0
    assert struct.pack("<f", encode(parameter, in_bytes=True)) == b"\1\0\0\0"
    assert math.isnan(encode(Parameter("X", -1, 6), in_bytes=True)), "a number that is none may be an integer"
    for value in (0, 1, -1, 2**31 - 1, -(2**31), 12345):
        for in_bytes in (True, False):
            message = set_request(Parameter("X", value, 6), VEHICLE, in_bytes=in_bytes)
            told = Message("PARAM_VALUE", {**message.fields, "param_index": 0, "param_count": 1})
            exact = in_bytes or abs(value) < 2**24
            assert (decode(told, in_bytes=in_bytes).value == value) or not exact


def test_px4_says_the_old_value_to_a_set_of_the_wrong_type_and_is_not_believed():
    params = table(Autopilot.PX4)
    writer = talk(ParameterWriter([Parameter("GF_ACTION", 3.0, REAL32)], Exchange(VEHICLE, Autopilot.PX4)), params)
    assert "did not set GF_ACTION = 3: it reports 2" in str(writer.error)
    assert params["GF_ACTION"] == 2


@BOTH
def test_unknown_names_are_answered_by_silence_and_named(autopilot):
    names = (*NAMES[autopilot], "NO_SUCH_THING")
    reader = talk(ParameterReader(names, Exchange(VEHICLE, autopilot)), table(autopilot))
    assert isinstance(reader.error, PeerTimeout)
    assert "parameter NO_SUCH_THING" in reader.error.message


def test_old_news_and_other_names_do_not_settle_a_set():
    """PX4 pushes parameters as they change, and an answer to an earlier question may come late."""
    params = table(Autopilot.PX4)
    old = params.receive(Message("PARAM_REQUEST_READ", {"param_id": "GF_ACTION", "param_index": -1}))[0]
    other = params.receive(Message("PARAM_REQUEST_READ", {"param_id": "MPC_XY_CRUISE", "param_index": -1}))[0]
    writer = ParameterWriter([Parameter("GF_ACTION", 4, 6)], Exchange(VEHICLE, Autopilot.PX4))
    talk(writer, params, meddle=lambda message: [old, other, message])
    assert writer.error is None
    assert params["GF_ACTION"] == 4


@pytest.mark.parametrize(
    ("value", "kind"), [(math.nan, 9), (math.inf, 6), (1.5, 6), (300, 2), (-1, 1), (1e39, 9), (1, 8)]
)
def test_what_a_type_cannot_hold_is_refused_before_it_is_sent(value, kind):
    with pytest.raises(UsageError, match="X cannot be"):
        as_kind("X", value, kind)


def test_a_value_that_is_no_number_is_requested_again_and_told_if_it_stays():
    def reading(wrong):
        def meddle(message):
            bad = next(wrong, None)
            return [message if bad is None else Message(message.name, {**message.fields, "param_value": bad})]

        return talk(
            ParameterReader(["MPC_XY_CRUISE"], Exchange(VEHICLE, Autopilot.PX4)), table(Autopilot.PX4), 0, 0, meddle
        )

    assert reading(iter([math.nan, math.inf])).values["MPC_XY_CRUISE"].value == 5.0
    assert "vehicle 3 reports MPC_XY_CRUISE = nan" in str(reading(iter([math.nan] * 99)).error)


def test_answers_of_others_count_for_nothing():
    reader = ParameterReader(["RTL_ALT"], Exchange(VEHICLE, Autopilot.ARDUPILOT))
    reader.start(0.0)
    (told,) = table(Autopilot.ARDUPILOT).receive(
        Message("PARAM_REQUEST_READ", {"param_id": "RTL_ALT", "param_index": -1})
    )
    assert reader.receive(Message(told.name, told.fields, 4, 1), 0.1) == []
    assert not reader.done
    reader.receive(Message(told.name, told.fields, 3, 1), 0.1)
    assert reader.done
    reader = ParameterReader(["RTL_ALT"], Exchange(VEHICLE, Autopilot.ARDUPILOT))
    assert reader.cancel() == []
    assert isinstance(reader.error, PeerError)


class Reports:
    """A vehicle that reports one parameter so."""

    sysid = 3
    autopilot = Autopilot.ARDUPILOT.value

    def __init__(self, value: float, kind: int) -> None:
        self.reported = Parameter("RTL_ALT", value, kind)

    async def read_parameters(self, names: Sequence[str]) -> dict[str, Parameter]:
        return dict.fromkeys(names, self.reported)


@pytest.mark.parametrize(
    ("value", "kind", "words"),
    [
        (
            15,
            ParameterType.UINT8,
            "vehicle 3 reports RTL_ALT = 15. RTL_ALT cannot be 1700: on this vehicle it must be a whole number",
        ),
        (math.nan, REAL32, "vehicle 3 reports RTL_ALT = nan. RTL_ALT cannot be nan: it must be a finite number."),
    ],
)
def test_what_a_vehicle_cannot_hold_is_told_as_its_report(value: float, kind: int, words: str) -> None:
    load = VehicleLoad(VehicleMission(3, Home(0.0, 0.0, 0.0), (), ()), parameters=(("RTL_ALT", 1700),))
    with pytest.raises(PeerError) as refused:
        asyncio.run(preview({3: Reports(value, kind)}, [load]))
    assert words in refused.value.message
