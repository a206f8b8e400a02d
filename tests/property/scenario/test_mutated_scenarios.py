"""Scenarios, vehicle types and plans with mistakes of every kind: a `GcsError` or an answer, never anything else.

A warning of NumPy (overflow, invalid value) counts as a failure: the verdict after it would rest on no number. A few
seeds of each file are tried always, more with `-m slow`. The long form has 20,000 of each, and plans some of the
accepted ones:
`./tools/run pytest -m long tests/property/scenario/test_mutated_scenarios.py`, about two hours on one core.
"""

from __future__ import annotations

import io
import json
import random
import shutil
import time
import tomllib
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from gcs.cli.main import run
from gcs.errors import FileFormatError, GcsError
from gcs.plan.plan_file import _checksum, load_plan, read_plan, save_plan
from gcs.plan.trajectory.plan import Plan
from gcs.plan.verification.verify import verify
from gcs.scenario.sources.load import load_scenario, load_vehicle
from tests.property.scenario.mutations import (
    HEX_DIGITS,
    PRESETS,
    ROOT,
    bundled,
    mutated,
    mutated_text,
    numbers_of,
    toml_text,
)
from tests.property.scenario.scenario_steps import ACCEPTED, REFUSED, planned, verdict

SHORT, LONG, CHUNK = 16, 20_000, 1000
EVERY = 7  # number of a scenario is tried always
VERIFIED = 20  # one in so many plans with mutated scenarios
CPU_MAX_S = 60.0  # of one scenario, planning aside: none takes a tenth of it
TEXTS = bundled()
NAMES = sorted(TEXTS)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with the elevation model of missions/ridge."""
    shutil.copy(ROOT / "missions" / "ridge" / "ridge.tif", tmp_path)
    return tmp_path


def survive(folder: Path, name: str, seeds: range, *, plan: bool = False) -> Counter[str]:
    """The verdicts on mutations of one scenario by values and keys, and of every tenth by bytes."""
    file, data = folder / "scenario.toml", tomllib.loads(TEXTS[name])
    verdicts: Counter[str] = Counter()
    for seed in seeds:
        chance = random.Random(f"{name} {seed}")
        if seed % 10 == 9:
            file.write_bytes(mutated_text(TEXTS[name], chance))
        else:
            file.write_text(toml_text(mutated(data, chance)), encoding="utf-8")
        began_s = time.process_time()
        try:
            verdicts[found := verdict(file)] += 1
            assert time.process_time() - began_s < CPU_MAX_S
            if plan and found == ACCEPTED and verdicts[found] == 1:  # planning takes minutes where there is no plan
                verdicts[planned(file)] += 1
        except Exception as problem:
            problem.add_note(f"{name}, seed {seed}")
            raise
    return verdicts


@pytest.mark.parametrize("seeds", [range(7, 10), pytest.param(range(SHORT), marks=pytest.mark.slow)], ids=len)
@pytest.mark.parametrize("name", NAMES)
def test_mutated_scenarios_fail_with_a_sentence_only(folder: Path, name: str, seeds: range) -> None:
    verdicts = survive(folder, name, seeds)
    assert verdicts[REFUSED] > 0


@pytest.mark.parametrize("most", [16, pytest.param(32, marks=pytest.mark.slow)])
def test_some_mutations_pass_all_checks(folder: Path, most: int) -> None:
    assert survive(folder, "field/scenario.toml", range(SHORT, SHORT + most))[ACCEPTED] > most / 10


@pytest.mark.long
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("first", range(0, LONG, CHUNK))
def test_many_mutated_scenarios_fail_with_a_sentence_only(folder: Path, name: str, first: int) -> None:
    verdicts = survive(folder, name, range(first, first + CHUNK), plan=True)
    assert verdicts[REFUSED] > CHUNK / 4 and verdicts[ACCEPTED] > CHUNK / 50, verdicts


@pytest.mark.parametrize("seeds", [range(4), pytest.param(range(4, 16), marks=pytest.mark.slow)], ids=len)
@pytest.mark.parametrize("command", ["show", "plan", "check", "export", "verify"])
def test_commands_refuse_mutated_scenarios_with_a_code(
    folder: Path, command: str, seeds: range, capsys: pytest.CaptureFixture[str]
) -> None:
    data, file = tomllib.loads(TEXTS["template_full"]), folder / "scenario.toml"
    refused = 0
    for seed in seeds:
        file.write_text(toml_text(mutated(data, random.Random(f"{command} {seed}"))), encoding="utf-8")
        if command in ("plan", "export", "verify") and verdict(file) == ACCEPTED:
            continue  # the planner has its own time
        code = run([command, str(file), "--json"])
        said = capsys.readouterr()
        assert code in range(10), (seed, code, said)
        refused += code != 0
    assert refused > 0


SEEDS_OF_TYPES = (
    range(12),
    pytest.param(range(60), marks=pytest.mark.slow),
    pytest.param(range(60, 10_000), marks=pytest.mark.long),
)
SEEDS_OF_PLANS = (
    range(8),
    pytest.param(range(24), marks=pytest.mark.slow),
    pytest.param(range(24, 5000), marks=pytest.mark.long),
)


@pytest.mark.parametrize("preset", PRESETS, ids=lambda file: str(file.stem))
@pytest.mark.parametrize("seeds", SEEDS_OF_TYPES, ids=len)
def test_mutated_vehicle_types_fail_with_a_sentence_only(folder: Path, preset: Path, seeds: range) -> None:
    text = preset.read_text()
    mission = TEXTS["template"].replace('vehicle_type = "quad500"', 'vehicle_type = "kind.toml"')
    assert mission != TEXTS["template"]
    (folder / "scenario.toml").write_text(mission, encoding="utf-8")
    accepted = 0
    for seed in seeds:
        chance = random.Random(f"{preset.name} {seed}")
        content = toml_text(mutated(tomllib.loads(text), chance)).encode()
        (folder / "kind.toml").write_bytes(mutated_text(text, chance) if seed % 5 == 4 else content)
        try:
            accepted += verdict(folder / "scenario.toml") == ACCEPTED
            load_vehicle(folder / "kind.toml")
        except GcsError:
            continue
        except Exception as problem:
            problem.add_note(f"{preset.name}, seed {seed}")
            raise
    assert accepted > 0


@pytest.mark.parametrize("seeds", SEEDS_OF_PLANS, ids=len)
def test_plan_files_with_mutated_scenarios_fail_with_a_sentence_only(
    tmp_path: Path, simulation1_plan: Plan, seeds: range
) -> None:
    """Their checksum is made anew, so that only the scenario itself can be refused."""
    refused = accepted = 0
    whole, path = tmp_path / "whole.skein", tmp_path / "changed.skein"
    save_plan(simulation1_plan, verify(simulation1_plan), whole)
    relief = load_scenario(ROOT / "missions" / "ridge").terrain.model_dump(mode="json")
    with np.load(whole) as file:
        arrays = {name: file[name] for name in file.files if name != "checksum"}
    for seed in seeds:
        chance = random.Random(seed)
        meta = json.loads(arrays["meta"].tobytes())
        if seed % 4 == 0:
            meta["scenario"]["terrain"] = relief
        meta["scenario"] = mutated(meta["scenario"], chance)
        changed = {**arrays, "meta": np.frombuffer(json.dumps(meta, default=str).encode(), dtype=np.uint8)}
        buffer = io.BytesIO()
        np.savez(buffer, **changed, checksum=_checksum(changed))  # type: ignore[arg-type]
        path.write_bytes(buffer.getvalue())
        try:
            read_plan(path)
            if (accepted := accepted + 1) % VERIFIED == 0:
                load_plan(path, lambda _: None)
        except FileFormatError as error:
            assert error.__cause__ is None or isinstance(error.__cause__, ValidationError), seed
            refused += 1
    assert accepted > len(seeds) / 20
    assert refused > len(seeds) / 4


@pytest.mark.parametrize(
    ("number", "every"),
    [
        (1e308, EVERY),
        pytest.param(1e308, 1, marks=pytest.mark.slow),
        pytest.param(-1e308, 1, marks=pytest.mark.slow),
    ],
)
def test_every_number_has_a_range(folder: Path, number: float, every: int) -> None:
    """One number after the other, those that a file may leave out among them."""
    whole, file = load_scenario(ROOT / "missions" / "simulation1"), folder / "scenario.toml"
    data = whole.model_dump(mode="json", exclude_none=True)
    slots = numbers_of(data)
    for node, key in slots[::every]:
        before, node[key] = node[key], number
        file.write_text(toml_text(data), encoding="utf-8")
        assert verdict(file) == REFUSED, (key, before)
        node[key] = before
    assert len(slots) > 80


def test_a_vehicle_type_with_a_long_name_is_refused(folder: Path) -> None:
    (folder / "scenario.toml").write_text(TEXTS["template"].replace('"quad500"', f'"{"x" * 5000}"'))
    with pytest.raises(GcsError, match=r"vehicle_type = \".*\.\.\.: is neither a vehicle type nor a file"):
        load_scenario(folder / "scenario.toml")


@pytest.mark.parametrize("depth", [50, 330, 400, 490, 2000, 100_000])
@pytest.mark.parametrize("opens", ["[", "{a="])
def test_values_nested_deeply_fail_with_a_sentence(tmp_path: Path, depth: int, opens: str) -> None:
    nested = opens * depth + "1" + {"[": "]", "{a=": "}"}[opens] * depth
    file = tmp_path / "scenario.toml"
    file.write_text(TEXTS["field/scenario.toml"].replace("flight_s = ", f"flight_s = {nested} #", 1))
    with pytest.raises(GcsError, match=r"flight_s|nested"):
        load_scenario(file)


def test_a_number_of_thousands_of_digits_fails_with_a_short_sentence(tmp_path: Path) -> None:
    file = tmp_path / "scenario.toml"
    file.write_text(TEXTS["field/scenario.toml"].replace("flight_s = ", f"flight_s = 0x{'f' * HEX_DIGITS} #", 1))
    with pytest.raises(GcsError, match=r"time\.flight_s = 0xf{70,80}\.\.\.: must be a number from 0\.01 to 7200"):
        load_scenario(file)
