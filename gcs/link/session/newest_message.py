"""The newest message of one kind from a vehicle: streamed and fresh, else requested, else at an interval for a moment.

PX4 denies REQUEST_MESSAGE when the topic has nothing newer than its last message, so a denial proves nothing.
"""

from __future__ import annotations

from contextlib import suppress

from gcs.errors import GcsError, PeerError
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message
from gcs.mavlink import MavCommand, MessageId

FRESH_S = 3.0  # a streamed message this old still counts; the slowest streams send every 2 s
_INTERVAL_US = 200_000
_DEFAULT = 0  # SET_MESSAGE_INTERVAL: the autopilot's own rate


async def newest_message(session: VehicleSession, message_id: MessageId, fresh_s: float = FRESH_S) -> Message | None:
    """Return the last message of this kind if it is at most `fresh_s` old, else the next; None if none arrives.

    A message that is not fresh is requested once. If the request brings none, the message is streamed until one has
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
