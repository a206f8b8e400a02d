"""Parameters of both autopilots: which names match, how integers travel, what is converted, refused, told unasked."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Message
from sim_bridge.personality import ARDUPILOT, PX4, Personality, Setting
from sim_bridge.protocol.param_server import BY_NAME, ParamServer, stored

UINT32, INT32, REAL32 = 5, 6, 9
BOTH = pytest.mark.parametrize("personality", [ARDUPILOT, PX4], ids=lambda p: p.name)


def bits(number: int) -> float:
    """An integer as the float that has its bytes."""
    return struct.unpack("<f", struct.pack("<i", number))[0]


def read(params: ParamServer, name: str, index: int = -1) -> list[Message]:
    return over_the_wire(params.receive(Message("PARAM_REQUEST_READ", {"param_id": name, "param_index": index})))


def write(params: ParamServer, name: str, value: float, kind: int = REAL32) -> list[Message]:
    fields = {"target_system": 3, "target_component": 1, "param_id": name, "param_value": value, "param_type": kind}
    (sent,) = Codec(3, 1).decode(Codec(255, 190).encode(Message("PARAM_SET", fields)))
    return over_the_wire(params.receive(sent))


def over_the_wire(messages: list[Message]) -> list[Message]:
    codec = Codec(3, 1)
    return [heard for message in messages for heard in Codec(255, 190).decode(codec.encode(message))]


def told(messages: list[Message]) -> tuple[str, float, int, int]:
    (message,) = messages
    f = message.fields
    return f["param_id"], f["param_value"], f["param_type"], f["param_index"]


def index_of(personality: Personality, name: str) -> int:
    return [param.name for param in personality.params].index(name)


@BOTH
def test_a_list_has_every_parameter_once_with_its_index(personality):
    listed = over_the_wire(ParamServer(personality, 3).receive(Message("PARAM_REQUEST_LIST", {})))
    numbered = [m for m in listed if m.fields["param_index"] != BY_NAME]
    assert [m.fields["param_id"] for m in numbered] == [param.name for param in personality.params]
    assert [m.fields["param_index"] for m in numbered] == list(range(len(personality.params)))
    assert {m.fields["param_count"] for m in listed} == {len(personality.params)}


@BOTH
def test_it_knows_its_own_system_id(personality):
    name = personality.param_traits.sysid
    params = ParamServer(personality, 7)
    assert params[name] == 7.0
    assert told(read(params, name))[1] == (bits(7) if personality is PX4 else 7.0)


@BOTH
def test_the_unknown_is_met_with_silence(personality):
    params = ParamServer(personality, 3)
    assert read(params, "NO_SUCH_PARAM") == []
    assert read(params, "", 32_000) == []
    assert write(params, "NO_SUCH_PARAM", 1.0) == []


@BOTH
def test_by_index_the_first_is_the_first(personality):
    first = personality.params[0]
    assert told(read(ParamServer(personality, 3), "", 0))[::3] == (first.name, 0)


def test_ardupilot_matches_any_case_echoes_it_and_tells_no_index():
    params = ParamServer(ARDUPILOT, 3)
    assert told(read(params, "guid_timeout")) == ("guid_timeout", 3.0, REAL32, BY_NAME)
    assert told(write(params, "Guid_Timeout", 2.5)) == ("Guid_Timeout", 2.5, REAL32, BY_NAME)
    assert params["GUID_TIMEOUT"] == 2.5


def test_px4_insists_on_case_and_tells_the_index():
    params = ParamServer(PX4, 3)
    assert read(params, "com_of_loss_t") == []
    index = index_of(PX4, "COM_OF_LOSS_T")
    assert told(read(params, "COM_OF_LOSS_T")) == ("COM_OF_LOSS_T", 1.0, REAL32, index)
    assert told(write(params, "COM_OF_LOSS_T", 2.0)) == ("COM_OF_LOSS_T", 2.0, REAL32, index)


def test_ardupilot_converts_what_has_another_type():
    params = ParamServer(ARDUPILOT, 3)
    assert told(write(params, "FS_OPTIONS", 1.4, REAL32)) == ("FS_OPTIONS", 1.0, INT32, BY_NAME)
    assert told(write(params, "FS_OPTIONS", 5.0, INT32))[1] == 5.0
    assert told(write(params, "FENCE_TYPE", 300.0))[1] == 127.0  # a signed byte
    assert told(write(params, "GUID_TIMEOUT", 2.0, INT32)) == ("GUID_TIMEOUT", 2.0, REAL32, BY_NAME)


def test_px4_keeps_its_value_when_the_type_is_wrong():
    params = ParamServer(PX4, 3)
    assert told(write(params, "COM_OBL_RC_ACT", bits(1), INT32))[1:3] == (bits(1), INT32)
    assert params["COM_OBL_RC_ACT"] == 1.0
    assert told(write(params, "COM_OBL_RC_ACT", 4.0, REAL32))[1:3] == (bits(1), INT32)
    assert told(write(params, "COM_OF_LOSS_T", bits(4), INT32))[1:3] == (1.0, REAL32)


def test_nan_is_refused_by_ardupilot_and_kept_by_px4():
    params = ParamServer(ARDUPILOT, 3)
    assert write(params, "GUID_TIMEOUT", math.nan) == []
    assert write(params, "GUID_TIMEOUT", math.inf) == []
    assert params["GUID_TIMEOUT"] == 3.0
    params = ParamServer(PX4, 3)
    assert math.isnan(told(write(params, "COM_OF_LOSS_T", math.nan))[1])
    assert math.isnan(told(read(params, "COM_OF_LOSS_T"))[1])
    assert params.setting(Setting.STREAM_TIMEOUT_S) == 1.0  # and no vehicle flies by it


@pytest.mark.parametrize("number", [0, 1, -1, 50, 4001, -2_147_483_648, 2_147_483_647])
def test_px4s_integers_survive_the_float(number):
    params = ParamServer(PX4, 3)
    (answer,) = write(params, "COM_OBL_RC_ACT", bits(number), INT32)
    assert params["COM_OBL_RC_ACT"] == number
    assert struct.pack("<f", answer.fields["param_value"]) == struct.pack("<i", number)


def test_px4s_list_is_headed_by_a_hash_that_changes_with_any_value():
    params = ParamServer(PX4, 3)

    def head() -> float:
        first = params.receive(Message("PARAM_REQUEST_LIST", {}))[0]
        assert told([first])[::3] == ("_HASH_CHECK", BY_NAME)
        assert first.fields["param_type"] == UINT32
        assert read(params, "_HASH_CHECK")[0].fields["param_index"] == BY_NAME
        return struct.unpack("<I", struct.pack("<f", first.fields["param_value"]))[0]

    before = head()
    assert before == head()
    write(params, "MPC_XY_CRUISE", 6.0)
    assert head() != before
    write(params, "MPC_XY_CRUISE", 5.0)
    assert head() == before


def test_ardupilot_has_no_hash():
    assert read(ParamServer(ARDUPILOT, 3), "_HASH_CHECK") == []


def test_what_the_vehicle_changes_itself_is_news_once():
    params = ParamServer(ARDUPILOT, 3)
    params.change("MIS_TOTAL", 4)
    params.change("MIS_TOTAL", 5)
    params.change("RALLY_TOTAL", 0)  # as it was
    assert [told([m])[:2] for m in params.changes()] == [("MIS_TOTAL", 4.0), ("MIS_TOTAL", 5.0)]
    assert params.changes() == []


def test_settings_are_in_si_units_and_within_bounds():
    params = ParamServer(ARDUPILOT, 3)
    write(params, "WPNAV_SPEED", 350.0)
    assert params.setting(Setting.CRUISE_MPS) == pytest.approx(3.5)
    write(params, "WPNAV_SPEED", 1e9)
    assert params.setting(Setting.CRUISE_MPS) == pytest.approx(20.0)
    assert params["WPNAV_SPEED"] == 1e9  # stored as it is
    with pytest.raises(KeyError):
        params.setting(Setting.BATTERY_LOW_SHARE)


@BOTH
def test_defaults_are_within_their_bounds_and_types(personality):
    for param in personality.params:
        assert param.low <= param.value <= param.high, param.name
        assert stored(param.value, param.kind) == pytest.approx(param.value), param.name
        assert len(param.name) <= 16, param.name


@BOTH
def test_no_two_parameters_decide_the_same(personality):
    setting = [param.sets for param in personality.params if param.sets is not None]
    assert len(setting) == len(set(setting))


@given(value=st.floats(allow_nan=True, allow_infinity=True), kind=st.sampled_from([1, 2, 3, 4, UINT32, INT32, REAL32]))
def test_anything_can_be_stored_or_refused(value, kind):
    if kind != REAL32 and not math.isfinite(value):
        return
    once = stored(value, kind)
    assert stored(once, kind) == once or math.isnan(once)


@BOTH
@given(
    value=st.floats(width=32),
    kind=st.integers(0, 12),
    name=st.sampled_from(["GUID_TIMEOUT", "FS_OPTIONS", "COM_OF_LOSS_T", "COM_OBL_RC_ACT"]),
)
def test_no_value_breaks_a_vehicle(personality, value, kind, name):
    params = ParamServer(personality, 3)
    write(params, name, value, kind)
    read(params, name)
    over_the_wire(params.receive(Message("PARAM_REQUEST_LIST", {})))
    assert math.isfinite(params.setting(Setting.STREAM_TIMEOUT_S))
