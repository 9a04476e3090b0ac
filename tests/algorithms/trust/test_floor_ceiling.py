"""Curves that start above 0 or end below 1."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms.trust.curve import NoCurve, one_sided_drop, size_at, size_bound
from algorithms.trust.floor_ceiling import fit_floor_ceiling
from algorithms.trust.hit_miss import HitMiss, fit_hit_miss
from algorithms.trust.links import LINKS


def drawn(seed, floor, ceiling, n=3000, blanks=0):
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.5, 20, n)
    pod = floor + (ceiling - floor) * LINKS["logit"].cdf((np.log(size) - np.log(4)) / 0.25)
    called = float(rng.binomial(blanks, floor)) if blanks else 0.0
    return HitMiss(size, rng.random(n) < pod, np.ones(n), float(blanks), called)


def test_floor_and_ceiling_are_found_again():
    curve = fit_floor_ceiling(drawn(0, 0.1, 0.95, blanks=300))
    assert curve.floor == pytest.approx(0.1, abs=0.03)
    assert curve.ceiling == pytest.approx(0.95, abs=0.015)
    assert curve.mu == pytest.approx(np.log(4), abs=0.05)
    assert curve.sigma == pytest.approx(0.25, rel=0.2)
    assert size_bound(curve, 0.9, one_sided_drop(0.95)) > size_at(curve, 0.9)


def test_without_either_it_is_the_plain_curve():
    data = drawn(1, 0.0, 1.0, 300)
    plain, free = fit_hit_miss(data), fit_floor_ceiling(data, floor=False, ceiling=False)
    assert free.log_likelihood == pytest.approx(plain.log_likelihood, abs=1e-7)
    assert size_bound(free, 0.9, 2.706) == pytest.approx(size_bound(plain, 0.9, 2.706), rel=1e-5)
    assert free.deviance == pytest.approx(plain.deviance, abs=1e-6)
    more = fit_floor_ceiling(data)
    assert more.log_likelihood >= plain.log_likelihood - 1e-7


def test_a_ceiling_under_0_9_has_no_a90_and_no_bound():
    curve = fit_floor_ceiling(drawn(2, 0.0, 0.8), floor=False)
    assert curve.ceiling == pytest.approx(0.8, abs=0.03)
    assert size_at(curve, 0.9) is None
    assert size_bound(curve, 0.9, one_sided_drop(0.95)) is None


def test_a_ceiling_that_may_be_under_0_9_gives_an_a90_but_no_bound():
    curve = fit_floor_ceiling(drawn(7, 0.0, 0.915, 200), floor=False)
    assert curve.ceiling > 0.9
    assert size_at(curve, 0.9) is not None
    assert size_bound(curve, 0.9, one_sided_drop(0.95)) is None


def test_calls_at_blank_places_hold_the_floor_down():
    data = drawn(4, 0.15, 1.0, 300)
    quiet = HitMiss(data.size, data.hit, data.weight, 1000.0, 10.0)
    assert fit_floor_ceiling(quiet, ceiling=False).floor < fit_floor_ceiling(data, ceiling=False).floor
    assert fit_floor_ceiling(quiet, ceiling=False).floor == pytest.approx(0.02, abs=0.02)


def test_a_step_is_named():
    rng = np.random.default_rng(5)
    size = np.sort(rng.uniform(1, 9, 200))
    hit = (size > 5) & (rng.random(200) < 0.9)
    found = fit_floor_ceiling(HitMiss(size, hit, np.ones(200)), floor=False)
    assert isinstance(found, NoCurve)
    assert found.outcome == "a step"


def test_separated_looks_have_no_curve_here_either():
    found = fit_floor_ceiling(HitMiss(np.arange(1.0, 7.0), np.arange(6) > 2, np.ones(6)))
    assert found.outcome == "separated"


def test_the_bound_does_not_depend_on_the_way_to_it():
    """The profile through a size falls on and on as the size moves away."""
    curve = fit_floor_ceiling(drawn(6, 0.05, 0.97, 800))
    place = curve.place(0.9)
    values = [curve.log_likelihood_through(place + step, 0.9) for step in (0, 0.1, 0.2, 0.4, 0.8)]
    assert values[0] == pytest.approx(curve.log_likelihood, abs=1e-6)
    assert values == sorted(values, reverse=True)
