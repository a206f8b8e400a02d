"""A pseudo terminal that any program can open like the device of a telemetry radio. Every baud rate works.

As on a real line, the sender does not know if a program listens: what is not read is lost, whole frames at a time.
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
    """One pseudo terminal; `name` is added to the path of the spec."""

    def __init__(self, spec: EndpointSpec, name: str, watch: Watch) -> None:
        """Open the terminal. Raises `LinkError` if its name is taken or no terminal is available."""
        self._watch = watch
        self._link: Path | None = None
        self._rest = b""  # remainder of a frame that a full buffer cut
        try:
            self._ours, self._theirs = os.openpty()
        except OSError as error:
            raise LinkError(f"no pseudo terminal is available: {error.strerror}.") from error
        tty.setraw(self._theirs)
        os.set_blocking(self._ours, False)
        watch.add(self._ours, self)
        self._open = True
        device = os.ttyname(self._theirs)
        if spec.path:
            link = Path(spec.path + name)
            try:
                if link.is_symlink() and link.readlink().parent == Path(device).parent:
                    link.unlink()  # from an earlier run that was killed
                link.symlink_to(device)
            except OSError as error:
                self.close()
                raise LinkError(
                    f"the link {link} to {device} cannot be created: {error.strerror}.", hint="choose another path"
                ) from error
            self._link = link
        self.place = PeerAddress(str(spec.kind), str(self._link or device))

    def receive(self, file: int, now_s: float) -> Iterator[tuple[bytes, Source]]:
        """Return the bytes written into the terminal."""
        for _ in range(PER_TURN):
            try:
                data = os.read(self._ours, LARGEST)
            except OSError:
                return
            if not data:
                return
            yield data, _SOURCE

    def heard(self, source: Source, now_s: float) -> None:
        """Nothing to do: the program at the other end receives all frames anyway."""

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
        """Write `data`; return the part that did not fit."""
        try:
            return data[os.write(self._ours, data) :]
        except OSError:
            return data

    def close(self) -> None:
        """Close the terminal and remove its name."""
        if not self._open:
            return
        self._open = False
        self._watch.remove(self._ours)
        os.close(self._ours)
        os.close(self._theirs)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
