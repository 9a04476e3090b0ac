"""Exact bounds, coverage, classes and the trade's statements."""

from __future__ import annotations

import json

import numpy as np
import pytest
from scipy.stats import binom, poisson

from algorithms.trust.coverage import coverage_of, effective_cases, right_median_ratio, statement
from algorithms.trust.exact_bounds import hits_needed, rate_of, share_lower, share_of, share_upper
from algorithms.trust.feature_class import CLASSES, feature_class, membership, unit_mm
from algorithms.trust.performance import confusion_of, identification_of, unity_of, unity_words


def test_false_calls_as_the_handbook_tabulates_them(shared):
    rows = json.loads((shared / "reference" / "answers.json").read_text())["pod_false_calls"]["rows"]
    for called, n, *printed in rows:
        ours = [share_upper(called, n, confidence) for confidence in (0.5, 0.9, 0.95)]
        assert ours == pytest.approx(printed, abs=1e-4)  # the table cuts off some of its last digits


def test_exact_bounds_are_where_the_tail_is_what_was_asked():
    for count, n in ((0, 10), (3, 10), (10, 10), (29, 1500)):
        if count < n:
            assert binom.cdf(count, n, share_upper(count, n, 0.95)) == pytest.approx(0.05)
        if count:
            assert binom.sf(count - 1, n, share_lower(count, n, 0.95)) == pytest.approx(0.05)
    assert (share_of(0, 10).low, share_of(10, 10).high) == (0.0, 1.0)
    assert (share_of(0, 0).low, share_of(0, 0).high) == (0.0, 1.0)
    assert hits_needed() == 29
    for count in (0, 3):
        rate = rate_of(count, 1500.0)
        assert poisson.cdf(count, rate.upper_per_m * 1500) == pytest.approx(0.05)
        assert poisson.cdf(count, rate.high_per_m * 1500) == pytest.approx(0.025)
        assert rate.low_per_m <= rate.per_m < rate.upper_per_m < rate.high_per_m
    assert rate_of(0, 1500.0).upper_per_m == pytest.approx(2.9957 / 1500, rel=1e-4)


@pytest.mark.parametrize(
    "call",
    [lambda: share_of(3, 2), lambda: share_upper(-1, 5), lambda: share_upper(1, 5, 1.0), lambda: rate_of(-1, 5.0),
     lambda: rate_of(1, 0.0), lambda: rate_of(1, float("nan")), lambda: rate_of(1, 5.0, 0.0)],
)  # fmt: skip
def test_counts_that_cannot_be_are_refused(call):
    with pytest.raises(ValueError, match=r"no share|confidence|calls cannot|length"):
        call()


# ---- coverage


def intervals(seed, half, n=2000):
    error = np.random.default_rng(seed).normal(0, 1, n)
    return error - half, error + half, np.zeros(n)


def test_intervals_that_are_right_too_narrow_and_too_wide():
    right = coverage_of(*intervals(0, 1.96))
    assert right.verdict == "as stated"
    assert right.held.low <= 0.95 <= right.held.high
    assert right.truth_below + right.truth_above + right.held.counted == right.n
    assert right.median_ratio == pytest.approx(right_median_ratio(), rel=0.05)
    assert coverage_of(*intervals(0, 1.6)).verdict == "narrower than stated"
    assert coverage_of(*intervals(0, 2.5)).verdict == "wider than stated"
    assert "too few" in coverage_of(*intervals(0, 1.96, 20)).verdict
    assert statement(right).startswith("stated 95 % intervals hold the truth in 9")


def test_intervals_that_share_a_scans_error_count_for_less():
    rng = np.random.default_rng(3)
    scan = np.repeat(np.arange(40), 50)
    error = np.repeat(rng.normal(0, 1, 40), 50)
    together = coverage_of(error - 1.6, error + 1.6, np.zeros(2000), scan=scan)
    assert together.cases == pytest.approx(40, rel=0.1)
    assert together.held.high - together.held.low > 0.1
    apart = intervals(1, 1.96)
    assert effective_cases(np.abs(apart[0] + 1.96) <= 1.96, scan) > 1000
    assert "worth 4" in statement(together) or "worth 3" in statement(together)


def test_intervals_that_are_missing_are_counted_and_bad_ones_refused():
    low, high, truth = intervals(0, 1.96, 100)
    low[:10] = np.nan
    found = coverage_of(low, high, truth)
    assert (found.n, found.missing) == (90, 10)
    assert "10 more stated no interval" in statement(found)
    one_sided = coverage_of(np.zeros(50), np.full(50, np.inf), np.ones(50))  # at least so deep
    assert one_sided.held.share == 1.0
    for low, high, truth, match in (
        (np.zeros(0), np.zeros(0), np.zeros(0), "none states"),
        (np.full(3, np.nan), np.zeros(3), np.zeros(3), "none states"),
        (np.ones(3), np.zeros(3), np.zeros(3), "before it begins"),
        (np.zeros(3), np.ones(3), np.full(3, np.nan), "truth"),
    ):
        with pytest.raises(ValueError, match=match):
            coverage_of(low, high, truth)


# ---- classes


def test_the_classes_part_a_million_sizes():
    rng = np.random.default_rng(0)
    length, width = np.exp(rng.uniform(np.log(0.1), np.log(500), (2, 1_000_000)))
    wall = 13.8
    edges = wall * np.array([0.5, 1, 1.5, 2, 3, 6, 12])
    length[:200_000], width[:200_000] = rng.choice(edges, 200_000), rng.choice(edges, 200_000)  # on the borders
    inside = membership(length, width, wall)
    assert np.all(inside.sum(axis=0) == 1)
    assert set(feature_class(length, width, wall)) == set(range(len(CLASSES)))


@pytest.mark.parametrize(
    ("length", "width", "name"),
    [
        (30, 30, "general"),
        (70, 35, "general"),
        (20, 20, "pitting"),
        (59, 29.9, "pitting"),
        (60, 25, "axial grooving"),
        (20, 10, "axial grooving"),
        (10, 20, "circumferential grooving"),
        (5, 5, "pinhole"),
        (10, 9.9, "axial slotting"),
        (9.9, 40, "circumferential slotting"),
    ],
)
def test_sizes_have_the_forums_class(length, width, name):
    found = feature_class(np.array([length], float), np.array([width], float), wall_mm=7.1)
    assert CLASSES[found[0]] == name


def test_turning_a_feature_swaps_axial_and_circumferential():
    rng = np.random.default_rng(1)
    length, width = rng.uniform(0.1, 100, (2, 10_000))
    swapped = {"axial grooving": "circumferential grooving", "axial slotting": "circumferential slotting"}
    swapped |= {other: name for name, other in swapped.items()}
    one, other = feature_class(length, width, 12.0), feature_class(width, length, 12.0)
    assert all(swapped.get(CLASSES[a], CLASSES[a]) == CLASSES[b] for a, b in zip(one, other, strict=True))


def test_the_unit_is_the_wall_or_10_mm_and_sizes_must_be_sizes():
    assert (unit_mm(5.0), unit_mm(13.8)) == (10.0, 13.8)
    for bad in (0.0, -1.0, np.nan):
        with pytest.raises(ValueError, match="greater than 0"):
            unit_mm(bad)
        with pytest.raises(ValueError, match="length"):
            feature_class(np.array([bad]), np.array([5.0]), 10.0)


# ---- the trade's statements


def test_verdicts_at_a_certainty():
    true = np.linspace(1, 9, 200)
    away = np.full(200, 0.5)
    away[:10] = 2.0  # of a wall of 10 mm: 190 of 200 inside 10 %
    unity = unity_of(true + away, true, 10.0)
    assert (unity.inside.counted, unity.n) == (190, 200)
    assert [c.verdict for c in unity.certainties] == ["shown", "shown"]
    away[:30] = 2.0  # 85 %
    assert [c.verdict for c in unity_of(true + away, true, 10.0).certainties] == ["shown", "refuted"]
    few = unity_of(true[:12] + 0.5, true[:12], 10.0)
    assert [c.verdict for c in few.certainties] == ["not shown", "not shown"]
    assert few.certainties[1].tolerance_upper_pct is None
    lines = unity_words(unity)
    assert lines[0].startswith("190 of 200 within +-10 % of the wall: 95.0 %")
    assert len(lines) == 3


def test_the_tools_own_tolerance_is_a_bound_of_the_quantile():
    rng, above = np.random.default_rng(0), 0
    for _ in range(300):
        error = rng.normal(0, 1, 80)
        unity = unity_of(5 + error, np.full(80, 5.0), 100.0)
        above += unity.certainties[0].tolerance_upper_pct >= 1.2816  # 80 % of a normal error
    assert above / 300 > 0.92


def test_sizes_that_cannot_be_judged_are_refused():
    for measured, true, wall, match in (
        (np.zeros(0), np.zeros(0), 10.0, "no sizes"),
        (np.array([np.nan]), np.ones(1), 10.0, "finite"),
        (np.ones(1), np.ones(1), 0.0, "wall"),
    ):
        with pytest.raises(ValueError, match=match):
            unity_of(measured, true, wall)
    one = unity_of(np.ones(1), np.ones(1), 10.0)
    assert np.isnan(one.standard_deviation_pct)


def test_confusion_and_identification():
    confusion = confusion_of(["pinhole", "general", "general"], ["pinhole", "pitting", "general"], CLASSES)
    assert confusion.counts.sum() == 3
    assert confusion.counts[CLASSES.index("general"), CLASSES.index("pitting")] == 1
    assert confusion.right.counted == 2
    with pytest.raises(ValueError, match="no class hole"):
        confusion_of(["hole"], ["general"], CLASSES)
    with pytest.raises(ValueError, match="2 true classes and 1"):
        confusion_of(["general"] * 2, ["general"], CLASSES)
    found = identification_of(np.array([True, True, False]), np.array([True, False, True]))
    assert (found.detected.counted, found.detected.n) == (2, 3)
    assert (found.identified.counted, found.identified.n) == (1, 2)
