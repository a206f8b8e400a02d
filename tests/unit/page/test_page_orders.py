"""Orders on their way from a browser to the flight: few, small, checked on both sides, and answered or not."""

from __future__ import annotations

import asyncio
import json
import threading
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.flight.monitoring.progress import AskedOrder
from gcs.page import page_orders
from gcs.page.page_orders import MESSAGE_BYTES, WORDS, PageAsk, PageOrders


def test_the_page_knows_the_orders_of_the_flight() -> None:
    assert tuple(AskedOrder) == WORDS


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        ({"order": "hold"}, PageAsk(0, "hold")),
        ({"order": "return", "vehicles": [3, 1]}, PageAsk(0, "return", (3, 1))),
        ({"number": 7, "confirms": 6}, PageAsk(7, confirms=6)),
        ({"change": "avoid 560,480,30"}, PageAsk(0, change="avoid 560,480,30")),
        ({"word": "arm", "client": "10.0.0.7"}, PageAsk(0, word="arm", client="10.0.0.7")),
    ],
)
def test_the_four_forms_of_a_message(message: dict[str, Any], expected: PageAsk) -> None:
    found = PageAsk.of(json.dumps(message).encode())
    assert found == expected and PageAsk.of(found.data()) == expected


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"null",
        b"[]",
        b"{}",
        b"\xff",
        b"[" * 5000,
        b'{"order":"disarm"}',
        b'{"order":["hold"]}',
        b'{"order":"hold","by":"me"}',
        b'{"order":"hold","vehicles":1}',
        b'{"order":"hold","vehicles":[1.5]}',
        b'{"order":"hold","vehicles":[true]}',
        b'{"order":"hold","vehicles":[-1]}',
        b'{"order":"hold","confirms":1}',
        b'{"order":"land","number":"1"}',
        b'{"confirms":1,"vehicles":[1]}',
        b'{"confirms":true}',
        b'{"word":"arm","order":"hold"}',
        b'{"word":"arm","confirms":1}',
        b'{"word":"arm","vehicles":[1]}',
        b'{"word":["arm"]}',
        b'{"word":""}',
        b'{"word":"' + b"a" * 65 + b'"}',
        b'{"change":"home","order":"land"}',
        b'{"change":"home","vehicles":[1]}',
        b'{"change":"home","confirms":1}',
        b'{"change":7}',
        b'{"change":"avoid ' + b"1" * 64 + b'"}',
        b'{"order":"hold","client":7}',
        b'{"confirms":99999999999999}',
        b'{"order":"hold","vehicles":[' + b",".join([b"1"] * 300) + b"]}",
        b'{"order":"hold"}' + b" " * MESSAGE_BYTES,
    ],
)
def test_any_other_message_is_refused(message: bytes) -> None:
    with pytest.raises(ValueError):
        PageAsk.of(message)


@given(st.recursive(st.none() | st.booleans() | st.integers() | st.floats() | st.text(), st.lists, max_leaves=6))
def test_no_value_in_any_place_is_anything_but_an_order_or_refused(value: Any) -> None:
    for key in ("order", "vehicles", "number", "confirms"):
        try:
            found = PageAsk.of(json.dumps({"order": "hold", key: value}).encode())
        except ValueError:
            continue
        assert found.order in WORDS and all(type(one) is int for one in (found.number, *found.vehicles))


def test_an_answer_goes_to_its_own_question_and_a_silent_flight_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_orders, "_ANSWER_S", 0.2)
    sent: list[PageAsk] = []

    async def both() -> list[dict[str, Any]]:
        orders = PageOrders(lambda data: sent.append(PageAsk.of(data)))
        asked = [asyncio.ensure_future(orders.ask(json.dumps({"order": word}).encode())) for word in WORDS[:3]]
        await asyncio.sleep(0.0)
        for one in reversed(sent[:2]):
            answer = json.dumps({"number": one.number, "text": one.order, "may": True}).encode()
            threading.Thread(target=orders.answer, args=(answer,)).start()
        orders.answer(b'{"number":99,"text":"late","may":true}')
        return await asyncio.gather(*asked)

    first, second, third = asyncio.run(both())
    assert (first["text"], second["text"]) == ("hold", "land")
    assert third["may"] is False and "does not answer" in third["text"]


def test_the_flight_is_told_the_address_of_the_browser_whatever_its_message_says() -> None:
    sent: list[PageAsk] = []

    async def one() -> None:
        orders = PageOrders(lambda data: sent.append(PageAsk.of(data)))
        asked = asyncio.ensure_future(orders.ask(b'{"word":"arm","client":"127.0.0.1"}', "192.0.2.9"))
        await asyncio.sleep(0.0)
        asked.cancel()

    asyncio.run(one())
    assert [(found.word, found.client) for found in sent] == [("arm", "192.0.2.9")]


def test_more_orders_than_the_flight_answers_are_refused() -> None:
    async def many() -> list[dict[str, Any]]:
        orders = PageOrders(lambda data: None)
        asked = [asyncio.ensure_future(orders.ask(b'{"order":"hold"}')) for _ in range(9)]
        done, waiting = await asyncio.wait(asked, return_when=asyncio.FIRST_COMPLETED)
        for one in waiting:
            one.cancel()
        return [one.result() for one in done]

    (refused,) = asyncio.run(many())
    assert refused["may"] is False
