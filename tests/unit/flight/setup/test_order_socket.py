"""The socket of a flight: its answers, who may connect, and what is no order."""

from __future__ import annotations

import asyncio
import json
import socket
import stat
from collections.abc import Callable, Collection
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gcs.errors import FlightError, UsageError
from gcs.flight.monitoring.progress import AskedOrder
from gcs.flight.setup.order_socket import NAME, Told, newest_flying, taking_orders, tell
from gcs.plan.formation_orders import Hold, PlanOrder, Scale
from gcs.scenario.schema.scenario import EventTable, Scenario


class Flight:
    def __init__(self, scenario: Scenario) -> None:
        self.plan: Any = SimpleNamespace(scenario=scenario)
        self.asked: list[tuple[object, tuple[int, ...], str]] = []
        self.refuses = False

    def ask(self, order: AskedOrder | PlanOrder, vehicles: Collection[int] = (), *, by: str = "") -> tuple[int, ...]:
        self.asked.append((order, tuple(vehicles), by))
        if self.refuses:
            raise FlightError("no vehicle would.", hint="land")
        return (1, 2)

    async def answer(self) -> str:
        await asyncio.sleep(0.05)
        return "a new plan is flown"


def told(folder: Path, flight: Flight, client: Callable[[], Any]) -> Any:
    async def run() -> Any:
        async with taking_orders(flight, folder, print):
            return await asyncio.to_thread(client)

    return asyncio.run(run())


@pytest.mark.parametrize("depth", [1, 12])  # a path longer than a socket may have
def test_an_order_is_answered_when_it_is_obeyed_and_when_it_is_planned(
    tmp_path: Path, simulation1: Scenario, depth: int
) -> None:
    folder = tmp_path.joinpath(*["a-long-name-of-a-folder"] * depth)
    folder.mkdir(parents=True)
    flight = Flight(simulation1)
    assert told(folder, flight, lambda: list(tell(folder, Told(("hold",), (2,))))) == ["ordered to hold: vehicles 1, 2"]
    answers = told(folder, flight, lambda: list(tell(folder, Told(("scale", "0.6")))))
    assert answers[-1] == "a new plan is flown"
    assert flight.asked == [(AskedOrder.HOLD, (2,), "gcs tell"), (Scale(0.6), (), "gcs tell")]
    assert not (folder / NAME).exists(), "it ends with the flight"


def test_a_refusal_has_its_reason(tmp_path: Path, simulation1: Scenario) -> None:
    flight = Flight(simulation1)
    flight.refuses = True
    with pytest.raises(FlightError, match="no vehicle would"):
        told(tmp_path, flight, lambda: list(tell(tmp_path, Told(("home",)))))
    with pytest.raises(FlightError, match="is no order"):
        told(tmp_path, flight, lambda: list(tell(tmp_path, Told(("dance",)))))
    with pytest.raises(FlightError, match="home is for the whole formation"):
        told(tmp_path, flight, lambda: list(tell(tmp_path, Told(("home",), (2,)))))
    assert len(flight.asked) == 1


def test_a_formation_that_cannot_hold_as_one_brakes_one_by_one(tmp_path: Path, simulation1: Scenario) -> None:
    class Late(Flight):
        async def answer(self) -> str:
            raise FlightError("no plan was made in time.", hint="land")

    flight = Late(simulation1)
    answers = told(tmp_path, flight, lambda: list(tell(tmp_path, Told(("hold",)))))
    assert answers[1:] == ["no plan was made in time. Each brakes by itself.", "ordered to hold: vehicles 1, 2"]
    assert [order for order, _, _ in flight.asked] == [Hold(), AskedOrder.HOLD]


@pytest.mark.parametrize(
    ("row", "then"),
    [
        ({"order": "home", "otherwise": "return"}, AskedOrder.RETURN),
        ({"order": "hold"}, AskedOrder.HOLD),
        ({"order": "home"}, None),
    ],
)
def test_an_event_whose_order_has_no_plan_gets_its_other_order(
    tmp_path: Path, simulation1: Scenario, row: dict[str, Any], then: AskedOrder | None
) -> None:
    class Late(Flight):
        async def answer(self) -> str:
            raise FlightError("no plan was made in time.", hint="land")

    events = (EventTable(event="fog", order="land"), EventTable(event="storm", **row))
    flight = Late(simulation1.model_copy(update={"on": events}))
    if then is None:
        with pytest.raises(FlightError, match="no plan was made in time"):
            told(tmp_path, flight, lambda: list(tell(tmp_path, Told(("event", "storm")))))
    else:
        answers = told(tmp_path, flight, lambda: list(tell(tmp_path, Told(("event", "storm")))))
        assert answers[-1] == f"ordered to {then.value}: vehicles 1, 2"
    assert [order for order, _, _ in flight.asked][1:] == ([] if then is None else [then])


def test_the_socket_is_open_to_the_same_user_alone(tmp_path: Path, simulation1: Scenario) -> None:
    mode = told(tmp_path, Flight(simulation1), lambda: (tmp_path / NAME).stat().st_mode)
    assert stat.S_IMODE(mode) == 0o600


@pytest.mark.parametrize(
    "line",
    [b"", b"\n", b"{}\n", b"[" * 5000 + b"\n", json.dumps({"words": 1, "vehicles": [], "in_degrees": 0}).encode()],
)
def test_what_is_no_order_reaches_no_vehicle(tmp_path: Path, simulation1: Scenario, line: bytes) -> None:
    flight = Flight(simulation1)

    def client() -> bytes:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as stream:
            stream.connect(str(tmp_path / NAME))
            stream.sendall(line)
            stream.shutdown(socket.SHUT_WR)
            return stream.recv(100)

    answer = told(tmp_path, flight, client)
    assert not answer or json.loads(answer)["is_refusal"]
    assert not flight.asked


def test_without_a_flight_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no flight under way"):
        newest_flying(tmp_path)
    with pytest.raises(UsageError, match="no flight takes orders"):
        list(tell(tmp_path, Told(("hold",))))


def test_the_socket_of_a_flight_that_was_killed_is_passed_over_and_taken(tmp_path: Path, simulation1: Scenario) -> None:
    flying, killed = tmp_path / "2026-01-01", tmp_path / "2026-01-02"
    for folder in (flying, killed):
        folder.mkdir()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as left:
        left.bind(str(killed / NAME))
    flight = Flight(simulation1)
    assert told(flying, flight, lambda: newest_flying(tmp_path)) == flying
    assert told(killed, flight, lambda: list(tell(killed, Told(("land",))))) == ["ordered to land: vehicles 1, 2"]
    assert flight.asked == [(AskedOrder.LAND, (), "gcs tell")]
