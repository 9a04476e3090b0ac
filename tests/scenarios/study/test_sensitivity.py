"""Sobol's indices: of a function whose are known, of a seed as a cause, and what a study must be like to have them."""

from __future__ import annotations

import csv
import json
from math import pi

import numpy as np
import pytest
from scipy.stats import sobol_indices, uniform

from scenarios.document import BadInput
from scenarios.study.conduct import MAKE, How
from scenarios.study.sensitivity import sensitivity, shares

FACTORS = ("drive.offset_mm.0", "drive.offset_mm.1", "drive.tilt_deg.0")
ISHIGAMI = """\
name: ishigami
base: paper-gantry
set: {sensing.fidelity: points}
factors:
  drive.offset_mm.0: {distribution: uniform, low: -3.141592653589793, high: 3.141592653589793}
  drive.offset_mm.1: {distribution: uniform, low: -3.141592653589793, high: 3.141592653589793}
  drive.tilt_deg.0: {distribution: uniform, low: -3.141592653589793, high: 3.141592653589793}
design: {kind: saltelli, points: 128, draw_seed: 1}
record: [center_rms_mm]
"""
# a = 7, b = 0.1; closed form: Ishigami and Homma 1990
VARIANCE = 49 / 8 + 0.1 * pi**4 / 5 + 0.01 * pi**8 / 18 + 0.5
FIRST = [0.5 * (1 + 0.1 * pi**4 / 5) ** 2 / VARIANCE, 49 / 8 / VARIANCE, 0.0]
TOGETHER = 0.01 * pi**8 * (1 / 18 - 1 / 50) / VARIANCE
TOTAL = [FIRST[0] + TOGETHER, FIRST[1], TOGETHER]


def analysed(lab, text, make):
    said: list[str] = []
    file = lab.write(text=text)
    folder, found = sensitivity(file, lab.folder / "out", How(2, make=make), lambda *_: None, said.append)
    return folder, found, said


def test_known_indices_are_found(lab):
    folder, found, said = analysed(lab, ISHIGAMI, "standin:ishigami")
    assert said[0] == "128 pairs x (3 causes + 2) = 640 runs at most"
    (one,) = found.scores
    assert found.causes == FACTORS
    assert one.std**2 == pytest.approx(VARIANCE, rel=0.05)
    measured, known = np.vstack([one.first, one.total]), np.array([*FIRST, *TOTAL])
    np.testing.assert_allclose(measured[:, 0], known, atol=0.12)
    assert np.sum((measured[:, 1] <= known) & (known <= measured[:, 2])) >= 5  # of six 95 % intervals
    written = json.loads((folder / "sensitivity.json").read_text())
    assert written["scores"]["center_rms_mm"]["causes"][FACTORS[1]]["total"] == one.total[1].tolist()
    rows = list(csv.reader((folder / "sensitivity.csv").read_text().splitlines()))
    assert [row[1] for row in rows] == ["cause", *FACTORS]
    page = (folder / "sensitivity.html").read_text()
    assert "<img" in page
    assert "drive.tilt_deg.0" in page


def test_estimators_are_scipys():
    rng = np.random.default_rng(3)
    weights = np.array([[3.0], [1.0], [0.2]])
    a, b = rng.random((2, 3, 128))
    mixed = [np.where(np.arange(3)[:, None] == i, b, a) for i in range(3)]
    values = np.stack([(weights * x**2).sum(axis=0) for x in (a, b, *mixed)])
    func = {"f_A": values[0][None], "f_B": values[1][None], "f_AB": values[2:, None]}
    theirs = sobol_indices(func=func, n=128, dists=[uniform()] * 3)
    np.testing.assert_allclose(shares(values), [theirs.first_order, theirs.total_order], rtol=1e-12)


def test_the_seed_can_be_a_cause(lab):
    text = ISHIGAMI.replace(
        "  drive.tilt_deg.0: {distribution: uniform, low: -3.141592653589793, high: 3.141592653589793}",
        "  seed: {low: 0, high: 1000000, whole: true}",
    )
    text = text.replace("points: 128", "points: 16").replace("center_rms_mm", "depth_error_mm_max")
    _, found, _ = analysed(lab, text, "standin:tunable")
    total = dict(zip(found.causes, found.scores[0].total[:, 0], strict=True))
    assert total["seed"] > 0.9  # this stand-in's error is its seed's, but for the last factor, which is the seed
    assert total["drive.offset_mm.0"] == 0


def test_scores_that_do_not_vary_are_named(lab):
    text = ISHIGAMI.replace("128", "16").replace("[center_rms_mm]", "[center_rms_mm, defects_true]")
    _, found, _ = analysed(lab, text, "standin:tunable")
    assert found.left_out["defects_true"] == "does not vary"
    assert "only 0 of 16 pairs" in found.left_out["center_rms_mm"]


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("kind: saltelli", "kind: sobol", "needs `design: {kind: saltelli"),
        ("points: 128", "points: 100", "power of 2"),
        ("record:", "methods: {default: {}, coarse: {map.cell_z_mm: 5}}\nrecord:", "2 methods"),
        ("draw_seed: 1", "seeds: 2", "needs `design: {kind: saltelli"),
    ],
)
def test_what_gives_no_indices_is_refused(lab, old, new, said):
    with pytest.raises(BadInput, match=said):
        analysed(lab, ISHIGAMI.replace(old, new), "standin:ishigami")


def test_a_seed_that_is_a_factor_is_no_replicate_too(lab):
    text = ISHIGAMI.replace("factors:", "factors:\n  seed: [1, 2]").replace("draw_seed: 1", "seeds: 2")
    with pytest.raises(BadInput, match="the seed is a factor already"):
        analysed(lab, text, "standin:ishigami")


DOMINANT = """\
name: dominant
base: paper-gantry
set:
  sensing.fidelity: points
  sensing.points.azimuths: 72
  sensing.frame_rate_hz: 5
  drive.stages: [{to_mm: 30}]
factors:
  sensing.points.pixel_noise_px: {distribution: uniform, low: 0.01, high: 0.02}
  drive.tilt_deg.0: {distribution: uniform, low: 0, high: 0.5}
design: {kind: saltelli, points: 16, draw_seed: 1}
record: [normal_variance]
"""


def test_a_scan_s_one_dominant_cause_is_found(lab):
    """Real scans: the tilt decides how the planes of the rings lean, a hundredth of a pixel does not."""
    _, found, said = analysed(lab, DOMINANT, MAKE)
    assert said[0] == "16 pairs x (2 causes + 2) = 64 runs at most"
    (one,) = found.scores
    noise, tilt = range(2)
    for index in (one.first, one.total):
        assert index[tilt, 1] <= 1 <= index[tilt, 2]
        assert index[noise, 1] <= 0.05
    assert one.total[tilt, 1] > 0.5 > one.total[noise, 2]
