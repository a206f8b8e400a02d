"""What one vehicle holds of missions, fences and rally points, and how it comes by them.

Knows: who may transfer what at the same time, which items this vehicle can fly. Does not know: sockets, clocks,
how items are flown. The transfers themselves are `gcs.link`'s machines, the same ones the ground station uses.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

from gcs.frames import Origin
from gcs.link.dialect import MavCommand, MissionResult, MissionType
from gcs.link.items import home_item, item_from_message, item_to_message
from gcs.link.message import Message, Station
from gcs.link.mission import mission_ack, mission_type_of
from gcs.link.mission_compare import has_position
from gcs.link.mission_receiver import ItemCheck, MissionReceiver
from gcs.link.mission_sender import MissionSender
from gcs.mission.model import Command, Frame, Home, MissionItem
from sim_bridge.personality import Personality

FLOWN = frozenset({*Command, MavCommand.NAV_RETURN_TO_LAUNCH})
_FRAMES = frozenset(Frame)
_TYPES = (MissionType.MISSION, MissionType.FENCE, MissionType.RALLY)
_FULL_CIRCLE_degE7 = 1_800_000_000


class MissionShelf:
    """Missions of all types of one vehicle. `on_mission` hears of every new flight mission."""

    def __init__(
        self,
        me: Station,
        personality: Personality,
        home: Origin,
        on_mission: Callable[[Sequence[MissionItem]], None],
    ) -> None:
        self.home = home
        self._me = me
        self._personality = personality
        self._on_mission = on_mission
        self.rejects = False  # a fault: no item pleases
        self._items: dict[int, tuple[MissionItem, ...]] = dict.fromkeys(map(int, _TYPES), ())
        self._uploads: dict[int, MissionReceiver] = {}
        self._downloads: dict[int, MissionSender] = {}

    @property
    def busy(self) -> bool:
        """Whether a transfer is under way, so that `tick` has something to watch."""
        return bool(self._uploads or self._downloads)

    def items(self, mission_type: int = MissionType.MISSION) -> tuple[MissionItem, ...]:
        """What is held; item 0 of a flight mission is home."""
        return self._items[mission_type]

    def move_home(self, home: Origin) -> None:
        """Home is somewhere else now."""
        self.home = home
        items = self._items[MissionType.MISSION]
        if items:
            self._items[MissionType.MISSION] = (self._home_item(), *items[1:])

    def receive(self, message: Message, now_s: float) -> list[Message]:
        """Answer any MISSION_ message of a transfer."""
        kind = mission_type_of(message)
        if message.name == "MISSION_CLEAR_ALL":
            return [mission_ack(message.source, self._clear(kind), kind)]
        if message.name == "MISSION_COUNT":
            return self._offered(message, kind, now_s)
        if message.name == "MISSION_REQUEST_LIST":
            return self._asked(message, kind, now_s)
        upload, download = self._uploads.get(kind), self._downloads.get(kind)
        replies = upload.receive(message, now_s) if upload is not None else []
        if download is not None and download.peer == message.source:
            replies += self._told(download.receive(message, now_s))
        elif message.name in ("MISSION_REQUEST_INT", "MISSION_REQUEST"):
            replies += self._single(message, kind)
        return replies + self._finish()

    def tick(self, now_s: float) -> list[Message]:
        """Timers of the transfers under way."""
        machines: list[MissionReceiver | MissionSender] = [*self._uploads.values(), *self._downloads.values()]
        messages = [message for machine in machines for message in machine.tick(now_s)]
        return self._told(messages) + self._finish()

    def _offered(self, message: Message, kind: int, now_s: float) -> list[Message]:
        peer = message.source
        if kind not in self._items:
            return [mission_ack(peer, MissionResult.UNSUPPORTED, kind)]
        upload = self._uploads.get(kind)
        if kind in self._downloads or (upload is not None and upload.peer != peer):
            return [mission_ack(peer, MissionResult.DENIED, kind)]
        if upload is None:
            upload = self._uploads[kind] = MissionReceiver(
                peer,
                me=self._me,
                mission_type=kind,
                timers=self._personality.missions.timers,
                capacity=self._personality.missions.capacity,
                check=self._check(kind),
                int_requests=self._personality.missions.int_requests,
            )
        return upload.receive(message, now_s) + self._finish()

    def _check(self, kind: int) -> ItemCheck:
        if self.rejects:
            return refuse_item
        return check_item if kind == MissionType.MISSION else accept_item

    def _asked(self, message: Message, kind: int, now_s: float) -> list[Message]:
        peer = message.source
        if kind not in self._items:
            return [mission_ack(peer, MissionResult.UNSUPPORTED, kind)]
        if kind in self._uploads:
            return [mission_ack(peer, MissionResult.DENIED, kind)]
        download = MissionSender(
            self._items[kind],
            peer,
            me=self._me,
            mission_type=kind,
            timers=self._personality.missions.timers,
            current=-1,
        )
        self._downloads[kind] = download
        return download.start(now_s)

    def _single(self, message: Message, kind: int) -> list[Message]:
        seq, items = message.fields["seq"], self._items.get(kind, ())
        if seq >= len(items):
            return []
        return self._told([item_to_message(items[seq], seq, message.source, mission_type=kind)])

    def _told(self, messages: list[Message]) -> list[Message]:
        """Items in the frames that this autopilot names."""
        if self._personality.missions.tells_file_frames:
            for message in messages:
                if message.name == "MISSION_ITEM_INT":
                    message.fields["frame"] = item_from_message(message).frame
        return messages

    def _clear(self, kind: int) -> MissionResult:
        if kind not in self._items:
            return MissionResult.UNSUPPORTED
        self._store(kind, ())
        return MissionResult.ACCEPTED

    def _finish(self) -> list[Message]:
        """Shelve what has arrived, drop machines that are done."""
        for kind, upload in list(self._uploads.items()):
            if upload.done:
                del self._uploads[kind]
                if upload.error is None:
                    self._store(kind, upload.items)
        for kind, download in list(self._downloads.items()):
            if download.done:
                del self._downloads[kind]
        return []

    def _store(self, kind: int, items: tuple[MissionItem, ...]) -> None:
        if kind == MissionType.MISSION:
            items = tuple(self._home_item() if seq == 0 else kept(item) for seq, item in enumerate(items))
        self._items[kind] = items
        if kind == MissionType.MISSION:
            self._on_mission(items)

    def _home_item(self) -> MissionItem:
        return home_item(Home(self.home.lat_deg, self.home.lon_deg, self.home.alt_amsl_m))


def kept(item: MissionItem) -> MissionItem:
    """An item as ArduPilot keeps it: frame 0 without a position, LAND's abort altitude 1."""
    if not has_position(item.command):
        return replace(item, frame=int(Frame.GLOBAL))
    if item.command == Command.NAV_LAND and item.params[3] == 0.0:
        return replace(item, params=(*item.params[:3], 1.0))
    return item


def accept_item(_seq: int, _item: MissionItem) -> MissionResult:
    """Fences and rally points are kept as they come."""
    return MissionResult.ACCEPTED


def refuse_item(_seq: int, _item: MissionItem) -> MissionResult:
    """A fault: nothing pleases this vehicle."""
    return MissionResult.INVALID


def check_item(seq: int, item: MissionItem) -> MissionResult:
    """Whether the vehicle can fly the item; item 0 becomes home anyway."""
    if item.command not in FLOWN:
        return MissionResult.UNSUPPORTED
    if item.frame not in _FRAMES:
        return MissionResult.UNSUPPORTED_FRAME
    if not math.isfinite(item.params[0]):
        return MissionResult.INVALID_PARAM1
    if not has_position(item.command) or seq == 0:
        return MissionResult.ACCEPTED
    if not math.isfinite(item.alt_m):
        return MissionResult.INVALID_PARAM7
    if abs(item.lat_degE7) > _FULL_CIRCLE_degE7 // 2:
        return MissionResult.INVALID_PARAM5_X
    if abs(item.lon_degE7) > _FULL_CIRCLE_degE7:
        return MissionResult.INVALID_PARAM6_Y
    return MissionResult.ACCEPTED
