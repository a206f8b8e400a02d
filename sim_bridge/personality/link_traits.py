"""How an autopilot keeps up its link: parameters, clocks, signatures.

Knows: what can differ. Does not know: any autopilot's values, nor how they are used.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ParamTraits:
    """The parameter protocol."""

    sysid: str  # the parameter that holds the system id
    any_case: bool  # names match in any case, and come back as they were asked for
    tells_index: bool  # a value that was asked for by name, or set, comes with its index; else with 65535
    bytes_in_float: bool  # integers travel as the float's bytes; else as numbers
    converts: bool  # a value set with another type is converted; else it changes nothing
    takes_nan: bool
    hash_name: str  # heads a list and tells whether one's own copy is still good; "" where there is none
    banner: tuple[str, ...] = ()  # STATUSTEXTs that come with a list


@dataclass(frozen=True)
class LinkTraits:
    """TIMESYNC and signing."""

    clock_step_ns: int  # in which its clock goes on
    asks_time_every_s: float  # its own TIMESYNC questions; inf for never
    signs: bool  # SETUP_SIGNING is obeyed
