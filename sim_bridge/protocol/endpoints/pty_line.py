"""Vehicles at the far end of a serial line: a pseudo terminal that any program opens like a radio's device.

Knows: one pseudo terminal, and the name it goes by. Does not know: messages, baud rates (a terminal takes any). As on
a real line nobody is told whether somebody listens: what is not read is lost, whole frames at a time.
"""

from __future__ import annotations

import os
import tty
from collections.abc import Iterator, Sequence
from pathlib import Path

from gcs.errors import LinkError
from sim_bridge.protocol.endpoints.address import EndpointSpec
from sim_bridge.protocol.endpoints.line import LARGEST, PER_TURN, PeerAddress, Source, Watch

_SOURCE = "line"


class PtyLine:
    """One pseudo terminal; `name` is added to the spec's path."""

    def __init__(self, spec: EndpointSpec, name: str, watch: Watch) -> None:
        """Make the terminal. Raises `LinkError` where its name is taken or there are no terminals."""
        self._watch = watch
        self._link: Path | None = None
        self._rest = b""  # of a frame that was cut by a full buffer
        try:
            self._ours, self._theirs = os.openpty()
        except OSError as error:
            raise LinkError(f"there is no pseudo terminal to be had: {error.strerror}.") from error
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        watch.add(self._ours, self)
        self._open = True
        device = os.ttyname(self._theirs)
        if spec.path:
            link = Path(spec.path + name)
            try:
                if link.is_symlink() and link.readlink().parent == Path(device).parent:
                    link.unlink()  # left behind by a run that was killed
                link.symlink_to(device)
            except OSError as error:
                self.close()
                raise LinkError(
                    f"{link} cannot be made to lead to {device}: {error.strerror}.", hint="name another path"
                ) from error
            self._link = link
        self.place = PeerAddress(str(spec.kind), str(self._link or device))

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """Whatever was written into the terminal."""
        for _ in range(PER_TURN):
            try:
                data = os.read(self._ours, LARGEST)
            except OSError:
                return
            if not data:
                return
            yield data, _SOURCE

    def heard(self, source: Source, now_s: float) -> None:
        """Whoever is at the other end hears the vehicles anyway."""

    def send(self, frames: Sequence[bytes], now_s: float) -> None:
        """Write frames; a frame that was begun is finished before the next."""
        if self._rest:
            self._rest = self._write(self._rest)
        for frame in frames:
            if self._rest:
                return
            left = self._write(frame)
            self._rest = left if len(left) < len(frame) else b""

    def _write(self, data: bytes) -> bytes:
        """What of `data` did not fit."""
        try:
            return data[os.write(self._ours, data) :]
        except OSError:
            return data

    def close(self) -> None:
        """Let the terminal and its name go."""
        if not self._open:
            return
        self._open = False
        self._watch.remove(self._ours)
        os.close(self._ours)
        os.close(self._theirs)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
