"""PING (https://mavlink.io/en/services/ping.html): a vehicle asks whether the station has read up to here."""

from __future__ import annotations

from gcs.link.wire.message import Message


def ping_answers(message: Message) -> list[Message]:
    """Return the answer to a request, which has no address; none to an answer."""
    fields = message.fields
    if fields["target_system"] or fields["target_component"]:
        return []
    return [Message("PING", {"time_usec": fields["time_usec"], "seq": fields["seq"]} | message.source.target)]
