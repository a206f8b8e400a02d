"""Emulated vehicles for testing ground stations: `sim-bridge` on the command line, `Fleet` in a program."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sim_bridge.fleet import Fleet, NotInTime, TrueState

__all__ = ["Fleet", "NotInTime", "TrueState"]


def __getattr__(name: str) -> object:
    """Import `fleet` only when a name is used, so that `sim-bridge --help` answers at once."""
    if name in __all__:
        from sim_bridge import fleet  # noqa: PLC0415

        return getattr(fleet, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
