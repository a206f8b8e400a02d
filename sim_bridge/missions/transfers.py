"""Uploads to one vehicle and downloads from it that are under way."""

from dataclasses import dataclass, field

from gcs.link.wire.message import Message, Station
from gcs.mission.model import MissionItem


@dataclass
class Upload:
    """An upload to this vehicle."""

    peer: Station
    kind: int
    count: int  # of all items, the first of them item 0
    int_requests: bool
    requested_s: float
    heard_s: float
    items: list[MissionItem] = field(default_factory=list)
    first: int = 0  # of a partial write: the first item to replace, the last one is `count` - 1
    _warned: bool = False

    @property
    def seq(self) -> int:
        """The next item to receive."""
        return self.first + len(self.items)

    def hear(self, now_s: float) -> None:
        """Start the timeout again."""
        self.heard_s = now_s

    def request(self, now_s: float) -> Message:
        """Request the next item."""
        self.requested_s = now_s
        name = "MISSION_REQUEST_INT" if self.int_requests else "MISSION_REQUEST"
        return Message(name, {**addressed(self.peer, self.kind), "seq": self.seq})

    def take_float(self, *, follows: bool) -> bool:
        """Note an item in single precision, and request such ones from now on if the vehicle `follows`.

        Return whether it is the first one of the upload.
        """
        self.int_requests &= not follows
        first, self._warned = not self._warned, True
        return first


@dataclass
class Download:
    """A download from this vehicle, where the autopilot tracks it."""

    peer: Station
    kind: int
    heard_s: float
    seq: int = 0  # the next one expected

    def expects(self, seq: int, now_s: float) -> bool:
        """Take in a request: whether it is for the next item, or for the last one again."""
        self.heard_s = now_s
        if seq not in (self.seq, self.seq - 1):
            return False
        self.seq = seq + 1
        return True


def addressed(peer: Station, kind: int) -> dict[str, int]:
    """The fields of a message about items of this type."""
    return {**peer.target, "mission_type": kind}
