"""One pre-flight check of one vehicle, its name, and what a set of checks allows: go, no-go, waived for one flight."""

from collections.abc import Collection, Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from enum import StrEnum

from gcs.errors import FlightError, UsageError
from gcs.types import JsonObject


class CheckName(StrEnum):
    """What is checked; the value is what `--waive` takes."""

    DISARMED = "disarmed"
    CAN_ARM = "can arm"  # its own checks pass, where SYS_STATUS says so, and it sent no reason against arming lately
    ESTIMATE = "position estimate"  # the estimator's flags are those that a flight needs
    SENSORS = "sensors"  # every enabled one is healthy, except those that are only mentioned
    PAD = "pad"
    HEIGHT = "height"  # that of its pad
    HOME = "home"  # is where the vehicle stands
    LOCAL_FRAME = "local frame"  # its origin is at the pad
    CLOCK = "clock"  # TIMESYNC is answered in time, and GNSS time agrees with that of the other vehicles
    BATTERY = "battery"  # enough for plan and reserve, also by the current in the hover before T0
    CAPACITY = "capacity"  # that of [vehicle.power]; a difference is a warning
    WIND = "wind"  # that which the vehicle reports is in the plan's wind envelope; one that reports none passes
    MESSAGES = "messages"  # no STATUSTEXT of severity CRITICAL or worse
    TIMING = "timing"  # in mission mode, parameters that its arrival times rest on are those assumed


_PROOFS = {
    "read-back": "what is on board must be what was sent",
    "verification": "a plan that failed verification is not flown",
}
NOT_REPORTED = "not reported"


@dataclass(frozen=True)
class PreflightCheck:
    """One check of one vehicle. A failed one is a no-go unless it is waived; a warning is none."""

    sysid: int
    name: CheckName
    measured: str
    required: str
    ok: bool
    warning: str = ""
    waived: bool = False

    @property
    def go(self) -> bool:
        """Whether the vehicle may be armed as far as this check is concerned."""
        return self.ok or self.waived


def complete(checks: Iterable[PreflightCheck]) -> tuple[PreflightCheck, ...]:
    """Return the checks, and for each that a vehicle lacks a failed one: not reported."""
    given = tuple(checks)
    found = {(c.name, c.sysid): c for c in given}
    required = {c.name: c.required for c in reversed(given)}
    sysids = dict.fromkeys(c.sysid for c in given)
    return tuple(
        found.get((name, sysid)) or PreflightCheck(sysid, name, NOT_REPORTED, required[name], ok=False)
        for sysid in sysids
        for name in dict.fromkeys(c.name for c in given)
    )


def waive(checks: Iterable[PreflightCheck], names: Collection[CheckName]) -> tuple[PreflightCheck, ...]:
    """Return the checks, with failed ones of these names waived."""
    return tuple(replace(c, waived=True) if not c.ok and c.name in names else c for c in checks)


def refuse_no_go(checks: Sequence[PreflightCheck]) -> None:
    """Raises `FlightError` that names the failed checks, six at most."""
    bad = [c for c in complete(checks) if not c.go]
    if bad:
        listed = "; ".join(f"vehicle {c.sysid}: {c.name}: {c.measured} (required: {c.required})" for c in bad[:6])
        more = f"; and {len(bad) - 6} more" if len(bad) > 6 else ""
        names = dict.fromkeys(c.name for c in bad)
        options = " ".join(f"--waive '{name}'" if " " in name else f"--waive {name}" for name in names)
        helps = CheckName.DISARMED not in names
        once = f" To fly once in spite of them, add {options}" if helps else ""
        raise FlightError(
            f"no-go: {listed}{more}.", hint=f"fix the failed checks, then run again; no vehicle was armed.{once}"
        )


def checks_data(checks: Iterable[PreflightCheck]) -> list[JsonObject]:
    """Return the checks as plain values, for `--json` and the flight's folder."""
    return [{**asdict(c), "go": c.go} for c in complete(checks)]


def known_checks(names: Collection[str]) -> frozenset[CheckName]:
    """Return names of checks that may be waived. Raises `UsageError` for others."""
    for name in sorted({*names} - {*CheckName}):
        if name in _PROOFS:
            raise UsageError(f"--waive {name}: {name} is never waived: {_PROOFS[name]}", hint="leave --waive out")
        raise UsageError(f"--waive {name}: there is no such check", hint=f"give one of {', '.join(CheckName)}")
    return frozenset(map(CheckName, names))
