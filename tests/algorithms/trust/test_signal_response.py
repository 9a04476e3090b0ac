"""Curves from signals: the handbook's printed answers, censoring, noise, and named outcomes."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.stats import norm

from algorithms.trust.curve import NoCurve, one_sided_drop, size_at, size_bound
from algorithms.trust.detection import a90_95, handbook_signal_bound
from algorithms.trust.noise import LAWS, fit_noise
from algorithms.trust.signal_checks import check_signals
from algorithms.trust.signal_response import Signals, fit_signals


@pytest.fixture(scope="module")
def said(shared):
    return json.loads((shared / "reference" / "answers.json").read_text())["pod"]["EX1"]


@pytest.fixture(scope="module")
def example1(shared):
    with (shared / "reference" / "pod" / "example1_ahat.csv").open(encoding="utf-8-sig") as file:
        rows = list(csv.reader(file))[1:]
    size, signal = np.array([float(row[1]) for row in rows]), np.array([float(row[2]) for row in rows])
    return Signals(size, signal, signal <= 50, signal >= 1375, np.ones(size.size))


def drawn(seed, n=200, left=-np.inf, right=np.inf):
    """Signal = 1 + 2 ln a + 0.8 e, known only within limits."""
    rng = np.random.default_rng(seed)
    size = rng.uniform(1, 10, n)
    signal = 1 + 2 * np.log(size) + 0.8 * rng.standard_normal(n)
    return Signals(size, np.clip(signal, left, right), signal <= left, signal >= right, np.ones(n))


def test_example_1_of_the_handbook(said, example1):
    curve = fit_signals(example1, 200.0)
    assert curve.mu == pytest.approx(said["mu"], abs=5e-4)
    assert curve.sigma == pytest.approx(said["sigma"], abs=5e-6)
    assert curve.place_covariance == pytest.approx(np.array(said["cov"]), abs=6e-7)
    assert size_at(curve, 0.5) == pytest.approx(said["a50"], abs=5e-3)
    assert size_at(curve, 0.9) == pytest.approx(said["a90"], abs=5e-3)
    assert handbook_signal_bound(curve) == pytest.approx(said["a90_95"], abs=5e-3)
    ours = [bound.size for bound in a90_95(curve)]
    assert said["a90_95"] < ours[0] < ours[1]  # the likelihood's bound is the wider


def test_the_handbooks_noise(said, example1):
    quiet = example1.size <= 8.5
    noise = fit_noise(example1.signal[quiet], example1.below[quiet])
    assert noise.n == said["noise"]["n"]
    assert noise.mean == pytest.approx(said["noise"]["mu"], abs=0.05)
    assert noise.standard_deviation == pytest.approx(said["noise"]["sigma_mle"], abs=5e-3)
    for share, name in ((0.9, "q90"), (0.95, "q95"), (0.99, "q99"), (0.999, "q999")):
        assert noise.quantile(share) == pytest.approx(said["noise"][name], abs=0.05)
    assert noise.call_probability(200.0) == pytest.approx(said["noise"]["pfp"], abs=5e-3)


def test_a_known_line_is_found_again_through_both_limits():
    curve = fit_signals(drawn(0, 20_000, left=2.0, right=5.0), 3.0)
    assert (curve.intercept, curve.slope, curve.tau) == pytest.approx((1.0, 2.0, 0.8), abs=0.03)
    assert size_at(curve, 0.5) == pytest.approx(np.e, rel=0.01)


def test_the_bound_against_a_plain_search():
    data = drawn(1, 60, left=2.5, right=4.5)
    curve = fit_signals(data, 3.0)
    x = np.log(data.size)

    def down(of, place):
        tau, slope = np.exp(of[0]), of[1]
        line = 3.0 + norm.ppf(0.9) * tau + slope * (x - place)
        z = (data.signal - line) / tau
        exact = norm.logpdf(z) - np.log(tau)
        return -np.sum(np.where(data.below, norm.logcdf(z), np.where(data.above, norm.logsf(z), exact)))

    bound = size_bound(curve, 0.9, one_sided_drop(0.95))
    there = minimize(down, [np.log(0.8), 2.0], args=(np.log(bound),), method="Nelder-Mead", options={"fatol": 1e-10})
    assert 2 * (curve.log_likelihood + there.fun) == pytest.approx(one_sided_drop(0.95), abs=1e-4)


def test_the_one_sided_bound_holds_a90_about_as_often_as_it_says():
    true_a90 = np.exp(1 + 0.4 * norm.ppf(0.9))
    held = sum(
        size_bound(fit_signals(drawn(seed, 50, left=2.0), 3.0), 0.9, one_sided_drop(0.95)) >= true_a90
        for seed in range(120)
    )
    assert 105 <= held <= 120


def test_each_scale_can_be_logarithmic():
    rng = np.random.default_rng(4)
    size = rng.uniform(1, 10, 400)
    signal = np.exp(0.5 + 0.3 * size + 0.2 * rng.standard_normal(400))
    data = Signals(size, signal, np.zeros(400, bool), np.zeros(400, bool), np.ones(400))
    curve = fit_signals(data, 5.0, "linear", "log")
    assert (curve.intercept, curve.slope, curve.tau) == pytest.approx((0.5, 0.3, 0.2), abs=0.03)
    with pytest.raises(ValueError, match="greater than 0"):
        fit_signals(data, 0.0, "linear", "log")


def test_what_has_no_curve_says_why():
    nothing, ones = np.zeros(6, bool), np.ones(6)
    size = np.arange(1.0, 7.0)
    falling = fit_signals(Signals(size, np.array([6.0, 4.8, 4.1, 3.3, 2, 1.1]), nothing, nothing, ones), 3.0)
    assert isinstance(falling, NoCurve)
    assert falling.outcome == "no rise"
    assert fit_signals(Signals(size, 2 * np.log(size), nothing, nothing, ones), 1.0).outcome == "no spread"
    unseen = Signals(size, np.full(6, 5.0), ~nothing, nothing, ones)
    assert fit_signals(unseen, 6.0).outcome == "too few sizes"
    none = Signals(np.zeros(0), np.zeros(0), np.zeros(0, bool), np.zeros(0, bool), np.zeros(0))
    assert fit_signals(none, 6.0).outcome == "too few sizes"


@pytest.mark.parametrize(
    ("size", "signal", "match"),
    [([1, -1], [1, 2], "sizes"), ([1, np.nan], [1, 2], "sizes"), ([1, 2], [1, np.nan], "signals")],
)
def test_numbers_that_cannot_be_are_refused(size, signal, match):
    with pytest.raises(ValueError, match=match):
        Signals(np.array(size, float), np.array(signal, float), np.zeros(2, bool), np.zeros(2, bool), np.ones(2))


def test_checks_see_a_bend_a_growing_scatter_and_a_heavy_tail(example1):
    straight = check_signals(fit_signals(drawn(8), 3.0))
    assert min(straight) > 0.05
    assert straight.doubts() == []
    assert check_signals(fit_signals(example1, 200.0)).straight < 0.05
    data, rng = drawn(8), np.random.default_rng(0)
    for name, signal in (
        ("straight", data.signal + 2 * np.log(data.size) ** 2),
        ("one_spread", 1 + 2 * np.log(data.size) + data.size * rng.standard_normal(200)),
        ("normal", 1 + 2 * np.log(data.size) + rng.standard_t(2, 200)),
    ):
        found = check_signals(fit_signals(Signals(data.size, signal, data.below, data.above, data.weight), 3.0))
        assert getattr(found, name) < 0.05


def test_noise_laws_give_themselves_back_and_refuse_what_they_cannot_fit():
    rng = np.random.default_rng(3)
    drawn_from = {
        "normal": rng.normal(5, 2, 4000),
        "lognormal": np.exp(rng.normal(1, 0.3, 4000)),
        "exponential": rng.exponential(3.0, 4000),
        "weibull": 3 * rng.weibull(2.0, 4000),
    }
    assert set(drawn_from) == set(LAWS)
    for law, signal in drawn_from.items():
        below = signal <= np.quantile(signal, 0.2)
        limit = signal[below].max()
        noise = fit_noise(np.where(below, limit, signal), below, law)
        assert noise.quantile(0.95) == pytest.approx(np.quantile(signal, 0.95), rel=0.05)
    with pytest.raises(ValueError, match="at least 3"):
        fit_noise(np.array([1.0, 2.0]), np.zeros(2, bool))
    with pytest.raises(ValueError, match="do not differ"):
        fit_noise(np.ones(5), np.zeros(5, bool))
    with pytest.raises(ValueError, match="greater than 0"):
        fit_noise(np.array([-1.0, 2.0, 3.0]), np.zeros(3, bool), "weibull")
