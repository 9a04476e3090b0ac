"""Uncertainty: the GUM's own example to twelve digits, Monte Carlo beside propagation, and what cannot be budgeted."""

from __future__ import annotations

import json
from math import inf

import numpy as np
import pytest

from algorithms.trust.budget import (
    Source,
    compare,
    coverage_factor,
    from_half_width,
    from_readings,
    monte_carlo,
    propagate,
)

# GUM H.1: an end gauge of 50 mm against a standard, in nm (lengths), K and 1/K
END_GAUGE = [
    Source("standard", 50_000_623.0, 25.0, 18),
    Source("difference", 215.0, 5.8, 24),
    Source("random effects", 0.0, 3.9, 5),
    Source("systematic effects", 0.0, 6.7, 8),
    from_half_width("expansion", 11.5e-6, 2e-6),
    Source("mean temperature", -0.1, 0.2),
    from_half_width("cyclic temperature", 0.0, 0.5, "arcsine"),
    from_half_width("difference of expansion", 0.0, 1e-6, degrees_of_freedom=50),
    from_half_width("difference of temperature", 0.0, 0.05, degrees_of_freedom=2),
]


def end_gauge(of):
    """GUM Eq. H.3, its sources apart."""
    off = of["mean temperature"] + of["cyclic temperature"]
    warm = of["difference of expansion"] * off + of["expansion"] * of["difference of temperature"]
    found = of["difference"] + of["random effects"] + of["systematic effects"]
    return of["standard"] + found - of["standard"] * warm


def test_gum_h1_to_twelve_digits(shared):
    said = json.loads((shared / "reference" / "answers.json").read_text())["gum_H1"]
    budget = propagate(end_gauge, END_GAUGE)
    assert budget.value == pytest.approx(said["value"], abs=1e-6)
    assert budget.u == pytest.approx(said["u"], rel=1e-12)
    assert budget.degrees_of_freedom == pytest.approx(said["dof_WS"], rel=1e-12)
    assert round(budget.u) == said["u_published"]
    assert int(budget.degrees_of_freedom) == said["dof_published"]
    assert budget.coverage_factor(0.99) == pytest.approx(said["k99"], abs=5e-3)
    assert budget.coverage_factor(0.99) * said["u_published"] == pytest.approx(said["U99"], abs=0.5)
    assert sum(part.variance_pct for part in budget.parts) == pytest.approx(100)


def test_monte_carlo_agrees_where_the_model_is_straight_and_says_so_where_it_is_not():
    rng = np.random.default_rng(0)
    lengths = [Source("a", 10.0, 0.3), Source("b", 4.0, 0.4)]

    def hypotenuse(of):
        return (of["a"] ** 2 + of["b"] ** 2) ** 0.5

    def total(of):
        return of["a"] + 2 * of["b"]

    def square(of):
        return of["a"] * of["a"]

    budget = propagate(hypotenuse, lengths)
    assert budget.u == pytest.approx(np.hypot(10 * 0.3, 4 * 0.4) / np.hypot(10, 4), rel=1e-12)
    assert not compare(budget, monte_carlo(hypotenuse, lengths, rng, 400_000)).agree  # it bends: the mean lies higher
    straight = propagate(total, lengths)
    draws = monte_carlo(total, lengths, rng, 1_000_000)
    assert compare(straight, draws).agree
    assert draws.u == pytest.approx(straight.u, rel=0.01)
    at_nothing = [Source("a", 0.0, 1.0)]
    flat, drawn = propagate(square, at_nothing), monte_carlo(square, at_nothing, rng, 100_000)
    assert flat.u == 0.0
    assert drawn.u == pytest.approx(2**0.5, rel=0.05)
    assert not compare(flat, drawn).agree


def test_laws_have_the_standard_uncertainty_they_say():
    rng = np.random.default_rng(1)
    for law, u in (("rectangular", 3**-0.5), ("triangular", 6**-0.5), ("arcsine", 2**-0.5)):
        source = from_half_width("x", 5.0, 1.0, law)
        assert source.u == pytest.approx(u)
        draws = monte_carlo(lambda of: of["x"], [source], rng, 200_000, 0.9999)
        assert (draws.value, draws.u) == pytest.approx((5.0, u), rel=0.01)
        assert 4.0 - 1e-9 <= draws.low < draws.high <= 6.0 + 1e-9


def test_few_readings_make_students_t_in_both_ways():
    source = from_readings("x", np.array([67.2, 72.3, 67.7, 71.3, 76.6, 66.1]))
    budget = propagate(lambda of: of["x"], [source])
    assert budget.expanded() == pytest.approx(4.162, abs=5e-4)
    draws = monte_carlo(lambda of: of["x"], [source], np.random.default_rng(2), 400_000)
    assert draws.high - draws.low == pytest.approx(2 * 4.162, rel=0.02)


def test_intervals_by_propagation_hold_the_truth_as_often_as_they_say():
    """Two sources of six and of four readings each: without Student's t it would be 89 %."""
    rng, held = np.random.default_rng(3), 0
    for _ in range(1500):
        sources = [from_readings("a", rng.normal(3, 1, 6)), from_readings("b", rng.normal(2, 0.5, 4))]
        budget = propagate(lambda of: of["a"] * of["b"], sources)
        held += abs(budget.value - 6.0) <= budget.expanded()
    assert 0.93 < held / 1500 < 0.975


def test_coverage_factors():
    assert coverage_factor(0.95) == pytest.approx(1.95996, abs=1e-5)
    assert coverage_factor(0.95, 5) == pytest.approx(2.571, abs=5e-4)
    assert coverage_factor(0.95, 5.9) == coverage_factor(0.95, 5)
    assert propagate(lambda of: 2 * of["a"], [Source("a", 1.0, 0.5)]).degrees_of_freedom == inf


@pytest.mark.parametrize(
    ("make", "match"),
    [
        (lambda: Source("a", np.nan, 1.0), "finite"),
        (lambda: Source("a", 1.0, -1.0), "at least 0"),
        (lambda: Source("a", 1.0, 1.0, 0.0), "degrees of freedom"),
        (lambda: from_readings("a", np.array([1.0])), "at least 2"),
        (lambda: from_readings("a", np.array([1.0, np.nan])), "finite"),
        (lambda: propagate(end_gauge, []), "there are none"),
        (lambda: propagate(lambda of: of["a"], [Source("a", 1.0, 1.0)] * 2), "each another"),
        (lambda: propagate(lambda of: abs(of["a"]), [Source("a", 1.0, 1.0)]), "drops the complex part"),
        (lambda: propagate(lambda of: np.hypot(of["a"], 1), [Source("a", 1.0, 1.0)]), "complex a"),
        (lambda: coverage_factor(1.5), "between 0 and 1"),
        (lambda: coverage_factor(0.95, 0.5), "too few"),
        (lambda: monte_carlo(lambda of: of["a"], [Source("a", 1.0, 1.0)], np.random.default_rng(0), 10), "too few"),
    ],
)
def test_what_cannot_be_is_named(make, match):
    with pytest.raises(ValueError, match=match):
        make()
