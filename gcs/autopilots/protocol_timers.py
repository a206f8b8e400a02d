"""Timeouts and numbers of retries of the MAVLink services.

`STANDARD` holds the values of the MAVLink guide, and of this project where the guide names none. Each autopilot has a
table of its own in its row; both begin with `STANDARD`. All times are in seconds.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class RoundTripTimers:
    """Bounds of the wait before a request is repeated; between them it follows the measured round trip (RFC 6298)."""

    least_s: float = 0.03
    most_s: float = 1.5
    first_s: float = 0.5  # until a round trip was measured


@dataclass(frozen=True)
class MissionTimers:
    """Upload and download of missions, fences and rally points. Raises ValueError for times that are not positive."""

    reply_s: float = 1.5  # without an answer: repeat MISSION_COUNT, the first request, or the last item
    item_s: float = 0.25  # for a requested item, before the request is repeated
    retries: int = 5
    give_up_s: float = 9.0  # without progress; longer than any autopilot's own timeout (8 s)
    ack_s: float = 2.5  # from the last item to its MISSION_ACK; ArduPilot repeats its request once a second
    doubt_s: float = 1.2  # after a refusal that may belong to an older message: is the transfer going on?
    busy_s: float = 6.0  # before another upload to a busy vehicle: PX4 forgets an interrupted transfer after 5 s
    request_again_min_s: float = 0.15  # a copy of an item may arrive so late

    def __post_init__(self) -> None:
        if not (self.reply_s > 0 and self.item_s > 0 and self.give_up_s > 0 and self.retries >= 0):
            raise ValueError(f"timers must be positive: {self}")


@dataclass(frozen=True)
class CommandTimers:
    """COMMAND_LONG and COMMAND_INT."""

    reply_s: float = 1.0  # for COMMAND_ACK, before the command is repeated
    retries: int = 4
    progress_s: float = 10.0  # after COMMAND_ACK IN_PROGRESS, for the next one
    limit_s: float = 120.0  # for the whole command
    reason_s: float = 0.7  # STATUSTEXTs that give the reason of a refusal come so long before or after it


@dataclass(frozen=True)
class ParameterTimers:
    """PARAM_REQUEST_READ and PARAM_SET."""

    reply_min_s: float = 0.15  # at least, before a request is repeated: autopilots answer from a slow loop
    attempts: int = 12  # of each parameter


@dataclass(frozen=True)
class FtpTimers:
    """MAVLink FTP."""

    give_up_s: float = 9.0  # without progress
    limit_s: float = 60.0  # for a whole transfer, and more for its length:
    slowest_Bps: float = 25.0
    reopen_s: float = 3.4  # ArduPilot closes the session of a silent station after 3 s without any request
    burst_pause_s: float = 0.3  # a burst may pause so long before its spacing is known; then `burst_spacings` times it
    burst_spacings: float = 3.0


@dataclass(frozen=True)
class ProtocolTimers:
    """All services of one autopilot."""

    round_trip: RoundTripTimers = RoundTripTimers()
    mission: MissionTimers = MissionTimers()
    command: CommandTimers = CommandTimers()
    status: CommandTimers = CommandTimers(reply_s=0.7, retries=3)  # REQUEST_MESSAGE of a status report
    status_reply_s: float = 1.0  # for the message itself
    parameter: ParameterTimers = ParameterTimers()
    ftp: FtpTimers = FtpTimers()


STANDARD = ProtocolTimers()
