"""The missions, fence and rally points of one vehicle, and their uploads and downloads. Time is an argument.

Uploads: the vehicle requests every item.

    MISSION_COUNT                    -> request of item 0         (or NO_SPACE, or busy)
    the requested item               -> request of the next       (or a refusal, which ends the upload)
    the last item                    -> MISSION_ACK ACCEPTED
    MISSION_WRITE_PARTIAL_LIST       -> request of the first item of the range
    another item                     -> `wrong_sequence`
    retry_s without the item         -> the same request
    timeout_s without any item       -> `timed_out`

Downloads: MISSION_REQUEST_LIST is answered with MISSION_COUNT, each request with its item.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from gcs.errors import PeerError
from gcs.frames import Origin
from gcs.link.protocols.mission.item_messages import home_item, item_from_message, item_to_message
from gcs.link.protocols.mission.rules import mission_ack, mission_type_of
from gcs.link.wire.message import Message, Station
from gcs.mavlink import MissionResult, MissionType, Severity
from gcs.mission.model import Home, MissionItem
from sim_bridge.missions.acceptance import as_reported_m, as_stored, in_single_precision, item_result, too_few_vertices
from sim_bridge.missions.fence import count_shapes, encloses, places, what_is_wrong
from sim_bridge.missions.transfer_traits import MissionAnswer, MissionTraits, StorageTraits
from sim_bridge.missions.transfers import Download, Upload, addressed

SendText = Callable[[Severity, str], None]
Items = tuple[MissionItem, ...]


class MissionStore:
    """The items of all mission types of one vehicle.

    `on_change(mission type, items)` is called on every change, `send_text` for every STATUSTEXT. `current_seq` tells
    which item reads back as `current`.
    """

    def __init__(
        self,
        me: Station,
        traits: MissionTraits,
        home: Origin,
        on_change: Callable[[int, Items], None],
        send_text: SendText,
        current_seq: Callable[[], int] = lambda: 0,
    ) -> None:
        self.home = home
        self.rejects = False  # a fault: every item is refused
        self._current_seq = current_seq
        self._me = me
        self._traits = traits
        self._on_change = on_change
        self._send_text = send_text
        self._items: dict[int, Items] = dict.fromkeys(traits.storage, ())
        self._uploads: dict[int, Upload] = {}
        self._download: Download | None = None
        self._check_fence_s: float | None = None
        self._check_rally_s: float | None = None  # while there are points that it cannot return to
        self._handlers: dict[str, Callable[[Message, int, float], list[Message]]] = {
            "MISSION_COUNT": self._on_count,
            "MISSION_WRITE_PARTIAL_LIST": self._on_partial_write,
            "MISSION_ITEM": self._on_item,
            "MISSION_ITEM_INT": self._on_item,
            "MISSION_ACK": self._on_ack,
            "MISSION_CLEAR_ALL": self._on_clear_all,
            "MISSION_REQUEST_LIST": self._on_request_list,
            "MISSION_REQUEST": self._on_request,
            "MISSION_REQUEST_INT": self._on_request,
        }

    @property
    def busy(self) -> bool:
        """Whether a transfer is under way."""
        return bool(self._uploads) or self._download is not None

    @property
    def waits(self) -> bool:
        """Whether `tick` has a timer to watch."""
        return self.busy or self._check_fence_s is not None or self._check_rally_s is not None

    @property
    def file_leftovers(self) -> bool:
        """Whether its files have leftovers in items without a position."""
        return self._traits.file_leftovers

    def items(self, mission_type: int = MissionType.MISSION) -> Items:
        """The stored items; where home is item 0 of a mission, it is the present home."""
        return self._items[mission_type]

    def total(self, mission_type: int) -> int:
        """The value of the autopilot's parameter for the number of items; it also counts the shapes of a fence."""
        items = self._items[mission_type]
        return len(items) + (count_shapes(items) if mission_type == MissionType.FENCE else 0)

    def read_back(self, mission_type: int) -> list[Message]:
        """Return all items as they read back, without an addressee."""
        no_peer = Station(0, 0)
        return [
            self._read_back_message(item, seq, no_peer, mission_type)
            for seq, item in enumerate(self._items.get(mission_type, ()))
        ]

    def replace(self, mission_type: int, items: Items, *, start: int = 0, clear: bool = True) -> bool:
        """Store items all at once, as from a file: the first as item `start`, in place of all others or among them.

        Return False on a refusal. Where items are stored one by one, a part of them may remain, as on the original.
        """
        storage = self._traits.storage[mission_type]
        held = () if clear else self._items[mission_type]
        if storage.checks_shapes and what_is_wrong(items) is not None:
            return False
        if not (clear or storage.item_by_item):
            return False
        for seq, item in enumerate(items, start):
            accepted = not self.rejects and item_result(item, storage) == MissionResult.ACCEPTED
            if not accepted or too_few_vertices(item, storage) or seq > len(held) or seq >= storage.capacity:
                if storage.item_by_item:
                    self._hold(mission_type, held)
                return False
            held = (*held[:seq], as_stored(item, storage), *held[seq + 1 :])
        self._hold(mission_type, held)
        return True

    def suffer(self, *, rejects: bool) -> None:
        """Have this fault from now on, or not any more."""
        self.rejects = rejects

    def move_home(self, home: Origin) -> None:
        """Set home."""
        self.home = home
        items = self._items[MissionType.MISSION]
        if items and self._traits.home_is_item_0:
            self._items[MissionType.MISSION] = (self._home_item(), *items[1:])

    def remember(self, earlier: MissionStore) -> None:
        """Take over the items from before a restart; of an interrupted upload, those that were stored."""
        for kind, items in earlier._items.items():
            self._hold(kind, items)

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer any MISSION_ message of a transfer."""
        handler = self._handlers.get(message.name)
        return handler(message, mission_type_of(message), now_s) if handler is not None else []

    def tick(self, now_s: float) -> list[Message]:
        """Check the timers of the transfers under way; return the messages to send."""
        traits, messages = self._traits, list[Message]()
        for kind, upload in list(self._uploads.items()):
            if now_s - upload.heard_s > traits.timeout_s:
                del self._uploads[kind]
                messages += self._answer(traits.timed_out, upload.peer, kind)
            elif now_s - upload.requested_s > traits.retry_s:
                messages.append(upload.request(now_s))
        download = self._download
        if download is not None and now_s - download.heard_s > traits.timeout_s:
            self._download = None
            messages += self._answer(traits.timed_out, download.peer, download.kind)
        if self._check_fence_s is not None and now_s >= self._check_fence_s:
            self._check_fence_s = None
            if not encloses(self._items[MissionType.FENCE], self.home):
                self._answer(traits.home_outside, self._me, MissionType.FENCE)
        if self._check_rally_s is not None and now_s >= self._check_rally_s:
            self._check_rally_s = now_s + traits.rally_refused_every_s
            self._refuse_rally_points()
        return messages

    def usable_rally(self, items: Items) -> Items:
        """Return the rally points that the vehicle can return to."""
        frames = self._traits.rally_frames
        return tuple(item for item in items if frames is None or item.frame in frames)

    def _refuse_rally_points(self) -> None:
        """Say of every rally point that it cannot be returned to; those close to home are not looked at."""
        points = self._items[MissionType.RALLY]
        refused = [item for item in points if item not in self.usable_rally(points)]
        if refused:
            away_m = np.hypot(*places(refused, self.home).T)
            for _ in range(int(np.count_nonzero(away_m > self._traits.rally_from_home_m))):
                self._answer(self._traits.rally_refused, self._me, MissionType.RALLY)

    # Uploads

    def _on_count(self, message: Message, kind: int, now_s: float) -> list[Message]:
        traits, peer, count = self._traits, message.source, message.fields["count"]
        upload = self._conflicting_upload(kind)
        if upload is not None and upload.peer != peer:
            return self._answer(traits.second_station, peer, kind)
        if upload is not None and not traits.restarts:
            upload.hear(now_s)
            return self._answer(traits.busy, peer, upload.kind) if upload.seq else [upload.request(now_s)]
        if self._download is not None:
            return self._answer(traits.busy, peer, kind)
        if kind not in self._items:
            return self._answer(traits.unknown_type, peer, kind)
        storage = traits.storage[kind]
        if count > storage.capacity:
            return self._answer(traits.no_space, peer, kind)
        self._uploads.pop(kind, None)
        if storage.item_by_item and count < len(self._items[kind]):
            self._hold(kind, self._items[kind][:count])
        upload = Upload(peer, kind, count, traits.int_requests, now_s, now_s)
        if not count:
            return self._complete(upload, now_s)
        self._uploads[kind] = upload
        return [upload.request(now_s)]

    def _on_partial_write(self, message: Message, kind: int, now_s: float) -> list[Message]:
        traits, peer = self._traits, message.source
        if not traits.partial_writes:
            return []
        first, last = int(message.fields["start_index"]), int(message.fields["end_index"])
        one_by_one = kind in self._items and traits.storage[kind].item_by_item
        if not one_by_one or not 0 <= first <= last <= len(self._items[kind]):
            return self._answer(traits.bad_range, peer, kind)
        # Even an upload of another ground station gives way to it.
        upload = Upload(peer, kind, last + 1, traits.int_requests, now_s, now_s, first=first)
        self._uploads[kind] = upload
        return [upload.request(now_s)]

    def _on_item(self, message: Message, kind: int, now_s: float) -> list[Message]:
        traits, peer = self._traits, message.source
        upload = self._uploads.get(kind)
        if upload is None:
            busy = traits.one_at_a_time and self._uploads
            return [] if busy else self._answer(traits.unrequested_item, peer, kind)
        if upload.peer != peer:
            return self._answer(traits.second_station, peer, kind)
        if message.fields["seq"] != upload.seq:
            if traits.any_item_resets_timeout:
                upload.hear(now_s)
            return self._answer(traits.wrong_sequence, peer, kind)
        upload.hear(now_s)
        storage = traits.storage[kind]
        try:
            item = item_from_message(in_single_precision(message) if traits.single_precision else message)
            result = MissionResult.INVALID if self.rejects else item_result(item, storage)
        except PeerError:
            item, result = None, MissionResult.INVALID_PARAM5_X
        if item is None or result != MissionResult.ACCEPTED:
            del self._uploads[kind]
            return [mission_ack(peer, result, kind), *self._answer(traits.refused_item, peer, kind)]
        if too_few_vertices(item, storage):
            del self._uploads[kind]
            return self._answer(traits.bad_shape, peer, kind)
        if message.name == "MISSION_ITEM" and upload.take_float(follows=traits.follows_float):
            self._answer(traits.float_item, peer, kind)
        item = as_stored(item, storage, message.fields["frame"])
        if storage.item_by_item:
            held = self._items[kind]
            self._hold(kind, (*held[: upload.seq], item, *held[upload.seq + 1 :]))
        upload.items.append(item)
        if upload.seq < upload.count:
            return [upload.request(now_s)]
        del self._uploads[kind]
        return self._complete(upload, now_s)

    def _complete(self, upload: Upload, now_s: float) -> list[Message]:
        kind, storage = upload.kind, self._traits.storage[upload.kind]
        wrong = what_is_wrong(upload.items) if storage.checks_shapes else None
        if wrong is not None:
            self._send_text(*wrong)
            return self._answer(self._traits.bad_shape, upload.peer, kind)
        if not storage.item_by_item:
            self._hold(kind, tuple(upload.items))
        if kind == MissionType.FENCE and self._traits.home_outside.text:
            self._check_fence_s = now_s + self._traits.home_outside_after_s
        if storage.received:
            self._send_text(storage.received_severity, storage.received)
        return [mission_ack(upload.peer, MissionResult.ACCEPTED, kind)]

    def _conflicting_upload(self, kind: int) -> Upload | None:
        """Return the upload under way that a new one of this type would conflict with."""
        if self._traits.one_at_a_time:
            return next(iter(self._uploads.values()), None)
        return self._uploads.get(kind)

    # Clearing

    def _on_clear_all(self, message: Message, kind: int, _: float) -> list[Message]:
        traits, peer = self._traits, message.source
        every = kind == MissionType.ALL and traits.clears_all
        kinds = [known for known in self._items if every or known == kind]
        upload = self._conflicting_upload(kind)
        if upload is not None and upload.peer != peer:
            return self._answer(traits.second_station, peer, kind)
        if traits.one_at_a_time and self.busy:
            return self._answer(traits.busy, peer, kind)
        for one in kinds:
            self._uploads.pop(one, None)
            self._hold(one, ())
            if traits.storage[one].cleared:
                self._send_text(traits.storage[one].received_severity, traits.storage[one].cleared)
        return [mission_ack(peer, MissionResult.ACCEPTED if kinds else MissionResult.UNSUPPORTED, kind)]

    # Downloads

    def _on_request_list(self, message: Message, kind: int, now_s: float) -> list[Message]:
        traits, peer = self._traits, message.source
        reading = self._download is not None and self._download.kind != kind
        if self._conflicting_upload(kind) is not None or reading:
            return self._answer(traits.read_while_busy, peer, kind)
        if kind not in self._items and traits.unknown_type_read is not None:
            return self._answer(traits.unknown_type_read, peer, kind)
        if not traits.stateless_reads:
            self._download = Download(peer, kind, now_s)
        return [Message("MISSION_COUNT", {**addressed(peer, kind), "count": len(self._items.get(kind, ()))})]

    def _on_request(self, message: Message, kind: int, now_s: float) -> list[Message]:
        traits, peer, seq = self._traits, message.source, message.fields["seq"]
        if self._conflicting_upload(kind) is not None:
            return self._answer(traits.read_while_busy, peer, kind)
        download = self._download
        if not traits.stateless_reads:
            if download is None or download.peer != peer or download.kind != kind:
                return []
            if not download.expects(seq, now_s):
                self._download = None
                return self._answer(traits.unknown_item, peer, kind)
        items = self._items.get(kind, ())
        if seq >= len(items):
            self._download = None
            return self._answer(traits.unknown_item, peer, kind)
        return [self._read_back_message(items[seq], seq, peer, kind)]

    def _on_ack(self, message: Message, kind: int, _: float) -> list[Message]:
        peer, result = message.source, message.fields["type"]
        if self._download is not None and self._download.peer == peer and self._download.kind == kind:
            self._download = None
        upload = self._uploads.get(kind)
        ends = self._traits.cancellable and result == MissionResult.OPERATION_CANCELLED
        if ends and upload is not None and upload.peer == peer:
            del self._uploads[kind]
        return []

    # Helpers

    def _read_back_message(self, item: MissionItem, seq: int, peer: Station, kind: int) -> Message:
        current = seq == self._current_seq() and (seq > 0 or self._traits.first_is_current)
        message = item_to_message(item, seq, peer, current=current, mission_type=kind)
        storage = self._traits.storage[kind]
        message.fields["frame"] = storage.read_back_frames.get(item.frame, item.frame)
        if storage.altitude_per_m is not None:
            message.fields["z"] = as_reported_m(item.alt_m, storage.altitude_per_m)
        return message

    def _hold(self, kind: int, items: Items) -> None:
        if items and kind == MissionType.MISSION and self._traits.home_is_item_0:
            items = (self._home_item(), *items[1:])
        self._items[kind] = items
        if kind == MissionType.RALLY:
            self._check_rally_s = 0.0 if len(self.usable_rally(items)) < len(items) else None
        self._on_change(kind, items)

    def _home_item(self) -> MissionItem:
        return home_item(Home(self.home.lat_deg, self.home.lon_deg, self.home.alt_amsl_m))

    def _answer(self, answer: MissionAnswer, peer: Station, kind: int) -> list[Message]:
        storage: StorageTraits | None = self._traits.storage.get(kind)
        if answer.text:
            name, capacity = (storage.name, storage.capacity) if storage is not None else ("", 0)
            self._send_text(answer.severity, answer.text.format(name=name, capacity=capacity))
        return [mission_ack(peer, answer.result, kind)] if answer.result is not None else []
