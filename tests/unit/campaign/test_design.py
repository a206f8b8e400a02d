"""The design of a campaign: the syntax of options, and draws that depend on campaign and index alone."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gcs.campaign.design import Factor, FaultFactors, Sampling, draw, parse_factor, parse_fault, parse_share, parse_wind
from gcs.errors import UsageError
from sim_bridge.faults.fault_spec import parse_faults

SYSIDS = (1, 2, 3)


def everything() -> tuple[list[Factor], list[FaultFactors]]:
    gusts = parse_factor("--gusts", "gusts", "light,moderate")
    faults = [parse_fault("25%:any:die@any", 1, SYSIDS, 60.0), parse_fault("any:down.loss=0..20%", 2, SYSIDS, 60.0)]
    return [*parse_wind("0..6@any"), gusts], faults


@given(st.integers(0, 2**32), st.integers(0, 20), st.integers(0, 20))
def test_a_flight_does_not_depend_on_how_many_fly(campaign: int, few: int, more: int) -> None:
    factors, faults = everything()
    assert draw(factors, faults, campaign, few + more)[:few] == draw(factors, faults, campaign, few)


def test_another_campaign_is_another_design() -> None:
    factors, faults = everything()
    assert draw(factors, faults, 1, 5) != draw(factors, faults, 2, 5)
    seeds = [row["seed"] for campaign in range(20) for row in draw([], [], campaign, 50)]
    assert len(set(seeds)) == len(seeds)


def test_values_keep_to_their_distributions() -> None:
    factors, faults = everything()
    rows = draw(factors, faults, 7, 2000)
    speed, origin = (np.array([row[key] for row in rows]) for key in ("wind_mps", "wind_from_deg"))
    assert (speed.min(), speed.max()) == (pytest.approx(0.0, abs=0.02), pytest.approx(6.0, abs=0.02))
    assert np.histogram(origin, 4, (0.0, 360.0))[0].min() > 430
    assert sum(row["gusts"] == "light" for row in rows) == pytest.approx(1000, abs=90)
    assert sum(bool(row["fault1_text"]) for row in rows) == pytest.approx(500, abs=80)
    assert {row["fault2_vehicle"] for row in rows} == {"1", "2", "3"}


def test_the_simulator_reads_every_drawn_fault() -> None:
    factors, faults = everything()
    for row in draw(factors, faults, 3, 100):
        texts = [str(row[key]) for key in ("fault1_text", "fault2_text") if row[key]]
        read = parse_faults(texts, SYSIDS)
        if row["fault1"]:
            (dies,) = (f for f in read[int(row["fault1_vehicle"])] if f.kind.name == "die")
            assert dies.when.from_s == row["fault1_at_s"]
        (loses,) = (f for f in read[int(row["fault2_vehicle"])] if f.kind.name == "loss")
        assert loses.values[0] == row["fault2_value"] <= 0.2


def test_words_of_a_fault_are_drawn() -> None:
    fault = parse_fault("67%:all:slow-down=at-once|late", 1, SYSIDS, 60.0)
    texts = [str(row["fault1_text"]) for row in draw([], [fault], 3, 300)]
    assert set(texts) == {"", "all:slow-down=at-once", "all:slow-down=late"}
    assert min(texts.count(text) for text in set(texts)) > 70
    for text in set(texts) - {""}:
        assert set(parse_faults([text], SYSIDS)) == set(SYSIDS)
    for wrong in ("all:slow-down=at-once|", "all:slow-down=late|late"):
        with pytest.raises(UsageError, match="empty or equal"):
            parse_fault(wrong, 1, SYSIDS, 60.0)


@given(st.integers(0, 1000), st.integers(1, 60))
def test_a_latin_hypercube_has_every_stratum_once(campaign: int, flights: int) -> None:
    wind = list(parse_wind("0..6@any"))
    rows = draw(wind, [], campaign, flights, Sampling.LATIN)
    for key, width in (("wind_mps", 6.0 / flights), ("wind_from_deg", 360.0 / flights)):
        assert sorted(int(float(row[key]) / width * (1.0 + 1e-12)) for row in rows) == list(range(flights))


def test_a_full_factorial_has_every_combination_as_often() -> None:
    factors = [*parse_wind("0..6/4@0,90,180"), parse_factor("--gusts", "gusts", "light,moderate")]
    faults = [parse_fault("5%:1:die@20", 1, SYSIDS, 60.0)]
    rows = draw(factors, faults, 0, 2 * 48, Sampling.FULL)
    seen = [(row["wind_mps"], row["wind_from_deg"], row["gusts"], row["fault1_text"]) for row in rows]
    assert len(set(seen)) == 48
    assert seen[:48] == seen[48:]
    assert len({row["seed"] for row in rows}) == 96
    with pytest.raises(UsageError, match="needs levels of wind_mps"):
        draw(list(parse_wind("0..6@0")), [], 0, 4, Sampling.FULL)


def test_a_certain_fault_always_happens_also_where_losses_reach_one() -> None:
    fault = parse_fault("2:loss=0..100%/3", 1, SYSIDS, 60.0)
    texts = [row["fault1_text"] for row in draw([], [fault], 0, 3, Sampling.FULL)]
    assert texts == ["2:loss=0.0", "2:loss=0.5", "2:loss=1.0"]


@pytest.mark.parametrize("text", ["", "6..0", "1..", "..", "a,,b", "1,1", "0..6/1", "1..2..3"])
def test_what_is_no_distribution_is_refused_by_its_option(text: str) -> None:
    with pytest.raises(UsageError, match=r"--gusts"):
        parse_factor("--gusts", "gusts", text)


@pytest.mark.parametrize("text", ["3", "light@0", "-1..3@any", "any@any"])
def test_a_wrong_wind_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--wind"):
        parse_wind(text)


@pytest.mark.parametrize("text", ["die", "9:die", "1:loss=0..x", "1:loss=3..1", "200%:1:die", "1..5%:1:die"])
def test_a_wrong_fault_is_refused(text: str) -> None:
    with pytest.raises(UsageError, match="--fault"):
        parse_fault(text, 1, SYSIDS, 60.0)


def test_a_share_is_at_most_all() -> None:
    assert parse_share("--loss", "loss", "0..20%").high == pytest.approx(0.2)
    with pytest.raises(UsageError, match="--loss"):
        parse_share("--loss", "loss", "0..20")
