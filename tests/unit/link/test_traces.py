"""Our ground station's side against recorded vehicles: the answers that a real upload got, we would have given.

`tests/recorded/mission_transfers` holds the mission messages of the recorded scenes, frame by frame.
"""

import gzip
import json
from pathlib import Path

import pytest

from gcs.autopilots.traits import Autopilot
from gcs.link.protocols.exchange import Exchange
from gcs.link.protocols.mission.item_messages import item_from_message
from gcs.link.protocols.mission.read_back import compare_missions
from gcs.link.protocols.mission.receiver import MissionReceiver
from gcs.link.protocols.mission.rules import MissionRefused
from gcs.link.protocols.mission.sender import MissionSender
from gcs.link.wire.codec import Codec
from gcs.link.wire.message import Station
from gcs.mavlink import MissionResult
from gcs.mission.model import MissionItem

TRACES = Path(__file__).parents[2] / "recorded" / "mission_transfers"
VEHICLE = Station(1, 1)
FILLER = MissionItem(16, 3, (0.0, 0.0, 0.0, 0.0), 0, 0, 0.0)
SCENES = [
    f"{autopilot}/{scene}"
    for autopilot in ("arducopter-4.5.6", "arducopter-4.7dev", "px4-1.17dev")
    for scene in ("mission_upload_ok", "mission_upload_bad")
]


def rows(scene):
    text = gzip.decompress((TRACES / f"{scene}.jsonl.gz").read_bytes())
    return [json.loads(line) for line in text.splitlines()]


def uploads(scene):
    """(title, rows between the note that begins an upload and the one that concludes it, result)."""
    title, kept = None, []
    for row in rows(scene):
        if row["dir"] == "note":
            if row["text"].startswith("upload:") or row["text"] == "upload":
                title, kept = row["text"], []
            elif row["text"] == "upload result" and title is not None:
                yield title, kept, row["result"]
                title = None
        elif title is not None and "hex" in row:
            kept.append(row)


def decoded(row):
    return Codec(255, 190).decode(bytes.fromhex(row["hex"]))


def plain_upload(kept):
    """Whether the script played a well-behaved sender: one count, each item as MISSION_ITEM_INT when asked."""
    ours = [r["name"] for r in kept if r["dir"] == "gcs->veh" and r["name"].startswith("MISSION_")]
    asked = [r["fields"]["seq"] for r in kept if r["name"].startswith("MISSION_REQUEST")]
    sent = [r["fields"]["seq"] for r in kept if r["name"] == "MISSION_ITEM_INT"]
    return ours.count("MISSION_COUNT") == 1 and set(ours) == {"MISSION_COUNT", "MISSION_ITEM_INT"} and asked == sent


def recorded_items(kept, count):
    items = {}
    for row in kept:
        if row["name"] == "MISSION_ITEM_INT":
            (message,) = decoded(row)
            items[message.fields["seq"]] = item_from_message(message)
    return [items.get(n, FILLER) for n in range(count)]


@pytest.mark.parametrize("scene", SCENES)
def test_our_sender_gives_the_recorded_answers_and_reaches_the_recorded_result(scene):
    replayed = 0
    for title, kept, result in uploads(scene):
        if not plain_upload(kept) or result not in MissionResult.__members__:
            continue
        replayed += 1
        offered = next(r for r in kept if r["name"] == "MISSION_COUNT")
        sender = MissionSender(recorded_items(kept, offered["fields"]["count"]), Exchange(VEHICLE, estimates=False))
        (count,) = sender.start(offered["t"])
        assert count.fields == offered["fields"], title
        answers = []
        for row in kept:
            if row["dir"] == "veh->gcs":
                for message in decoded(row):
                    answers += sender.receive(message, row["t"])
        wanted = [m for r in kept if r["name"] == "MISSION_ITEM_INT" for m in decoded(r)]
        assert [a.fields["seq"] for a in answers] == [w.fields["seq"] for w in wanted], title
        ours, theirs = map(item_from_message, answers), map(item_from_message, wanted)
        assert compare_missions(list(ours), list(theirs), autopilot=Autopilot.ARDUPILOT) == [], title
        assert sender.done, title
        if result == "ACCEPTED":
            assert sender.error is None, title
        else:
            assert isinstance(sender.error, MissionRefused), title
            assert MissionResult(sender.error.result).name == result, title
    assert replayed >= 1


@pytest.mark.parametrize("scene", SCENES[::2])
def test_our_receiver_downloads_what_was_uploaded(scene):
    all_rows = [r for r in rows(scene) if "hex" in r]
    begin = next(n for n, r in enumerate(all_rows) if r["name"] == "MISSION_COUNT" and r["dir"] == "veh->gcs")
    receiver = MissionReceiver(Exchange(VEHICLE, estimates=False))
    receiver.start(all_rows[begin]["t"])
    for row in all_rows[begin:]:
        if row["dir"] == "veh->gcs" and not receiver.done:
            for message in decoded(row):
                receiver.receive(message, row["t"])
    sent = recorded_items([r for r in all_rows[:begin] if r["dir"] == "gcs->veh"], receiver.count)
    first = 0 if scene.startswith("px4") else 1  # ArduPilot's item 0 becomes home
    assert compare_missions(sent[first:], receiver.items[first:], autopilot=Autopilot.ARDUPILOT) == []
