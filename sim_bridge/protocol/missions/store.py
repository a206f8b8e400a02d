"""The missions, fence and rally points that one vehicle holds, and the transfers that bring and fetch them.

Knows: the habits of its make of autopilot (`MissionTraits`), who may transfer what at the same time. Does not know:
sockets, clocks (time is an argument), how items are flown.

Uploads: the vehicle pulls.

    MISSION_COUNT                    -> request of item 0         (or NO_SPACE, or busy)
    the item asked for               -> request of the next       (or a refusal, which ends it)
    the last item                    -> MISSION_ACK ACCEPTED
    another item                     -> `wrong_sequence`
    ask_again_s without the item     -> the same request
    give_up_s without any            -> `gave_up`

Downloads: MISSION_REQUEST_LIST is answered with MISSION_COUNT, each request with its item.
"""

from __future__ import annotations

from collections.abc import Callable

from gcs.errors import PeerError
from gcs.frames import Origin
from gcs.link.mission_protocol.item_messages import home_item, item_from_message, item_to_message
from gcs.link.mission_protocol.rules import mission_ack, mission_type_of
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionResult, MissionType, Severity
from gcs.mission.model import Home, MissionItem
from sim_bridge.protocol.missions.acceptance import (
    capacity,
    in_single_precision,
    in_wire_order,
    kept,
    too_few_vertices,
    types_meant,
    verdict,
)
from sim_bridge.protocol.missions.fence import count_shapes, encloses, what_is_wrong
from sim_bridge.protocol.missions.transfer_traits import Download, Keeping, MissionAnswer, MissionTraits, Upload

Say = Callable[[Severity, str], None]
Items = tuple[MissionItem, ...]


class MissionStore:
    """Items of all types of one vehicle.

    `on_change(mission type, items)` hears of every change, `say` gets what goes out as STATUSTEXT.
    """

    def __init__(
        self,
        me: Station,
        habits: MissionTraits,
        home: Origin,
        on_change: Callable[[int, Items], None],
        say: Say,
    ) -> None:
        self.home = home
        self.current_seq = 0  # the item that reads back as `current`
        self.rejects = False  # a fault: no item pleases
        self._me = me
        self._habits = habits
        self._on_change = on_change
        self._say = say
        self._items: dict[int, Items] = dict.fromkeys(habits.keeping, ())
        self._uploads: dict[int, Upload] = {}
        self._download: Download | None = None
        self._look_at_fence_s: float | None = None
        self._handlers: dict[str, Callable[[Message, int, float], list[Message]]] = {
            "MISSION_COUNT": self._offered,
            "MISSION_ITEM": self._taken,
            "MISSION_ITEM_INT": self._taken,
            "MISSION_ACK": self._acknowledged,
            "MISSION_CLEAR_ALL": self._cleared,
            "MISSION_REQUEST_LIST": self._listed,
            "MISSION_REQUEST": self._fetched,
            "MISSION_REQUEST_INT": self._fetched,
        }

    @property
    def busy(self) -> bool:
        """Whether a transfer is under way."""
        return bool(self._uploads) or self._download is not None

    @property
    def waits(self) -> bool:
        """Whether `tick` has something to watch."""
        return self.busy or self._look_at_fence_s is not None

    def items(self, mission_type: int = MissionType.MISSION) -> Items:
        """What is held; where home is item 0 of a flight mission, it is home as it is now."""
        return self._items[mission_type]

    def total(self, mission_type: int) -> int:
        """What the autopilot's parameter for the number of items says; a fence's shapes count too."""
        items = self._items[mission_type]
        return len(items) + (count_shapes(items) if mission_type == MissionType.FENCE else 0)

    def told(self, mission_type: int) -> list[Message]:
        """All items as they read back, addressed to nobody."""
        nobody = Station(0, 0)
        return [
            self._told(item, seq, nobody, mission_type) for seq, item in enumerate(self._items.get(mission_type, ()))
        ]

    def replace(self, mission_type: int, items: Items, *, start: int = 0, clear: bool = True) -> bool:
        """Take items all at once, as from a file, the first as item `start`, instead of all others or among them.

        False is a refusal. It may leave a part behind where items are kept as they come, as the original does.
        """
        keeping = self._habits.keeping[mission_type]
        held = () if clear else self._items[mission_type]
        if keeping.checks_shapes and what_is_wrong(items) is not None:
            return False
        if not (clear or keeping.item_by_item):
            return False
        for seq, item in enumerate(items, start):
            pleases = not self.rejects and verdict(item, keeping) == MissionResult.ACCEPTED
            if not pleases or too_few_vertices(item, keeping) or seq > len(held) or seq >= capacity(keeping):
                if keeping.item_by_item:
                    self._store(mission_type, held)
                return False
            held = in_wire_order(held, seq, kept(item, keeping))
        self._store(mission_type, held)
        return True

    def move_home(self, home: Origin) -> None:
        """Home is somewhere else now."""
        self.home = home
        items = self._items[MissionType.MISSION]
        if items and self._habits.home_is_item_0:
            self._items[MissionType.MISSION] = (self._home_item(), *items[1:])

    def remember(self, earlier: MissionStore) -> None:
        """Take over what was stored before a restart: of an upload that it broke, what had been stored by then."""
        for kind, items in earlier._items.items():
            self._store(kind, items)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer any MISSION_ message of a transfer."""
        handler = self._handlers.get(message.name)
        return handler(message, mission_type_of(message), now_s) if handler is not None else []

    def tick(self, now_s: float) -> list[Message]:
        """Timers of the transfers under way."""
        habits, messages = self._habits, list[Message]()
        for kind, upload in list(self._uploads.items()):
            if now_s - upload.heard_s > habits.give_up_s:
                del self._uploads[kind]
                messages += self._answer(habits.gave_up, _peer(upload), kind)
            elif now_s - upload.asked_s > habits.ask_again_s:
                messages += self._ask(upload, now_s)
        download = self._download
        if download is not None and now_s - download.heard_s > habits.give_up_s:
            self._download = None
            messages += self._answer(habits.gave_up, _peer(download), download.kind)
        if self._look_at_fence_s is not None and now_s >= self._look_at_fence_s:
            self._look_at_fence_s = None
            if not encloses(self._items[MissionType.FENCE], self.home):
                self._answer(habits.home_outside, self._me, MissionType.FENCE)
        return messages

    # Uploads

    def _offered(self, message: Message, kind: int, now_s: float) -> list[Message]:
        habits, peer, count = self._habits, message.source, message.fields["count"]
        upload = self._in_the_way(kind)
        if upload is not None and _peer(upload) != peer:
            return self._answer(habits.second_station, peer, kind)
        if upload is not None and not habits.restarts:
            upload.heard_s = now_s
            return self._answer(habits.busy, peer, upload.kind) if upload.seq else self._ask(upload, now_s)
        if self._download is not None:
            return self._answer(habits.busy, peer, kind)
        if kind not in self._items:
            return self._answer(habits.unknown_type, peer, kind)
        keeping = habits.keeping[kind]
        if count > capacity(keeping):
            return self._answer(habits.no_space, peer, kind)
        self._uploads.pop(kind, None)
        if keeping.item_by_item and count < len(self._items[kind]):
            self._store(kind, self._items[kind][:count])
        upload = Upload(*peer, kind, count, habits.int_requests, now_s, now_s)
        if not count:
            return self._complete(upload, now_s)
        self._uploads[kind] = upload
        return self._ask(upload, now_s)

    def _taken(self, message: Message, kind: int, now_s: float) -> list[Message]:
        habits, peer = self._habits, message.source
        upload = self._uploads.get(kind)
        if upload is None:
            busy = habits.one_at_a_time and self._uploads
            return [] if busy else self._answer(habits.unasked_item, peer, kind)
        if _peer(upload) != peer:
            return self._answer(habits.second_station, peer, kind)
        if message.fields["seq"] != upload.seq:
            upload.heard_s = now_s if habits.any_item_is_life else upload.heard_s
            return self._answer(habits.wrong_sequence, peer, kind)
        upload.heard_s = now_s
        keeping = habits.keeping[kind]
        try:
            item = item_from_message(in_single_precision(message) if habits.single_precision else message)
            result = MissionResult.INVALID if self.rejects else verdict(item, keeping)
        except PeerError:
            item, result = None, MissionResult.INVALID_PARAM5_X
        if item is None or result != MissionResult.ACCEPTED:
            del self._uploads[kind]
            return [mission_ack(peer, result, kind), *self._answer(habits.refused_item, peer, kind)]
        if too_few_vertices(item, keeping):
            del self._uploads[kind]
            return self._answer(habits.bad_shape, peer, kind)
        if message.name == "MISSION_ITEM":
            self._float_came(upload)
        item = kept(item, keeping)
        if keeping.item_by_item:
            self._store(kind, in_wire_order(self._items[kind], upload.seq, item))
        upload.items.append(item)
        if upload.seq < upload.count:
            return self._ask(upload, now_s)
        del self._uploads[kind]
        return self._complete(upload, now_s)

    def _complete(self, upload: Upload, now_s: float) -> list[Message]:
        kind, keeping = upload.kind, self._habits.keeping[upload.kind]
        wrong = what_is_wrong(upload.items) if keeping.checks_shapes else None
        if wrong is not None:
            self._say(*wrong)
            return self._answer(self._habits.bad_shape, _peer(upload), kind)
        if not keeping.item_by_item:
            self._store(kind, tuple(upload.items))
        if kind == MissionType.FENCE and self._habits.home_outside.text:
            self._look_at_fence_s = now_s + self._habits.home_outside_after_s
        if keeping.received:
            self._say(keeping.received_severity, keeping.received)
        return [mission_ack(_peer(upload), MissionResult.ACCEPTED, kind)]

    def _float_came(self, upload: Upload) -> None:
        if self._habits.follows_float:
            upload.int_requests = False
        if not upload.reproached:
            upload.reproached = True
            self._answer(self._habits.float_item, _peer(upload), upload.kind)

    def _in_the_way(self, kind: int) -> Upload | None:
        """The upload that a new one of this type would meet."""
        if self._habits.one_at_a_time:
            return next(iter(self._uploads.values()), None)
        return self._uploads.get(kind)

    def _ask(self, upload: Upload, now_s: float) -> list[Message]:
        upload.asked_s = now_s
        name = "MISSION_REQUEST_INT" if upload.int_requests else "MISSION_REQUEST"
        return [Message(name, {**_target(_peer(upload), upload.kind), "seq": upload.seq})]

    # Clearing

    def _cleared(self, message: Message, kind: int, _: float) -> list[Message]:
        habits, peer = self._habits, message.source
        kinds = types_meant(kind, tuple(self._items), clears_all=habits.clears_all)
        upload = self._in_the_way(kind)
        if upload is not None and _peer(upload) != peer:
            return self._answer(habits.second_station, peer, kind)
        if habits.one_at_a_time and self.busy:
            return self._answer(habits.busy, peer, kind)
        for one in kinds:
            self._uploads.pop(one, None)
            self._store(one, ())
            if habits.keeping[one].cleared:
                self._say(habits.keeping[one].received_severity, habits.keeping[one].cleared)
        return [mission_ack(peer, MissionResult.ACCEPTED if kinds else MissionResult.UNSUPPORTED, kind)]

    # Downloads

    def _listed(self, message: Message, kind: int, now_s: float) -> list[Message]:
        habits, peer = self._habits, message.source
        reading = self._download is not None and self._download.kind != kind
        if self._in_the_way(kind) is not None or reading:
            return self._answer(habits.read_while_busy, peer, kind)
        if kind not in self._items and habits.unknown_type_read is not None:
            return self._answer(habits.unknown_type_read, peer, kind)
        if not habits.stateless_reads:
            self._download = Download(*peer, kind, now_s)
        return [Message("MISSION_COUNT", {**_target(peer, kind), "count": len(self._items.get(kind, ()))})]

    def _fetched(self, message: Message, kind: int, now_s: float) -> list[Message]:
        habits, peer, seq = self._habits, message.source, message.fields["seq"]
        if self._in_the_way(kind) is not None:
            return self._answer(habits.read_while_busy, peer, kind)
        download = self._download
        if not habits.stateless_reads:
            if download is None or _peer(download) != peer or download.kind != kind:
                return []
            download.heard_s = now_s
            if seq not in (download.seq, download.seq - 1):
                self._download = None
                return self._answer(habits.unknown_item, peer, kind)
            download.seq = seq + 1
        items = self._items.get(kind, ())
        if seq >= len(items):
            self._download = None
            return self._answer(habits.unknown_item, peer, kind)
        return [self._told(items[seq], seq, peer, kind)]

    def _acknowledged(self, message: Message, kind: int, _: float) -> list[Message]:
        peer, result = message.source, message.fields["type"]
        if self._download is not None and _peer(self._download) == peer and self._download.kind == kind:
            self._download = None
        upload = self._uploads.get(kind)
        ends = self._habits.cancellable and result == MissionResult.OPERATION_CANCELLED
        if ends and upload is not None and _peer(upload) == peer:
            del self._uploads[kind]
        return []

    # Small steps

    def _told(self, item: MissionItem, seq: int, peer: Station, kind: int) -> Message:
        current = seq == self.current_seq and (seq > 0 or self._habits.first_is_current)
        message = item_to_message(item, seq, peer, current=current, mission_type=kind)
        message.fields["frame"] = self._habits.keeping[kind].told_frames.get(item.frame, item.frame)
        return message

    def _store(self, kind: int, items: Items) -> None:
        if items and kind == MissionType.MISSION and self._habits.home_is_item_0:
            items = (self._home_item(), *items[1:])
        self._items[kind] = items
        self._on_change(kind, items)

    def _home_item(self) -> MissionItem:
        return home_item(Home(self.home.lat_deg, self.home.lon_deg, self.home.alt_amsl_m))

    def _answer(self, answer: MissionAnswer, peer: Station, kind: int) -> list[Message]:
        keeping: Keeping | None = self._habits.keeping.get(kind)
        if answer.text:
            name = keeping.name if keeping is not None else ""
            self._say(answer.severity, answer.text.format(name=name, capacity=capacity(keeping)))
        return [mission_ack(peer, answer.result, kind)] if answer.result is not None else []


def _peer(transfer: Upload | Download) -> Station:
    return Station(transfer.peer_sysid, transfer.peer_compid)


def _target(peer: Station, kind: int) -> dict[str, int]:
    return {"target_system": peer.sysid, "target_component": peer.compid, "mission_type": kind}
