"""The MAVLink systems of vehicles that have other numbers in the plan."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from gcs.errors import UsageError


def reject_shared_systems(system_of: Mapping[int, int]) -> None:
    """Raises `UsageError` if two vehicles have the same system."""
    seen: dict[int, int] = {}
    for sysid, system in system_of.items():
        if system in seen:
            raise UsageError(
                f"vehicles {seen[system]} and {sysid} would both be system {system}.",
                hint="give each vehicle a system of its own: --map 1=7,2=8",
            )
        seen[system] = sysid


def vehicle_words(sysids: Sequence[int], system_of: Mapping[int, int]) -> str:
    """Return "vehicle 1" or "vehicles 1, 2 (system 7)"."""
    named = [str(s) if system_of[s] == s else f"{s} (system {system_of[s]})" for s in sysids]
    return ("vehicle " if len(named) == 1 else "vehicles ") + ", ".join(named)
