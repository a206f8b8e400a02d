"""The messages that the station itself sends, and the one that vehicles are found by."""

from __future__ import annotations

from gcs.link.microservices.command import CommandSender
from gcs.link.wire.message import Message, Station
from gcs.mavlink import NO_AUTOPILOT, MavCommand, MavState, MavType, MessageId

STATION_HEARTBEAT = Message(
    "HEARTBEAT",
    {
        "type": int(MavType.GCS),
        "autopilot": NO_AUTOPILOT,
        "base_mode": 0,
        "custom_mode": 0,
        "system_status": int(MavState.ACTIVE),
        "mavlink_version": 3,
    },
)


def identity_request(station: Station) -> Message:
    """Return the request of AUTOPILOT_VERSION, which has the id of a vehicle."""
    (message,) = CommandSender(MavCommand.REQUEST_MESSAGE, (MessageId.AUTOPILOT_VERSION,), station).start(0.0)
    return message


def is_vehicle_heartbeat(message: Message) -> bool:
    """Whether this is the HEARTBEAT of an autopilot."""
    return (
        message.name == "HEARTBEAT"
        and message.fields["type"] != MavType.GCS
        and message.fields["autopilot"] != NO_AUTOPILOT
    )
