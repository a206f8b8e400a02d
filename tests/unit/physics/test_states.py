"""The columns of states have names, and the page about them says the same."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from gcs.physics.states import NamedStates


def test_every_column_has_its_name() -> None:
    values = np.arange(24.0).reshape(2, 12)
    named = NamedStates(values)
    groups = (named.position_ned_m, named.velocity_ned_mps, named.attitude_rad, named.rates_radps)
    assert np.array_equal(np.concatenate(groups, axis=1), values)
    assert named.north_m.tolist() == [0.0, 12.0]
    assert named.east_m.tolist() == [1.0, 13.0]
    assert named.height_m.tolist() == [-2.0, -14.0]
    assert named.speed_mps == pytest.approx([np.sqrt(50.0), np.sqrt(15.0**2 + 16.0**2 + 17.0**2)])
    assert NamedStates(np.zeros((3, 4, 12))).position_ned_m.shape == (3, 4, 3)


def test_another_array_is_refused() -> None:
    with pytest.raises(ValueError, match=r"must be \(..., 12\), not \(3, 16\)"):
        NamedStates(np.zeros((3, 16)))


def test_the_page_names_every_accessor(repo_root: Path) -> None:
    page = (repo_root / "docs" / "python.md").read_text(encoding="utf-8")
    for name, thing in vars(NamedStates).items():
        assert not isinstance(thing, property) or f"`{name}`" in page, name
