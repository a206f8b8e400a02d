"""How large a vehicle is drawn in the picture of a shape."""

from __future__ import annotations

import pytest

from gcs.flight.plots.shape_view import dot_pt


def test_a_hundred_dots_fit_where_seven_have_room_to_spare() -> None:
    assert dot_pt(7, 8.0) == 8.0
    assert dot_pt(100, 8.0) == pytest.approx(2.5)
    assert dot_pt(1000, 8.0) < dot_pt(100, 8.0)
