"""The frames on the pipes to and from the page's process: a letter of what it is, four bytes of length, the data."""

import struct
from enum import StrEnum
from typing import BinaryIO

_HEAD = struct.Struct(">cI")


class PageFrame(StrEnum):
    """What a frame holds, all of it JSON but the token."""

    TOKEN = "t"  # first
    SCENE = "s"  # second; later another one, which forgets pictures and events of the one before
    PLAN = "n"  # the scene of a new plan, in the same flight
    PICTURE = "p"
    EVENT = "e"
    BOARD = "b"  # what stands beside the scene, by name: each replaces the one before
    FILES = "f"  # paths of files that the page offers, by name
    ASK = "a"  # from the page
    ANSWER = "r"  # to it
    READERS = "v"  # from the page: how many browsers show it


def write_frame(pipe: BinaryIO, kind: PageFrame, data: bytes) -> None:
    """Write one frame, and wait until the pipe has taken it. Raises OSError where nobody reads any more."""
    pipe.write(_HEAD.pack(kind.value.encode(), len(data)) + data)
    pipe.flush()


def read_frame(pipe: BinaryIO, at_most: int | None = None) -> tuple[PageFrame, bytes] | None:
    """Return the next frame; None at the end, also amid a frame, and at one of more than `at_most` bytes."""
    head = pipe.read(_HEAD.size)
    if len(head) < _HEAD.size:
        return None
    kind, length = _HEAD.unpack(head)
    if at_most is not None and length > at_most:
        return None
    data = pipe.read(length)
    return None if len(data) < length else (PageFrame(kind.decode()), data)
