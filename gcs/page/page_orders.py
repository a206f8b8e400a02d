"""What the page asks of the flight: the word that arms, and orders, each confirmed by a second message.

An order that changes the plan is planned before its effect is shown, which takes longer.

The flight decides and answers. Messages are small, few and checked on both sides. A page that hears no answer says so;
the flight never waits for one.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gcs.types import JsonObject

MESSAGE_BYTES = 8192
WORDS = ("hold", "land", "return", "continue")
_VEHICLES, _LARGEST, _LONGEST = 255, 2**31, 64
_WAITING = 8  # messages without an answer
_ANSWER_S, _PLANS_S = 5.0, 120.0


@dataclass(frozen=True)
class PageAsk:
    """An order that is to be said in numbers, the number of the one said that is to be given, or a typed word.

    `change`: an order that changes the plan, in the words of `gcs tell`.
    """

    number: int
    order: str = ""
    vehicles: tuple[int, ...] = ()  # system ids; none: all
    confirms: int | None = None
    word: str = ""
    change: str = ""
    client: str = ""  # the address of the browser, by the page's process

    @classmethod
    def of(cls, data: bytes) -> PageAsk:
        """Read a message. Raises ValueError for anything else than one of the four forms."""
        if len(data) > MESSAGE_BYTES:
            raise ValueError("too long")
        try:
            found = json.loads(data)
        except RecursionError:
            raise ValueError("too deep") from None
        if not isinstance(found, dict) or not found.keys() <= _KEYS:
            raise ValueError("no order")
        number, confirms = found.get("number", 0), found.get("confirms")
        order, vehicles = found.get("order", ""), found.get("vehicles", [])
        word, change, client = found.get("word", ""), found.get("change", ""), found.get("client", "")
        if not (_is_number(number) and all(map(_is_text, (order, word, change, client)))):
            raise ValueError("no order")
        if not isinstance(vehicles, list) or len(vehicles) > _VEHICLES or not all(map(_is_number, vehicles)):
            raise ValueError("no vehicles")
        forms = (order in WORDS, _is_number(confirms), bool(word), bool(change))
        if sum(forms) != 1 or (order and not forms[0]) or (confirms is not None and not forms[1]):
            raise ValueError("no order, or several")
        if vehicles and not order:
            raise ValueError("vehicles without an order")
        return cls(number, order, tuple(vehicles), confirms, word, change, client)

    def data(self) -> bytes:
        """Return it as a message."""
        return json.dumps(asdict(self)).encode()


_KEYS = frozenset(PageAsk.__dataclass_fields__)


def _is_text(value: object) -> bool:
    return isinstance(value, str) and len(value) <= _LONGEST


def _is_number(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < _LARGEST


class PageOrders:
    """The page's side: sends what a browser asks to the flight, and hands it the answer. `send` writes one message."""

    def __init__(self, send: Callable[[bytes], None]) -> None:
        self._send = send
        self._count = 0
        self._waiting: dict[int, asyncio.Future[JsonObject]] = {}
        self._loop: asyncio.AbstractEventLoop | None = None

    async def ask(self, body: bytes, client: str = "") -> JsonObject:
        """Return the flight's answer to a browser at the address `client`. Raises ValueError for no message."""
        asked = PageAsk.of(body)
        if len(self._waiting) >= _WAITING:
            return {"may": False, "text": "the flight has not answered the orders before this one"}
        self._loop = asyncio.get_running_loop()
        self._count += 1
        number = self._count
        answer = self._waiting[number] = self._loop.create_future()
        try:
            self._send(replace(asked, number=number, client=client).data())
            return await asyncio.wait_for(answer, _PLANS_S if asked.change else _ANSWER_S)
        except (OSError, TimeoutError):
            return {"may": False, "text": "the flight does not answer: its events say whether the order was given"}
        finally:
            del self._waiting[number]

    def answer(self, data: bytes) -> None:
        """Take in an answer, in any thread."""
        if self._loop is not None:
            self._loop.call_soon_threadsafe(self._answered, json.loads(data))

    def _answered(self, found: JsonObject) -> None:
        waiting = self._waiting.get(found["number"])
        if waiting is not None and not waiting.done():
            waiting.set_result(found)
