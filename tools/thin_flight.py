"""Thin the logs of a real flight so far that the tests may carry them:

    ./tools/run python tools/thin_flight.py FLIGHT_FOLDER TO

Positions stay at 2 Hz, states at 0.2 Hz or when they change; heartbeats, clocks, answers and texts of vehicles stay,
equal texts once in 30 s. Of what the ground station sent, commands stay. Frames are kept whole, with their stamps.
"""

from __future__ import annotations

import argparse
import lzma
import struct
from pathlib import Path

from gcs.flight.recording.tlog import LoggedFrame, load_tlog
from gcs.link.wire.message import GROUND, Message

POSITION_S, STATE_S, TEXT_S = 0.5, 5.0, 30.0
ALL = {"AUTOPILOT_VERSION", "COMMAND_ACK", "COMMAND_LONG", "GPS_GLOBAL_ORIGIN", "HEARTBEAT", "SYSTEM_TIME"}
CHANGES = {  # kept when one of these fields changes, too
    "EKF_STATUS_REPORT": ("flags",),
    "ESTIMATOR_STATUS": ("flags",),
    "EXTENDED_SYS_STATE": ("landed_state",),
    "FENCE_STATUS": ("breach_status",),
    "GPS_RAW_INT": ("fix_type",),
    "SYS_STATUS": ("battery_remaining", "onboard_control_sensors_health"),
}
STATES = {*CHANGES, "GLOBAL_POSITION_INT", "HOME_POSITION"}


class Thinner:
    """Decides which messages stay."""

    def __init__(self) -> None:
        self._kept_s: dict[object, float] = {}
        self._values: dict[object, object] = {}

    def keeps(self, message: Message, t_s: float) -> bool:
        """Return whether a message at this time stays."""
        name, sysid = message.name, message.sysid
        if name in ALL:
            return sysid != GROUND.sysid or name == "COMMAND_LONG"
        if name == "LOCAL_POSITION_NED":
            return self._after((name, sysid), POSITION_S, t_s)
        if name == "STATUSTEXT":
            return self._after((sysid, message.fields["text"], message.fields.get("chunk_seq")), TEXT_S, t_s)
        if name not in STATES:
            return False
        value = tuple(message.fields[key] for key in CHANGES.get(name, ()))
        changed = self._values.get((name, sysid)) != value
        self._values[name, sysid] = value
        return self._after((name, sysid), 0.0 if changed else STATE_S, t_s)

    def _after(self, key: object, pause_s: float, t_s: float) -> bool:
        if t_s - self._kept_s.get(key, -1e9) < pause_s - 1e-3:
            return False
        self._kept_s[key] = t_s
        return True


def thinned(frames: tuple[LoggedFrame, ...]) -> bytes:
    """The frames that stay, each after its stamp."""
    thinner = Thinner()
    kept = [f for f in frames if f.message is not None and thinner.keeps(f.message, f.stamp_us / 1e6)]
    return b"".join(struct.pack(">Q", frame.stamp_us) + frame.data for frame in kept)


def main() -> None:
    """Thin one folder."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("to", type=Path)
    options = parser.parse_args()
    options.to.mkdir(parents=True, exist_ok=True)
    for name in ("plan.skein", "flight.json", "events.jsonl"):
        (options.to / name).write_bytes((options.folder / name).read_bytes())
    for log in sorted(options.folder.glob("*.tlog")):
        path = options.to / f"{log.name}.xz"
        path.write_bytes(lzma.compress(thinned(load_tlog(log).frames), preset=9))
        print(f"{path}: {path.stat().st_size} bytes")


if __name__ == "__main__":
    main()
