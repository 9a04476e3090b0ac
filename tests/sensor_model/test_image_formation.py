"""From light to the stored picture: every effect alone, and all of them off."""

from __future__ import annotations

import numpy as np
import pytest

from sensor_model.focus import nearness_per_mm
from sensor_model.image_formation import _finish, _ring_exchange, expose
from sensor_model.optics import Optics
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

SMALL = {"width_px": 416, "height_px": 308, "fx_px": 147.2, "fy_px": 147.1, "skew_px": 0.17}
CAMERA = preset_rig().camera.model_copy(update={**SMALL, "cx_px": 204.1, "cy_px": 152.0})


def rings(level: float = 0.61) -> np.ndarray:
    """Bright rings with dark slits between them on a dark ground."""
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    radius = np.hypot(u - CAMERA.cx_px, v - CAMERA.cy_px)
    lit = (radius > 60) & (radius < 140) & (np.mod(radius, 16) > 3)
    return (lit[..., None] * np.array([1.0, 0.5, 0.25]) * level).astype(np.float32)


def ideal(**change: float) -> Optics:
    return Optics.ideal().model_copy(update=change)


def test_everything_off_stores_the_light_as_it_is() -> None:
    stored = expose(rings(), Optics.ideal(), np.random.default_rng(0), CAMERA)
    np.testing.assert_array_equal(stored, np.rint(np.clip(rings(), 0, 1) * 255))


def test_without_noise_the_generator_is_left_alone() -> None:
    rng = np.random.default_rng(3)
    first = expose(rings(), Optics().noiseless(), rng, CAMERA)
    assert rng.integers(1 << 30) == np.random.default_rng(3).integers(1 << 30)
    np.testing.assert_array_equal(first, expose(rings(), Optics().noiseless(), np.random.default_rng(9), CAMERA))


def test_the_same_generator_gives_the_same_bytes() -> None:
    a, b, c = (expose(rings(), Optics(), np.random.default_rng(seed), CAMERA).tobytes() for seed in (5, 5, 6))
    assert a == b
    assert a != c


def test_noise_has_the_stated_size() -> None:
    light = np.full((308, 416, 3), 0.36, dtype=np.float32)
    shot = expose(light, ideal(shot_noise=0.05), np.random.default_rng(0), CAMERA) / 255
    read = expose(light, ideal(read_noise=0.02), np.random.default_rng(0), CAMERA) / 255
    assert shot.std() == pytest.approx(0.05 * 0.6, rel=0.02)
    assert read.std() == pytest.approx(0.02, rel=0.02)


def test_inter_reflection_lifts_dark_slits_to_a_share_of_the_lit_level() -> None:
    """About 15 % in the light itself for the default wall, and more in the brightest channel than in the others."""
    optics = Optics()
    off = {"haze": 0.0, "color_bleed": 0.0, "defocus_px": 0.0, "gamma": 1.0, "exposure": 1.0}
    stored = expose(rings(), optics.noiseless().model_copy(update=off), np.random.default_rng(0), CAMERA) / 255
    lit, dark = rings()[..., 0] > 0, (rings()[..., 0] == 0) & ring_zone()
    share = stored[dark].mean(axis=0) / stored[lit].mean(axis=0)
    assert 0.1 < share[0] < 0.2
    assert stored[dark][:, 0].mean() > stored[dark][:, 2].mean()


def ring_zone() -> np.ndarray:
    v, u = np.mgrid[: CAMERA.height_px, : CAMERA.width_px]
    radius = np.hypot(u - CAMERA.cx_px, v - CAMERA.cy_px)
    return (radius > 64) & (radius < 136)


def test_what_leaves_a_ring_of_wall_arrives_somewhere() -> None:
    passed = _ring_exchange()
    np.testing.assert_allclose(passed, passed.T)
    assert passed[passed.shape[0] // 2].sum() == pytest.approx(1, abs=0.04)


def test_haze_keeps_the_light_and_spreads_it() -> None:
    hazy = expose(rings(), ideal(haze=0.5), np.random.default_rng(0), CAMERA).astype(float)
    plain = expose(rings(), ideal(), np.random.default_rng(0), CAMERA).astype(float)
    assert hazy.mean() == pytest.approx(plain.mean(), rel=0.06)
    assert hazy.std() < 0.7 * plain.std()


def test_defocus_grows_away_from_the_focused_depth() -> None:
    spots = np.zeros((308, 416, 3), dtype=np.float32)
    near_center, in_focus = (152, 214), (152, int(204 + 147 * np.radians(45) * 1.03))
    spots[near_center], spots[in_focus] = 1, 1
    stored = expose(spots, ideal(defocus_px=1.5), np.random.default_rng(0), CAMERA)
    assert stored[near_center][0] < 80
    assert stored[in_focus][0] > 240


def test_defocus_by_distance_is_that_by_angle_on_the_axis_and_another_off_it() -> None:
    pipe, focus_mm = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5), 76.2 / np.sin(np.radians(45))
    by_angle, by_distance = ideal(defocus_px=3.0), ideal(defocus_px=3.0, focus_mm=focus_mm)

    def nearness(shift_mm: float) -> np.ndarray | None:
        T = np.eye(4)
        T[0, 3] = shift_mm
        return nearness_per_mm(pipe, T, CAMERA, by_distance)

    def spread(shift_mm: float) -> np.ndarray:
        spots = np.zeros((308, 416, 3), dtype=np.float32)
        spots[152, [84, 324]] = 1  # at 9 and 3 o'clock, 45 degrees off the axis
        return expose(spots, by_distance, np.random.default_rng(0), CAMERA, nearness(shift_mm))[152, [84, 324], 0]

    on_axis = expose(rings(), by_distance, np.random.default_rng(0), CAMERA, nearness(0.0)).astype(int)
    assert np.abs(on_axis - expose(rings(), by_angle, np.random.default_rng(0), CAMERA)).max() <= 1
    assert spread(0.0).min() > 250
    assert spread(25.0)[1] < 0.8 * 255  # the wall at 3 o'clock is near, and out of focus
    with pytest.raises(ValueError, match=r"focus_mm is 107\.7.*distance is not known"):
        expose(rings(), by_distance, np.random.default_rng(0), CAMERA)


def test_color_bleed_mixes_channels_and_keeps_grey() -> None:
    red = np.zeros((308, 416, 3), dtype=np.float32)
    red[..., 0] = 0.8
    stored = expose(red, ideal(color_bleed=0.25), np.random.default_rng(0), CAMERA)[0, 0]
    np.testing.assert_array_equal(stored, np.rint(np.array([0.6, 0.1, 0.1]) * 255))
    grey = expose(np.full_like(red, 0.4), ideal(color_bleed=0.25), np.random.default_rng(0), CAMERA)
    assert np.unique(grey).tolist() == [102]


def test_lost_bits_leave_fewer_levels_and_keep_black_and_white() -> None:
    ramp = np.repeat(np.linspace(0, 1, 416, dtype=np.float32)[None, :, None], 308, axis=0).repeat(3, axis=2)
    stored = expose(ramp, ideal(lost_bits=4), np.random.default_rng(0), CAMERA)
    assert len(np.unique(stored)) == 16
    assert (stored.min(), stored.max()) == (0, 255)


def test_compiled_finish_is_the_plain_formula() -> None:
    rng = np.random.default_rng(1)
    linear, blurred, veil = (rng.uniform(0, 1, (20, 30, 3)).astype(np.float32) for _ in range(3))
    noise = rng.standard_normal((20, 30, 3)).astype(np.float32)
    share, indirect = rng.uniform(0, 1, 60).astype(np.float32), rng.uniform(0, 0.2, (60, 3)).astype(np.float32)
    tones, center = np.arange(256, dtype=np.uint8), np.array([14.2, 9.1])
    dials = np.array([0.1, 0.2, 0.8, 0.01**2, 0.02**2], dtype=np.float32)
    stored = np.empty((20, 30, 3), dtype=np.uint8)
    _finish(linear, blurred, share, indirect, veil, noise, tones, center, dials, stored)

    v, u = np.mgrid[:20, :30]
    radius = np.hypot(u - center[0], v - center[1])
    light = linear + share[radius.astype(int)][..., None] * (blurred - linear)
    light += np.stack([np.interp(radius, np.arange(60), indirect[:, c]) for c in range(3)], axis=-1)
    light += 0.1 * (veil - light)
    light = 0.8 * (0.8 * light + 0.1 * (light.sum(axis=2, keepdims=True) - light))
    light += np.sqrt(dials[3] * light + dials[4]) * noise
    expected = np.rint(np.clip(light, 0, 1) * 255)
    assert np.abs(stored - expected).max() <= 1
    assert (stored == expected).mean() > 0.99
