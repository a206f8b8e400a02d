"""What differs between autopilots in parameters, TIMESYNC and signing."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParamTraits:
    """The parameter protocol."""

    sysid: str  # the parameter that holds the system id
    any_case: bool  # names match in any case, and are returned as requested
    sends_index: bool  # the reply to a request by name, or to a set, has the index; else 65535
    bytes_in_float: bool  # integers are sent as the bytes of the float; else as numbers
    converts: bool  # a value set with another type is converted; else it has no effect
    takes_nan: bool
    capacity: str  # the parameter that holds the capacity of the battery, mAh
    hash_name: str  # sent before a list, to check a cached copy; "" if there is none
    banner: tuple[str, ...] = ()  # STATUSTEXTs sent with a list


@dataclass(frozen=True)
class LinkTraits:
    """TIMESYNC and signing."""

    clock_step_ns: int  # resolution of its clock
    timesync_period_s: float  # of its own TIMESYNC requests; inf for never
    signs: bool  # obeys SETUP_SIGNING
