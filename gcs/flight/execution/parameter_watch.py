"""Parameters that change on board in flight: another station sets what returns, fence and arrival times rest on.

Autopilots tell every station of a changed parameter. It is an event; nothing is set back, since two stations that set
one parameter in turns are worse than one.
"""

from collections.abc import Callable, Iterable, Mapping
from functools import partial
from typing import Protocol

from gcs.autopilots.parameter_names import in_units_of, spellings
from gcs.autopilots.traits import link_behaviour, traits_of
from gcs.link.protocols.parameter_transfer import decode
from gcs.link.session.vehicle_load import VehicleLoad
from gcs.link.session.vehicle_session import VehicleSession
from gcs.link.wire.message import Message

_ALIKE = 1e-4  # a smaller difference comes from float32, or from the unit of a renamed parameter


class ReportAlarm(Protocol):
    """Makes an event of a vehicle."""

    def __call__(self, sysid: int, what: str, rule: str, *, alarm: bool = False) -> None:
        """Report an event of a vehicle."""


def watch_parameters(
    sessions: Mapping[int, VehicleSession], loads: Iterable[VehicleLoad], report: ReportAlarm
) -> Callable[[], None]:
    """Report changes in flight, by any station, of what the loads set or was read before. Return what ends this."""
    given = {load.sysid: dict(load.parameters) for load in loads}
    stops = [
        session.subscribe(_Watch(session, given.get(sysid, {}), partial(report, sysid)).receive)
        for sysid, session in sessions.items()
    ]

    def stop() -> None:
        for end in stops:
            end()

    return stop


class _Watch:
    """The parameters of one vehicle; those of its load are known, others once it has sent them before it was armed."""

    def __init__(self, session: VehicleSession, given: Mapping[str, float], report: Callable[..., None]) -> None:
        row = traits_of(session.autopilot)
        rests_on = {*given, *(() if row is None else (*row.navigator.parameters, *row.landing.parameters))}
        self._session, self._report = session, report
        self._names = {name: wanted for wanted in rests_on for name in spellings(session.autopilot, wanted)}
        self._known = dict(given)
        self._given = frozenset(given)

    def receive(self, message: Message) -> None:
        """Take in a PARAM_VALUE."""
        if message.name != "PARAM_VALUE" or (wanted := self._names.get(str(message.fields["param_id"]))) is None:
            return
        autopilot = self._session.autopilot
        told = decode(message, in_bytes=link_behaviour(autopilot).integers_in_bytes)
        if told is None:
            return
        value = in_units_of(autopilot, wanted, told.name, told.value)
        before = self._known.get(wanted)
        if self._session.armed and before is not None and abs(value - before) > _ALIKE * max(abs(before), 1.0):
            what = f"has another {wanted}: {value:g}, was {before:g}"
            self._report(what, "Another station set it in flight; this flight rests on the old value", alarm=True)
        if self._session.armed or wanted not in self._given:
            self._known[wanted] = value
