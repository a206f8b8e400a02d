"""Rows of export formats: chosen by name, joined by rows of the caller's own."""

from __future__ import annotations

from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from gcs.errors import UsageError
from gcs.mission.export.export import export
from gcs.mission.formats.maps.tracks import MapFile
from gcs.mission.formats.registry import DEFAULT, FORMATS, Content, Format, select_formats
from gcs.plan.trajectory.plan import Plan


def write_tracks(file: MapFile) -> str:
    return "".join(f"{track.sysid} {len(track.t_s)}\n" for track in file.tracks)


OWN = Format("own", ".own", Content.MAP, "points of every track", write_tracks)


def names(rows: tuple[Format, ...]) -> list[str]:
    return [row.name for row in rows]


def test_formats_by_name() -> None:
    assert names(DEFAULT) == ["plan", "waypoints", "setpoints"]
    assert select_formats([]) == ()
    assert names(select_formats(["kml", "plan", "kml"])) == ["plan", "kml"]
    assert select_formats(["all"]) == tuple(row for row in FORMATS if not row.asked)
    assert select_formats(FORMATS) == FORMATS
    assert names(select_formats([OWN, "kml", OWN])) == ["kml", "own"]
    with pytest.raises(UsageError, match="no format 'dxf'"):
        select_formats(["plan", "dxf"])


def test_two_formats_do_not_write_one_file() -> None:
    with pytest.raises(UsageError, match=r"'kml' and 'own' both write files that end in \.kml"):
        select_formats(["kml", replace(OWN, suffix=".kml")])


def test_missions_are_always_read_back() -> None:
    with pytest.raises(UsageError, match="'own' holds missions and has no reader"):
        select_formats([replace(OWN, content=Content.MISSION)])
    with pytest.raises(UsageError, match="'own' has no reader"):
        OWN.read(b"", "own")


def test_a_row_of_the_caller_is_exported(simulation1_plan: Plan, tmp_path: Path) -> None:
    index = export(simulation1_plan, tmp_path / "out", formats=[OWN, "geojson"])
    assert list(index.sha256) == ["formation.geojson", "formation.own"]
    assert (tmp_path / "out" / "formation.own").read_text().startswith("1 ")


@pytest.mark.parametrize("content", Content)
def test_a_content_names_a_type_that_exists(content: Content) -> None:
    module, _, name = content.rpartition(".")
    assert isinstance(getattr(import_module(module), name), type)


@pytest.mark.parametrize("row", FORMATS, ids=lambda row: row.name)
def test_a_row_names_functions_that_exist(row: Format) -> None:
    for function in (row.writer, row.reader or row.writer):
        assert isinstance(function, str)
        module, name = function.split(":")
        assert callable(getattr(import_module(module), name))
    assert all(suffix.startswith(".") for suffix in row.suffixes)
