"""The decoder finds slits to a fraction of a pixel, names them right, and keeps shadows and noise out."""

from __future__ import annotations

import numpy as np
import pytest

from algorithms import decode as d
from algorithms.triangulate import triangulate
from scenarios.score import true_slits
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.raycast import draw
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

RIG = preset_rig()
POCKET = {"kind": "pocket", "distance_mm": 120, "clock_deg": 120, "length_mm": 70, "width_mm": 35, "depth_mm": 7.5}
CLEAN = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
CARVED = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=[POCKET])
POSE = np.eye(4)
POSE[:3, 3] = 4, -3, 0


def _picture(pipe, optics):
    return expose(draw(pipe, POSE, RIG, optics), optics, np.random.default_rng(0), RIG.camera)


@pytest.fixture(scope="module")
def noisy():
    return _picture(CARVED, Optics())


def _radial_error(seen, pipe):
    points = triangulate(seen, RIG)
    wall = points.xyz_mm @ POSE[:3, :3].T + POSE[:3, 3]
    theta = np.arctan2(wall[:, 0], -wall[:, 1])
    return points, np.hypot(wall[:, 0], wall[:, 1]) - pipe.radius(theta, wall[:, 2])


def test_a_clean_picture_gives_the_wall_to_hundredths_of_a_millimetre():
    optics = Optics.ideal()
    seen = d.decode(_picture(CLEAN, optics), RIG, d.DecodeSettings())
    points, error = _radial_error(seen, CLEAN)
    assert set(points.ring) == set(range(8))
    for ring in range(8):
        assert abs(error[points.ring == ring].mean()) < 0.02
    strut = 37 / 360
    assert points.sigma_mm.size > 0.97 * 720 * 8 * (1 - strut)


def test_fading_light_does_not_move_the_slits():
    optics = Optics(slide_jag_deg=0.0).noiseless()
    seen = d.decode(_picture(CLEAN, optics), RIG, d.DecodeSettings())
    points, error = _radial_error(seen, CLEAN)
    for ring in range(8):
        assert abs(error[points.ring == ring].mean()) < 0.06


def test_words_are_right_past_a_deep_pocket(noisy):
    seen = d.decode(noisy, RIG, d.DecodeSettings())
    assert np.mean(true_slits(CARVED, RIG, seen.pixel, POSE) != seen.slit) < 0.005
    assert np.array_equal(np.unique(seen.slit), np.arange(8))
    outside = np.abs((np.degrees(np.arctan2(seen.pixel[:, 0] - 817.866, 609.376 - seen.pixel[:, 1])) + 180) % 360 - 180)
    assert (outside > 15).all()  # nothing in the strut's sector


def test_compiled_resampling_agrees_with_a_library(noisy):
    import cv2

    ours = d.polar_lines(noisy, RIG, 90)
    first, last = d.radial_range_px(RIG)
    along = d.directions(90)[:, None, :] * np.arange(first, last)[None, :, None]
    x, y = (RIG.camera.cx_px + along[..., 0]).astype(np.float32), (RIG.camera.cy_px + along[..., 1]).astype(np.float32)
    theirs = cv2.remap(noisy, x, y, cv2.INTER_LINEAR).astype(float)
    inside = np.isfinite(ours[..., 0])
    assert inside.mean() > 0.6
    # the library rounds places to 1/32 px and values to whole numbers
    assert np.abs(ours - theirs)[inside].mean() < 1.0


def test_matching_by_colour_agrees_with_trying_everything():
    from itertools import combinations

    rng = np.random.default_rng(0)
    pairs = np.array([[d.COLORS.index(c) for c in slit.name] for slit in RIG.projector.slits])
    for _ in range(20):
        n = int(rng.integers(1, 5))
        scores = -rng.uniform(0, 6, size=(2, 1, n, 3))
        found = d._name(np.array([n]), scores[0], scores[1], pairs)[0]

        def total(dips, slits, scores=scores, n=n):
            taken = sum(
                scores[0, 0, i, pairs[j, 0]] + scores[1, 0, i, pairs[j, 1]] for i, j in zip(dips, slits, strict=True)
            )
            return taken + d.SPARE_DIP * (n - len(dips)) + d.SKIPPED_SLIT * (8 - len(slits))

        best = max(
            total(dips, slits)
            for k in range(n + 1)
            for dips in combinations(range(n), k)
            for slits in combinations(range(8), k)
        )
        chosen = np.flatnonzero(found >= 0)
        assert total(tuple(chosen), tuple(found[chosen])) == pytest.approx(best)


@pytest.mark.parametrize("kind", ["black", "white", "noise"])
def test_a_picture_without_rings_gives_no_points(kind):
    shape = (RIG.camera.height_px, RIG.camera.width_px, 3)
    picture = {
        "black": np.zeros(shape, np.uint8),
        "white": np.full(shape, 255, np.uint8),
        "noise": np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8),
    }[kind]
    seen = d.decode(picture, RIG, d.DecodeSettings())
    assert seen.slit.size < 0.02 * 720 * 8
