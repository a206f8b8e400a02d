"""Emulated vehicles and a ground station that reads more slowly than they send. Requests by MAVLink's ping service."""

from __future__ import annotations

import pytest

from gcs.link.protocols.timesync import ping_answers
from gcs.link.wire.message import Message
from sim_bridge.sim.traffic import BEHIND_S, PERIOD_S, UNANSWERED_PERIOD_S, GroundEcho


def asked(echo: GroundEcho, t_s: float) -> Message:
    request = echo.due(t_s)
    assert request is not None
    return request


def answered(request: Message) -> Message:
    (answer,) = ping_answers(Message(request.name, request.fields, 3, 1))
    return answer


def test_the_station_answers_requests_to_all_and_no_answers():
    request = Message("PING", {"time_usec": 17, "seq": 4, "target_system": 0, "target_component": 0}, 3, 1)
    (answer,) = ping_answers(request)
    assert answer.fields == {"time_usec": 17, "seq": 4, "target_system": 3, "target_component": 1}
    assert ping_answers(answer) == []


def test_a_station_that_never_answers_is_not_waited_for():
    echo, t_s = GroundEcho(), 0.0
    while t_s < 20.0:
        echo.due(t_s)
        assert echo.awaits_after_s(t_s) is None
        t_s += 0.02


def test_time_goes_on_for_a_while_beyond_what_was_read():
    echo = GroundEcho()
    echo.receive(answered(asked(echo, 0.0)))
    second = asked(echo, PERIOD_S)
    late_s = PERIOD_S + BEHIND_S
    assert echo.awaits_after_s(late_s - 0.01) is None
    assert echo.awaits_after_s(late_s) == 0.0
    echo.receive(answered(second))
    assert echo.awaits_after_s(late_s) is None
    third = echo.again(late_s)
    assert echo.awaits_after_s(late_s + BEHIND_S) == pytest.approx(PERIOD_S)
    echo.receive(answered(third))
    assert echo.awaits_after_s(late_s + BEHIND_S) is None


def test_the_answer_to_a_repeated_request_counts_for_all_before_it():
    echo = GroundEcho()
    echo.receive(answered(asked(echo, 0.0)))
    lost = asked(echo, PERIOD_S)
    repeated = echo.again(0.4)
    echo.receive(answered(repeated))
    assert echo.awaits_after_s(0.8) is None
    echo.receive(answered(lost))  # late: it says nothing new
    assert echo.awaits_after_s(0.8) is None


def test_a_station_that_answers_again_is_waited_for_again():
    echo = GroundEcho()
    echo.receive(answered(asked(echo, 0.0)))
    asked(echo, PERIOD_S)
    late_s = PERIOD_S + UNANSWERED_PERIOD_S
    assert echo.due(late_s - 0.01) is not None  # the pause begins after the second request
    assert echo.awaits_after_s(late_s) == 0.0
    echo.receive(answered(echo.again(late_s)))
    assert echo.awaits_after_s(late_s) is None
    assert echo.due(late_s + PERIOD_S) is not None
