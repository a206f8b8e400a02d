"""The status report of one vehicle: identity, health, position, battery and link quality.

Nothing is changed on board. A streamed message counts while it is fresh; any other one is requested. A message that
does not arrive gives None.
"""

import asyncio
import math
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

from gcs.autopilots.traits import autopilot_name, link_behaviour, mode_name
from gcs.errors import GcsError, PeerError
from gcs.link.protocols.timesync import TimeSample, TimeSync
from gcs.link.session.routing_table import identity
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import PREARM_CHECK, MavCommand, MavState, MessageId
from gcs.mavlink_names import sensor_names
from gcs.mission.model import Home

_ANSWER_S = 1.0
_EXCHANGES, _ATTEMPTS = 5, 4  # a busy radio answers late, or not at all
_EXCHANGE_S = 0.05
_LOOK_S = 1.0
REPEATED_S = 35.0  # within which an autopilot repeats its reasons
_UNKNOWN_mV = 0xFFFF
_VERSION_TYPES = {0: "-dev", 64: "-alpha", 128: "-beta", 192: "-rc", 255: ""}
FRESH_S = 3.0  # a streamed message this old still counts; the slowest streams send every 2 s
_INTERVAL_US = 200_000
_DEFAULT = 0  # SET_MESSAGE_INTERVAL: the autopilot's own rate


class ReportedWind(NamedTuple):
    """The wind that a vehicle estimates, horizontally; `from_deg` is where it comes from, 0 is north."""

    speed_mps: float
    from_deg: float


@dataclass(frozen=True)
class VehicleReport:
    """The present state of one vehicle. Angles in degrees, altitudes AMSL; None means not reported."""

    sysid: int
    system: int
    where: str
    autopilot: str
    version: str | None
    uid: str | None
    mode: str
    armed: bool
    state: str  # MAV_STATE
    prearm_ok: bool | None
    estimate_ok: bool | None
    ailing: tuple[str, ...] | None  # sensors that are enabled and not healthy
    home: Home | None
    position: Home | None
    origin: Home | None  # of its local frame
    satellites: int | None
    fix_type: int | None  # GPS_FIX_TYPE: 3 is a 3D fix, 6 is RTK fixed
    battery_share: float | None
    battery_V: float | None
    loss: float | None  # share of lost frames
    timesync: TimeSample | None
    heartbeat_age_s: float
    working: tuple[str, ...] | None = None  # sensors that are enabled and healthy
    mentioned_sensors: tuple[str, ...] = ()  # those that this autopilot flies without
    capacity_parameter: str | None = None  # the name of its battery's capacity
    capacity_mAh: float | None = None  # 0 or less: unknown on board
    critical_texts: tuple[str, ...] = ()  # STATUSTEXTs of severity CRITICAL or worse since it was found
    not_ready_texts: tuple[str, ...] = ()  # the reasons against arming of the last REPEATED_S; once ready, since then
    wind: ReportedWind | None = None  # ArduPilot's WIND or PX4's WIND_COV, where the vehicle streams it
    gnss_off_s: float = 0.0  # its GNSS time minus that of the other vehicles


async def status_report(session: VehicleSession, where: str = "") -> VehicleReport:
    """Return the report of one vehicle. It takes some round trips, at most a few seconds."""
    clock = asyncio.ensure_future(measure_clock(session))
    filter_id = session.estimator.message
    wanted = (
        MessageId.AUTOPILOT_VERSION,
        MessageId.SYS_STATUS,
        filter_id,
        MessageId.GPS_RAW_INT,
        MessageId.GLOBAL_POSITION_INT,
        MessageId.HOME_POSITION,
        MessageId.GPS_GLOBAL_ORIGIN,
    )
    fresh_s = dict.fromkeys(wanted, FRESH_S) | {MessageId.AUTOPILOT_VERSION: math.inf}  # which does not change
    reported = {message_id: await newest_message(session, message_id, fresh_s[message_id]) for message_id in wanted}
    version, status, receiver = (reported[i] for i in (wanted[0], wanted[1], wanted[3]))
    estimate = reported[filter_id]
    prearm_ok = _prearm_ok(status)
    estimate_ok = None if estimate is None else session.estimator.is_ready(estimate.name, estimate.fields)
    ready = prearm_ok is not False and estimate_ok is not False
    return VehicleReport(
        sysid=session.sysid,
        system=session.station.sysid,
        where=where,
        autopilot=autopilot_name(session.autopilot),
        version=None if version is None else version_text(version.fields["flight_sw_version"]),
        uid=None if version is None or not any(identity(version)) else identity(version).rstrip(b"\0").hex(),
        mode=mode_name(session.autopilot, session.custom_mode, session.kind),
        armed=session.armed,
        state=_state(session.latest["HEARTBEAT"].fields["system_status"]),
        prearm_ok=prearm_ok,
        estimate_ok=estimate_ok,
        ailing=None if status is None else _sensors(status, healthy=False),
        home=_position(reported[MessageId.HOME_POSITION], "latitude", "longitude", "altitude"),
        position=_position(reported[MessageId.GLOBAL_POSITION_INT], "lat", "lon", "alt"),
        origin=_position(reported[MessageId.GPS_GLOBAL_ORIGIN], "latitude", "longitude", "altitude"),
        fix_type=None if receiver is None else int(receiver.fields["fix_type"]),
        satellites=None if receiver is None else int(receiver.fields["satellites_visible"]),
        battery_share=_battery_share(status),
        battery_V=reported_V(status),
        loss=session.quality.loss,
        timesync=await clock,
        heartbeat_age_s=session.heartbeat_age_s(),
        working=None if status is None else _sensors(status, healthy=True),
        mentioned_sensors=tuple(sorted(link_behaviour(session.autopilot).mentioned_sensors)),
        critical_texts=session.texts.critical(session.ready_since_s),
        not_ready_texts=not_ready_texts(session, 0.0 if not ready else session.ready_since_s),
        wind=reported_wind(session),
    )


def reported_wind(session: VehicleSession) -> ReportedWind | None:
    """The wind that a vehicle streams; None where it streams none, or does not know it (NaN).

    It is not requested: most vehicles have no estimate on the ground, and each request would cost seconds.
    """
    if (own := session.fresh("WIND", FRESH_S)) is not None:
        speed_mps, from_deg = float(own.fields["speed"]), float(own.fields["direction"])
    elif (own := session.fresh("WIND_COV", FRESH_S)) is not None:
        north_mps, east_mps = float(own.fields["wind_x"]), float(own.fields["wind_y"])
        speed_mps, from_deg = math.hypot(north_mps, east_mps), math.degrees(math.atan2(-east_mps, -north_mps))
    else:
        return None
    known = math.isfinite(speed_mps) and math.isfinite(from_deg) and speed_mps >= 0.0
    return ReportedWind(speed_mps, from_deg % 360.0) if known else None


def not_ready_texts(session: VehicleSession, since_s: float | None) -> tuple[str, ...]:
    """The texts of the last 35 s in which the vehicle said why it cannot be armed, each once.

    Texts before `since_s` (event loop time) do not count; with None there are none.
    """
    now_s = asyncio.get_running_loop().time()
    return session.texts.startup(max(now_s - REPEATED_S, now_s if since_s is None else since_s))


async def until_reason(session: VehicleSession) -> None:
    """Wait until a vehicle that cannot be armed tells a reason, or can be; REPEATED_S at most."""
    with suppress(TimeoutError):
        async with asyncio.timeout(REPEATED_S):
            while not not_ready_texts(session, 0.0):
                if _prearm_ok(await newest_message(session, MessageId.SYS_STATUS)):
                    return
                await asyncio.sleep(_LOOK_S)


def _prearm_ok(status: Message | None) -> bool | None:
    return None if status is None else bool(status.fields["onboard_control_sensors_health"] & PREARM_CHECK)


async def measure_clock(session: VehicleSession) -> TimeSample | None:
    """Return the offset of the vehicle's boot clock and the round trip, by TIMESYNC; None without an answer."""
    loop = asyncio.get_running_loop()
    sync = TimeSync(session.station)
    answered = asyncio.Event()
    count = 0

    def receive(message: Message) -> None:
        nonlocal count
        if message.name == "TIMESYNC" and message.fields["tc1"]:
            sync.receive(message, loop.time())
            count += 1
            if count >= _EXCHANGES:
                answered.set()

    stop = session.subscribe(receive)
    try:
        for _ in range(_ATTEMPTS):
            for _ in range(_EXCHANGES):
                session.send(sync.request(loop.time()))
                await asyncio.sleep(_EXCHANGE_S)
            with suppress(TimeoutError):
                async with asyncio.timeout(_ANSWER_S):
                    await answered.wait()
            if sync.best is not None:
                break
    finally:
        stop()
    return sync.best


def version_text(version: int) -> str:
    """Return AUTOPILOT_VERSION.flight_sw_version as text: 4.5.6, 1.17.0-alpha."""
    kind = version & 0xFF
    return f"{version >> 24 & 0xFF}.{version >> 16 & 0xFF}.{version >> 8 & 0xFF}{_VERSION_TYPES.get(kind, '')}"


def _state(status: int) -> str:
    try:
        return MavState(status).name.lower()
    except ValueError:
        return f"state {status}"


def _sensors(status: Message, *, healthy: bool) -> tuple[str, ...]:
    fields = status.fields
    enabled, health = fields["onboard_control_sensors_enabled"], fields["onboard_control_sensors_health"]
    return sensor_names(enabled & (health if healthy else ~health) & ~PREARM_CHECK)


def _position(message: Message | None, lat: str, lon: str, alt: str) -> Home | None:
    if message is None or not (message.fields[lat] or message.fields[lon]):
        return None
    fields = message.fields
    return Home(fields[lat] / 1e7, fields[lon] / 1e7, fields[alt] / 1e3)


def _battery_share(status: Message | None) -> float | None:
    if status is None or status.fields["battery_remaining"] < 0:
        return None
    return float(status.fields["battery_remaining"]) / 100.0


def reported_V(status: Message | None) -> float | None:
    """Return the voltage in SYS_STATUS, V; None where it is not known."""
    if status is None or status.fields["voltage_battery"] in (0, _UNKNOWN_mV):
        return None
    return float(status.fields["voltage_battery"]) / 1e3


async def newest_message(session: VehicleSession, message_id: MessageId, fresh_s: float = FRESH_S) -> Message | None:
    """Return the last message of this kind if it is at most `fresh_s` old, else the next; None if none arrives.

    A message that is not fresh is requested once. PX4 denies this when the topic has nothing newer than its last
    message, so a denial proves nothing. If the request brings none, the message is streamed until one has
    arrived; then its interval is set back.
    """
    if (fresh := session.fresh(message_id.name, fresh_s)) is not None:
        return fresh
    timers = session.timers
    with suppress(PeerError):
        return await session.request_message(message_id, timers.status_reply_s, timers=timers.status)
    if (fresh := session.fresh(message_id.name, fresh_s)) is not None:  # it was streamed while the request failed
        return fresh
    with suppress(PeerError):
        return await _streamed_once(session, message_id)
    return None


async def _streamed_once(session: VehicleSession, message_id: MessageId) -> Message:
    """Raises `PeerError` if the vehicle refuses the interval or sends nothing."""
    name, timers = message_id.name, session.timers
    before_us = await _interval_us(session, message_id)
    found: list[Message] = []
    stop = session.subscribe(lambda message: found.append(message) if message.name == name else None)
    try:
        await session.command(MavCommand.SET_MESSAGE_INTERVAL, message_id, _INTERVAL_US, timers=timers.status)
        if not found:
            await session.wait_for(lambda message: message.name == name, 2.0 * timers.status_reply_s, name)
        return found[-1]
    finally:
        stop()
        with suppress(GcsError):
            await session.command(MavCommand.SET_MESSAGE_INTERVAL, message_id, before_us, timers=timers.status)


async def _interval_us(session: VehicleSession, message_id: MessageId) -> int:
    """Return the interval of a message, -1 if it is not streamed; the default if the vehicle does not report it."""
    answers: list[Message] = []

    def receive(message: Message) -> None:
        if message.name == "MESSAGE_INTERVAL" and message.fields["message_id"] == message_id:
            answers.append(message)

    stop = session.subscribe(receive)
    try:
        await session.command(MavCommand.GET_MESSAGE_INTERVAL, message_id, timers=session.timers.status)
        if not answers:
            await session.wait_for(
                lambda message: message.name == "MESSAGE_INTERVAL", session.timers.status_reply_s, "MESSAGE_INTERVAL"
            )
    except PeerError:
        return _DEFAULT
    finally:
        stop()
    return int(answers[-1].fields["interval_us"]) if answers else _DEFAULT
