"""Curves from hits and misses: the handbook's printed answers, known truths found again, and named outcomes."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from algorithms.trust.curve import HANDBOOK_DROP, SCALES, NoCurve, one_sided_drop, size_at, size_bound
from algorithms.trust.exact_bounds import run_of_hits_bound
from algorithms.trust.hit_miss import HitMiss, fit_hit_miss, log_likelihood
from algorithms.trust.links import LINKS
from algorithms.trust.repeats import Dispersion, dispersed_drop, dispersion, look_weights, pooled

MU = np.log(4)
PRINTED_SE = 2e-4  # the handbook's standard errors come from one step before the last


def table(shared, name):
    with (shared / "reference" / "pod" / name).open(encoding="utf-8-sig") as file:
        return list(csv.reader(file))[1:]


@pytest.fixture(scope="module")
def answers(shared):
    return json.loads((shared / "reference" / "answers.json").read_text())


@pytest.fixture(scope="module")
def example3(shared):
    rows = table(shared, "example3_hitmiss.csv")
    size, hit = np.array([float(row[1]) for row in rows]), np.array([row[3] == "1" for row in rows])
    return HitMiss(size, hit, np.ones(size.size))


def drawn(seed, n=400, mu=MU, sigma=0.3, link="logit"):
    """Looks at random sizes with a known curve on log size."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(0.5, 12, n)
    hit = rng.random(n) < LINKS[link].cdf((np.log(size) - mu) / sigma)
    return HitMiss(size, hit, np.ones(n))


def test_example_3_of_the_handbook(answers, example3):
    said = answers["pod"]["EX3"]
    curve = fit_hit_miss(example3, "logit", "linear")
    assert curve.intercept == pytest.approx(said["b0"], abs=5e-5)
    assert curve.slope == pytest.approx(said["b1"], abs=5e-4)
    errors = np.sqrt(np.diag(curve.covariance))
    assert errors == pytest.approx([said["se_b0"], said["se_b1"]], rel=PRINTED_SE)
    assert curve.covariance == pytest.approx(np.array(said["cov"]), rel=2 * PRINTED_SE)
    assert size_at(curve, 0.5) == pytest.approx(said["a50"], abs=5e-5)
    assert size_at(curve, 0.9) == pytest.approx(said["a90"], abs=5e-5)
    assert size_bound(curve, 0.9, HANDBOOK_DROP) == pytest.approx(said["a90_95"], abs=5e-5)
    on_log = fit_hit_miss(example3, "logit", "log")
    assert size_bound(on_log, 0.9, HANDBOOK_DROP) == pytest.approx(said["a90_95_loglink"], abs=5e-5)


def test_example_5_of_the_handbook_three_probes_a_target(answers, shared):
    said, rows = answers["pod"]["EX5"], table(shared, "example5_hitmiss_repeated.csv")
    size = np.array([float(row[1]) for row in rows for _ in range(3)])
    hit = np.array([row[column] == "1" for row in rows for column in (3, 7, 11)])
    target = np.repeat(np.arange(len(rows)), 3)
    assert (hit.size, hit.sum()) == (said["n"], said["hits"])
    curve = fit_hit_miss(pooled(size, hit, target), "logit", "log")
    assert curve.mu == pytest.approx(said["mu"], abs=5e-4)
    assert curve.sigma == pytest.approx(said["sigma"], abs=5e-6)
    assert size_at(curve, 0.5) == pytest.approx(said["a50"], abs=5e-6)
    assert size_at(curve, 0.9) == pytest.approx(said["a90"], abs=5e-5)
    assert size_bound(curve, 0.9, HANDBOOK_DROP) == pytest.approx(said["a90_95"], abs=5e-5)


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("scale", SCALES)
def test_every_link_gives_probabilities_back(link, scale, example3):
    F = LINKS[link]
    p = np.array([1e-9, 0.01, 0.5, 0.9, 1 - 1e-9])
    e = F.quantile(p)
    assert F.cdf(e) == pytest.approx(p)
    assert np.exp(F.log_cdf(e)) + np.exp(F.log_sf(e)) == pytest.approx(np.ones(5))
    step = 1e-6
    assert np.exp(F.log_pdf(e)) == pytest.approx((F.cdf(e + step) - F.cdf(e - step)) / (2 * step), rel=1e-5, abs=1e-9)
    curve = fit_hit_miss(example3, link, scale)
    x = np.log(example3.size) if scale == "log" else example3.size

    def value(intercept, slope):
        return log_likelihood(F, intercept + slope * x, example3)

    best = value(curve.intercept, curve.slope)
    for there in (0.999, 1.001):  # no better place on any side
        assert value(curve.intercept * there, curve.slope) < best
        assert value(curve.intercept, curve.slope * there) < best


def test_a_known_curve_is_found_again_by_each_link():
    for link in LINKS:
        curve = fit_hit_miss(drawn(1, 20_000, link=link), link)
        assert curve.mu == pytest.approx(np.log(4), abs=0.02)
        assert curve.sigma == pytest.approx(0.3, rel=0.05)


def test_the_bound_is_where_the_likelihood_has_fallen_so_far_over_a_grid(example3):
    """Against plain numbers: the region scanned over intercept and slope."""
    curve = fit_hit_miss(example3, "logit", "linear")
    drop = one_sided_drop(0.95)
    assert drop == pytest.approx(2.7055, abs=1e-4)
    slopes = np.linspace(15, 60, 120)
    a90 = np.linspace(0.15, 0.22, 141)
    level = LINKS["logit"].quantile(0.9)
    inside = [
        place
        for place in a90
        if max(
            log_likelihood(LINKS["logit"], level + slope * (example3.size - place), example3) for slope in slopes
        ) >= curve.log_likelihood - drop / 2
    ]  # fmt: skip
    assert size_bound(curve, 0.9, drop) == pytest.approx(max(inside), abs=5e-4)
    assert size_bound(curve, 0.9, drop, "lower") == pytest.approx(min(inside), abs=5e-4)


def test_the_one_sided_bound_holds_a90_about_as_often_as_it_says():
    true_a90 = 4 * np.exp(0.3 * LINKS["logit"].quantile(0.9))
    held = 0
    for seed in range(120):
        curve = fit_hit_miss(drawn(seed, 120))
        held += not isinstance(curve, NoCurve) and (size_bound(curve, 0.9, one_sided_drop(0.95)) or 99) >= true_a90
    assert 107 <= held <= 120  # 114 expected, standard deviation 2.4


def of(size, hit):
    return HitMiss(np.array(size, dtype=float), np.array(hit, dtype=bool), np.ones(len(size)))


@pytest.mark.parametrize(
    ("size", "hit", "outcome"),
    [
        ([], [], "too few sizes"),
        ([1], [1], "too few sizes"),
        ([1, 1, 2, 2], [0, 1, 0, 1], "too few sizes"),
        ([1, 2, 3, 4], [1, 1, 1, 1], "all hits"),
        ([1, 2, 3, 4], [0, 0, 0, 0], "all misses"),
        ([1, 2, 3, 4], [0, 0, 1, 1], "separated"),
        ([1, 2, 2, 3], [0, 0, 1, 1], "separated"),
        ([1, 2, 3, 4], [1, 1, 0, 0], "no rise"),
        ([1, 2, 3, 4, 5, 6], [1, 1, 0, 1, 0, 0], "no rise"),
    ],
)
def test_what_has_no_curve_says_why(size, hit, outcome):
    found = fit_hit_miss(of(size, hit))
    assert isinstance(found, NoCurve)
    assert not found
    assert found.outcome == outcome
    assert found.reason


def test_separation_names_the_sizes_and_no_slope():
    found = fit_hit_miss(of([1, 2, 3, 4, 5], [0, 0, 0, 1, 1]))
    assert "3 or below" in found.reason
    assert "4 or above" in found.reason


@pytest.mark.parametrize("size", [[1, -2, 3], [1, 0, 3], [1, np.nan, 3], [1, np.inf, 3]])
def test_sizes_that_cannot_be_are_refused(size):
    with pytest.raises(ValueError, match="finite and greater than 0"):
        of(size, [0, 1, 1])


def test_where_the_slope_may_be_nothing_there_is_no_bound():
    """Hits that hardly grow with size: the region holds flat curves, which reach 0.9 at no size."""
    curve = fit_hit_miss(of([1, 2, 3, 4, 5, 6, 7, 8], [0, 1, 0, 1, 0, 1, 1, 0]))
    assert curve.slope > 0
    assert size_bound(curve, 0.9, one_sided_drop(0.95)) is None


def test_a_bound_grows_with_confidence_and_falls_with_looks():
    few, many = fit_hit_miss(drawn(3, 150)), fit_hit_miss(drawn(3, 3000))
    bounds = [size_bound(few, 0.9, one_sided_drop(c)) for c in (0.8, 0.9, 0.95, 0.99)]
    assert bounds == sorted(bounds)
    assert bounds[0] > size_at(few, 0.9)
    assert size_bound(many, 0.9, 2.706) - size_at(many, 0.9) < size_bound(few, 0.9, 2.706) - size_at(few, 0.9)


def test_units_do_not_matter(example3):
    inches = fit_hit_miss(example3)
    mm = fit_hit_miss(HitMiss(example3.size * 25.4, example3.hit, example3.weight))
    assert size_at(mm, 0.9) == pytest.approx(25.4 * size_at(inches, 0.9), rel=1e-9)
    assert size_bound(mm, 0.9, 2.706) == pytest.approx(25.4 * size_bound(inches, 0.9, 2.706), rel=1e-7)


def test_looks_counted_once_a_target_are_the_deviance_over_their_number():
    data = drawn(5, 200)
    target = np.arange(200)
    thrice = pooled(np.tile(data.size, 3), np.tile(data.hit, 3), np.tile(target, 3))
    once = pooled(data.size, data.hit, target)
    assert size_bound(fit_hit_miss(thrice), 0.9, 3.841) == pytest.approx(size_bound(fit_hit_miss(once), 0.9, 3.841))
    assert look_weights(np.array([0, 0, 1])) == pytest.approx([0.5, 0.5, 1.0])  # unequal numbers of looks


def test_dispersion_tells_repeats_that_only_repeat_from_independent_ones():
    rng = np.random.default_rng(2)
    size, target = np.repeat(rng.uniform(0.5, 12, 600), 3), np.repeat(np.arange(600), 3)
    p = LINKS["logit"].cdf((np.log(size) - np.log(4)) / 0.3)
    same = np.repeat(rng.random(600), 3) < p
    free = rng.random(1800) < p
    curve = fit_hit_miss(pooled(size, free, target, "independent"))
    found = dispersion(curve, size, free, target)
    assert found.factor == pytest.approx(1.0, abs=0.25)
    assert dispersed_drop(0.95, Dispersion(1.0, 10**7)) == pytest.approx(one_sided_drop(0.95), rel=1e-5)
    curve = fit_hit_miss(pooled(size, same, target, "independent"))
    assert dispersion(curve, size, same, target).factor == pytest.approx(3.0, abs=0.4)
    assert dispersion(curve, size[::3], same[::3], target[::3]) is None


def test_a_run_of_29_hits_bounds_a90_without_a_curve():
    size, hit = np.arange(1.0, 41.0), np.arange(40) >= 11
    assert run_of_hits_bound(size, hit) == 40.0
    assert run_of_hits_bound(size[:-1], hit[:-1]) is None
    assert run_of_hits_bound(size[-30:], hit[-30:]) == 40.0
