"""Gauge studies: the manual's printed answers, known spreads found again, and what cannot be studied."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from algorithms.trust.gauge import gauge_study, range_factor, range_study


@pytest.fixture(scope="module")
def said(shared):
    return json.loads((shared / "reference" / "answers.json").read_text())["gauge_aiag"]


@pytest.fixture(scope="module")
def values(shared):
    with (shared / "reference" / "gauge" / "aiag_msa_10x3x3.csv").open() as file:
        return np.array([float(row["y"]) for row in csv.DictReader(file)]).reshape(10, 3, 3)


def test_the_manuals_study_by_variance(said, values):
    study = gauge_study(values)
    part, operator, cross, repeat, total = study.table
    for line, name in ((part, "SS_part"), (operator, "SS_oper"), (cross, "SS_int"), (repeat, "SS_rep")):
        assert line.sum_of_squares == pytest.approx(said[name], abs=5e-5)
    assert total.sum_of_squares == pytest.approx(sum(line.sum_of_squares for line in study.table[:4]))
    assert cross.f == pytest.approx(said["F_int"], abs=5e-4)
    assert cross.p == pytest.approx(said["p_int"], abs=5e-5)
    assert study.pooled
    for name, sd in said["anova_pooled_sd"].items():
        assert study.sd(name) == pytest.approx(sd, abs=1.6e-6)  # GRR is printed as the root of rounded parts
    grr = next(one for one in study.variation if one.name == "GRR")
    assert grr.contribution_pct == pytest.approx(said["pct_contribution_GRR"], abs=5e-3)
    assert grr.study_variation_pct == pytest.approx(said["pct_SV_GRR"], abs=5e-3)
    assert study.ndc == said["ndc"]
    low, high = study.repeatability_interval
    assert low < study.sd("EV") < high


def test_the_manuals_study_by_ranges(said, values):
    study, printed = range_study(values), said["xbar_r"]
    assert study.mean_range == pytest.approx(printed["Rbar"], abs=5e-5)
    assert study.operator_difference == pytest.approx(printed["Xdiff"], abs=5e-5)
    by_name = {part.name: part for part in study.variation}
    for name in ("EV", "AV", "GRR", "PV", "TV"):
        assert by_name[name].standard_deviation == pytest.approx(printed[name], abs=5.1e-5)
    assert by_name["GRR"].study_variation_pct == pytest.approx(printed["pctGRR"], abs=0.05)
    assert study.ndc == printed["ndc"]


def test_range_factors_are_the_tables():
    for size, d2 in ((2, 1.128), (3, 1.693), (5, 2.326), (10, 3.078)):
        assert range_factor(size) == pytest.approx(d2, abs=5e-4)
    for size, d2_star in ((2, 1.41421), (3, 1.91155), (10, 3.17905)):
        assert range_factor(size, 1) == pytest.approx(d2_star, abs=5e-5)


def drawn(seed, cross_sd, parts=30, operators=12, trials=4):
    """Part 1, operator 0.3, interaction as given, repeatability 0.2."""
    rng = np.random.default_rng(seed)
    part, operator = rng.normal(0, 1, (parts, 1, 1)), rng.normal(0, 0.3, (1, operators, 1))
    cross = rng.normal(0, cross_sd, (parts, operators, 1))
    return part + operator + cross + rng.normal(0, 0.2, (parts, operators, trials))


def test_known_spreads_are_found_again():
    study = gauge_study(drawn(0, 0.25))
    assert not study.pooled
    assert study.sd("EV") == pytest.approx(0.2, rel=0.05)
    assert study.sd("INT") == pytest.approx(0.25, rel=0.1)
    assert study.sd("AV") == pytest.approx(0.3, rel=0.5)
    assert study.sd("PV") == pytest.approx(1.0, rel=0.3)
    assert study.sd("GRR") ** 2 + study.sd("PV") ** 2 == pytest.approx(study.sd("TV") ** 2)


def test_the_interval_of_repeatability_holds_it():
    held = 0
    for seed in range(200):
        low, high = gauge_study(drawn(seed, 0.0, 5, 3, 2), pool_above=1.0).repeatability_interval
        held += low <= 0.2 <= high
    assert 180 <= held <= 199  # 190 expected, standard deviation 3.1


def test_a_variance_below_nothing_is_named():
    rng = np.random.default_rng(8)
    study = gauge_study(rng.normal(0, 1, (10, 1, 1)) + rng.normal(0, 1, (10, 3, 3)) * 0.5)
    assert study.negative == ("AV",)
    assert study.sd("AV") == 0.0


@pytest.mark.parametrize(
    ("shape", "value", "match"),
    [((1, 3, 3), 0.0, "at least 2"), ((3, 1, 3), 0.0, "at least 2"), ((3, 3, 1), 0.0, "at least 2")],
)
def test_studies_that_are_too_small_are_refused(shape, value, match):
    with pytest.raises(ValueError, match=match):
        gauge_study(np.full(shape, value))


def test_values_that_cannot_be_studied_are_refused():
    values = np.random.default_rng(0).normal(size=(3, 3, 2))
    values[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="not finite"):
        gauge_study(values)
    with pytest.raises(ValueError, match="all values are the same"):
        range_study(np.ones((3, 3, 2)))
    with pytest.raises(ValueError, match="no repeatability"):
        gauge_study(np.repeat(np.random.default_rng(0).normal(size=(3, 3, 1)), 2, axis=2))
