"""pytest fixtures for tests of ground software.

    from sim_bridge.testing import fleet, make_fleet

    def test_my_ground_station(fleet): ...                                      # six vehicles, ten times real time

    @pytest.mark.parametrize("fleet", [{"vehicles": 2, "autopilot": "px4"}], indirect=True)
    def test_it_with_two(fleet): ...

Put the import into conftest.py, and every test can use the fixtures.
"""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import pytest

from sim_bridge.fleet import Fleet

SPEEDUP = 10.0


@pytest.fixture
def fleet(request: pytest.FixtureRequest) -> Iterator[Fleet]:
    """A running fleet. Parametrise it indirectly with the arguments of `Fleet` as a dict."""
    arguments: dict[str, Any] = {"speedup": SPEEDUP, **getattr(request, "param", {})}
    with Fleet(**arguments) as flying:
        yield flying


@pytest.fixture
def make_fleet() -> Iterator[Callable[..., Fleet]]:
    """A function that makes fleets, with the arguments of `Fleet`; they stop when the test ends."""
    with ExitStack() as stack:

        def make(*arguments: Any, **options: Any) -> Fleet:
            return stack.enter_context(Fleet(*arguments, **{"speedup": SPEEDUP, **options}))

        yield make
