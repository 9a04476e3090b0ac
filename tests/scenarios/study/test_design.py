"""Factors and designs: laws of the inverse distributions, and the same points every time."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.study.design import Grid, LatinHypercube, Sobol, point_count, points
from scenarios.study.factors import DISTRIBUTIONS, Levels, LogUniform, Normal, Range, Triangular, Uniform, same_values

CONTINUOUS = {
    "range": Range(low=1.0, high=3.0),
    "log range": Range(low=1.0, high=100.0, scale="log"),
    "uniform": Uniform(low=-1.0, high=3.0),
    "log-uniform": LogUniform(low=0.1, high=10.0),
    "normal": Normal(mean=2.0, std=0.5),
    "cut normal": Normal(mean=2.0, std=0.5, low=1.9, high=2.4),
    "triangular": Triangular(low=0.0, mode=1.0, high=4.0),
}
MEANS = {"range": 2.0, "uniform": 1.0, "normal": 2.0, "triangular": 5 / 3}


@pytest.mark.parametrize("name", CONTINUOUS)
def test_a_factor_rises_with_its_number_and_stays_within_its_ends(name):
    factor = CONTINUOUS[name]
    values = np.array(factor.at(np.linspace(0, 1, 1001)))
    assert (np.diff(values) >= 0).all()
    assert factor.levels() is None
    low = getattr(factor, "low", None)
    assert values[0] == pytest.approx(low if low is not None else 2.0 - 5 * 0.5)
    if name in MEANS:
        assert values.mean() == pytest.approx(MEANS[name], rel=1e-2)


def test_the_normal_has_its_width():
    values = np.array(CONTINUOUS["normal"].at(np.random.default_rng(0).random(20_000)))
    assert values.std() == pytest.approx(0.5, rel=0.03)


def test_every_distribution_is_tried_here():
    assert {type(factor) for factor in CONTINUOUS.values()} >= set(DISTRIBUTIONS.values())


def test_a_range_has_its_steps():
    assert Range(low=0.0, high=1.0, steps=3).levels() == (0.0, 0.5, 1.0)
    assert Range(low=1.0, high=100.0, steps=3, scale="log").levels() == (1.0, 10.0, 100.0)
    assert Range(low=1.0, high=4.0, steps=4, whole=True).levels() == (1, 2, 3, 4)
    assert Range(low=0.0, high=1.0, steps=2).at(np.array([0.0, 0.49, 0.51, 1.0])) == [0.0, 0.0, 1.0, 1.0]


def test_a_list_is_drawn_in_equal_parts():
    drawn = Levels(("a", "b", "c")).at(np.linspace(0, 1, 300, endpoint=False))
    assert {drawn.count(value) for value in "abc"} == {100}


def test_a_grid_is_every_combination_once():
    factors = [Levels((1, 2, 3)), Range(low=0.0, high=1.0, steps=2)]
    found = list(points(Grid(), factors))
    assert found == [(1, 0.0), (1, 1.0), (2, 0.0), (2, 1.0), (3, 0.0), (3, 1.0)]
    assert point_count(Grid(), factors) == len(found)
    assert list(points(Grid(), [])) == [()]


@pytest.mark.parametrize("design", [LatinHypercube(points=16), Sobol(points=16)])
def test_a_sampled_design_covers_every_sixteenth_once(design):
    factors = [Uniform(low=0.0, high=16.0), Range(low=0.0, high=16.0)]
    found = np.array(list(points(design, factors)))
    assert found.shape == (16, 2)
    for column in found.T:
        assert sorted(column.astype(int)) == list(range(16))
    assert list(points(design, factors)) == list(points(design, factors))
    other = design.model_copy(update={"draw_seed": 1})
    assert list(points(other, factors)) != list(points(design, factors))


def test_seeds_are_a_number_of_them_or_a_list():
    assert Grid(seeds=3).seeds == (0, 1, 2)
    assert Grid(seeds=(5, 2)).seeds == (5, 2)
    for wrong in (0, (), (1, 1), -1, True):
        with pytest.raises(ValueError, match="seeds"):
            Grid(seeds=wrong)


def test_equal_values_are_noticed():
    assert same_values([1, 1.0, True, "1"]) is None
    assert same_values([{"a": 1}, 2, {"a": 1}]) == (0, 2)
