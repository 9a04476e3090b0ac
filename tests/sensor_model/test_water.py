"""Standing water: Snell's law at a level surface, the same in every fidelity, and refused where it cannot be."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensor_model import drawing, raycast
from sensor_model.geometry import fisheye_rays, transform
from sensor_model.glass import Glass
from sensor_model.optics import Optics
from sensor_model.points import PointNoise, see_slits
from sensor_model.rig import preset_rig
from sensor_model.water import Water, change_in_water, crossing, into_water, water_surface
from twin.features.pocket import Pocket
from twin.pipe import Pipe

PLAIN = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
ACROSS = PLAIN.model_copy(
    update={"features": (Pocket(distance_mm=125, clock_deg=150, depth_mm=5, length_mm=70, width_mm=35),)}
)
WATER = Water(depth_mm=15)
LEANING = Glass(thickness_mm=1.5, offset_mm=(1.0, -0.7), tilt_deg=(1.0, -0.5))
EXACT = PointNoise(pixel_noise_px=0, drop_out_share=0, azimuths=180)
SMALL_CAMERA = {"width_px": 416, "height_px": 308, "fx_px": 147.2, "fy_px": 147.1, "skew_px": 0.17}
SMALL = preset_rig().model_copy(
    update={"camera": preset_rig().camera.model_copy(update={**SMALL_CAMERA, "cx_px": 204.1, "cy_px": 152.0})}
)


def rolled(degrees: float) -> np.ndarray:
    """Off the axis, tilted and rolled."""
    turn = Rotation.from_euler("xyz", [2, -1.5, degrees], degrees=True)
    return transform(turn.as_matrix(), np.array([4.0, -3.0, 0.0]))


def slits(T: np.ndarray, **how: object) -> np.ndarray:
    return see_slits(PLAIN, T, preset_rig(), EXACT, np.random.default_rng(0), **how).pixel  # type: ignore[arg-type]


@pytest.mark.parametrize("inclination_deg", [0.0, 12.0])
def test_light_enters_the_water_by_snells_law(inclination_deg: float) -> None:
    surface = water_surface(WATER, PLAIN.model_copy(update={"inclination_deg": inclination_deg}))
    rng, up = np.random.default_rng(0), np.array(surface.up)
    for _ in range(30):
        foot = rng.uniform(-40, 40, 3)
        foot += (surface.level_mm - foot @ up) * up
        origin, point = foot + rng.uniform(2, 90) * up, rng.uniform([-30, -30, 120], [30, 30, 180])
        point += (surface.level_mm - point @ up - rng.uniform(0.01, 40)) * up
        enters = np.array(crossing(surface, tuple(origin), tuple(point)))
        before, after = enters - origin, point - enters
        before, after = before / np.linalg.norm(before), after / np.linalg.norm(after)
        assert enters @ up == pytest.approx(surface.level_mm, abs=1e-9)
        np.testing.assert_allclose(np.cross(up, before), surface.refraction * np.cross(up, after), atol=1e-9)
        np.testing.assert_allclose(into_water(surface, tuple(before)), after, atol=1e-9)
        step = 1e-6 * rng.standard_normal(3)
        step -= (step @ before) * before
        moved = np.array(into_water(surface, tuple((before + step) / np.linalg.norm(before + step)))) - after
        np.testing.assert_allclose(moved, change_in_water(surface, tuple(after), tuple(step)), atol=1e-10)


@pytest.mark.parametrize(
    ("pipe", "glass"), [(PLAIN, Glass()), (ACROSS, Glass()), (PLAIN, LEANING)], ids=["plain", "carved", "glass"]
)
def test_both_ways_draw_the_same_water(pipe: Pipe, glass: Glass) -> None:
    drawn, cast = (way.draw(pipe, rolled(20), SMALL, Optics(water=WATER, glass=glass)) for way in (drawing, raycast))
    dry = raycast.draw(pipe, rolled(20), SMALL, Optics(glass=glass))
    assert np.sqrt(np.mean((drawn - cast) ** 2)) < 0.005
    assert np.sqrt(np.mean((dry - cast) ** 2)) > 0.03


def test_black_water_leaves_the_mirror_image() -> None:
    black = Optics.ideal().model_copy(update={"water": Water(depth_mm=15, absorption_per_m=1e6)})
    for way in (drawing, raycast):
        dry, wet = (way.draw(PLAIN, np.eye(4), SMALL, optics).max(axis=2) for optics in (Optics.ideal(), black))
        below = dry[230:, 150:260] > 0.5
        mirror = wet[230:, 150:260][below]
        assert 0.01 < mirror.max() < 0.4
        assert np.median(mirror) < 0.2


@pytest.mark.parametrize("roll_deg", [0.0, 50.0])
def test_what_moves_is_what_is_under_the_level_surface(roll_deg: float) -> None:
    T = rolled(roll_deg)
    dry, wet = slits(T), slits(T, water=WATER)
    rays = fisheye_rays(dry, preset_rig().camera.intrinsics) @ T[:3, :3].T
    a, b, c = (rays[:, :2] ** 2).sum(axis=1), rays[:, :2] @ T[:2, 3], T[:2, 3] @ T[:2, 3] - 76.2**2
    down = T[1, 3] + (-b + np.sqrt(b * b - a * c)) / a * rays[:, 1]
    stayed = np.abs(dry[:, None] - wet[None]).max(axis=2).min(axis=1) < 1e-6
    np.testing.assert_array_equal(stayed, down < 76.2 - 15)
    assert 20 < np.count_nonzero(~stayed) < 0.4 * stayed.size


@pytest.mark.parametrize("glass", [Glass(), LEANING.model_copy(update={"ghost": 0.0})], ids=["air", "glass"])
def test_slit_pixels_lie_in_the_slits_of_the_picture(glass: Glass) -> None:
    optics = Optics.ideal().model_copy(update={"glass": glass, "water": WATER})
    picture = raycast.draw(PLAIN, np.eye(4), preset_rig(), optics).sum(axis=2)
    seen = see_slits(PLAIN, np.eye(4), preset_rig(), EXACT, np.random.default_rng(0), glass, WATER)
    camera = preset_rig().camera
    outward = seen.pixel - [camera.cx_px, camera.cy_px]
    below = (outward[:, 1] > 0.9 * np.linalg.norm(outward, axis=1)) & (seen.slit < 5)
    pixel, outward = seen.pixel[below], outward[below] / np.linalg.norm(outward[below], axis=1, keepdims=True)
    offsets = np.arange(-6, 6.01, 0.1)
    at = (pixel[:, None] + offsets[:, None] * outward[:, None]).astype(np.float32)
    levels = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR)
    dark = levels < levels.max(axis=1, keepdims=True) / 2
    off_px = (dark * offsets).sum(axis=1) / dark.sum(axis=1)
    assert below.sum() > 40
    assert abs(np.median(off_px)) < 0.1
    assert np.quantile(np.abs(off_px), 0.8) < 0.4


def test_a_sensor_in_the_water_and_a_steep_pipe_are_refused() -> None:
    with pytest.raises(ValueError, match=r"depth_mm is 78: the camera is 1\.2 mm above the water, and needs 2 to"):
        raycast.draw(PLAIN, rolled(0) * [[1], [1], [1], [1]], SMALL, Optics(water=Water(depth_mm=78)))
    with pytest.raises(ValueError, match=r"the camera is 16\.2 mm above the water, and needs 27\.5"):
        slits(np.eye(4), water=Water(depth_mm=60), glass=Glass(thickness_mm=1.5))
    steep = PLAIN.model_copy(update={"inclination_deg": 60.0})
    with pytest.raises(ValueError, match=r"inclined by 60 degrees; beyond 45 none stands"):
        drawing.draw(steep, np.eye(4), SMALL, Optics(water=WATER))
