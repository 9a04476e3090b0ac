"""The glass tube: Snell's law both ways round, the same in every fidelity, and calibrated away."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from algorithms.calibration.pipe_view import fit_cylinder
from algorithms.triangulate import triangulate
from scenarios.bench.behind_glass import calibrate_behind_glass
from scenarios.bench.calibrated import BoardSession
from sensor_model import drawing, raycast
from sensor_model.board_pictures import aruco_sheet, draw_board
from sensor_model.glass import Glass, beyond, through, towards, tube_of
from sensor_model.optics import Optics
from sensor_model.points import PointNoise, see_slits
from sensor_model.rig import preset_rig
from twin.features.pocket import Pocket
from twin.pipe import Pipe

LEANING = Glass(thickness_mm=1.5, offset_mm=(1.0, -0.7), tilt_deg=(1.0, -0.5))
PLAIN = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
POCKET = Pocket(distance_mm=125, clock_deg=120, depth_mm=7.5, length_mm=70, width_mm=35)
EXACT = PointNoise(pixel_noise_px=0, drop_out_share=0, azimuths=180)
SMALL_CAMERA = {"width_px": 416, "height_px": 308, "fx_px": 147.2, "fy_px": 147.1, "skew_px": 0.17}
SMALL = preset_rig().model_copy(
    update={"camera": preset_rig().camera.model_copy(update={**SMALL_CAMERA, "cx_px": 204.1, "cy_px": 152.0})}
)


def ways(n: int) -> np.ndarray:
    """Directions that light takes out of the projector."""
    rng = np.random.default_rng(1)
    alpha, azimuth = rng.uniform(0.3, 0.68, n), rng.uniform(0, 2 * np.pi, n)
    return np.stack([np.sin(alpha) * np.cos(azimuth), np.sin(alpha) * np.sin(azimuth), np.cos(alpha)], axis=1)


def snell(direction: np.ndarray, normal: np.ndarray, eta: float) -> np.ndarray:
    """The law as textbooks have it, by angles."""
    across = direction - (direction @ normal) * normal
    inside = np.arcsin(eta * np.linalg.norm(across))
    return np.cos(inside) * normal + np.sin(inside) * across / np.linalg.norm(across)


def test_light_is_bent_as_by_snell_at_both_surfaces() -> None:
    tube, origin = tube_of(Glass(thickness_mm=2.0, offset_mm=(1.0, -2.0))), np.array([0.3, 0.1, -53.0])
    for direction in ways(20):
        place, onward = origin - [1.0, -2.0, 0.0], direction
        for radius, eta in ((24.0, 1 / 1.5), (26.0, 1.5)):
            a, b, c = onward[:2] @ onward[:2], place[:2] @ onward[:2], place[:2] @ place[:2] - radius**2
            place = place + (-b + np.sqrt(b * b - a * c)) / a * onward
            onward = snell(onward, np.append(place[:2] / radius, 0.0), eta)
        start, bent, passed = through(tube, tuple(origin), tuple(direction))
        np.testing.assert_allclose(start, [place[0] + 1.0, place[1] - 2.0, place[2]], atol=1e-9)
        np.testing.assert_allclose(bent, onward, atol=1e-12)
        assert 0.4 < passed < 0.95


def test_aiming_at_a_point_is_the_way_out_backwards() -> None:
    tube, origin = tube_of(LEANING), (0.3, -0.2, -53.0)
    starts, onward = beyond(tube, origin, ways(50))
    for direction, end in zip(ways(50), starts + 120 * onward, strict=True):
        np.testing.assert_allclose(towards(tube, origin, tuple(end))[0], direction, atol=1e-10)


@pytest.mark.parametrize(("half_angle_deg", "apex_moves_mm"), [(19.19, -2.06), (28.99, -1.09)])
def test_a_millimetre_of_glass_moves_the_apparent_apex_by_one_to_two(half_angle_deg, apex_moves_mm) -> None:
    alpha = np.radians(half_angle_deg)
    start, onward, _ = through(tube_of(Glass(thickness_mm=1)), (0.0, 0.0, -53.0), (np.sin(alpha), 0.0, np.cos(alpha)))
    assert start[2] - start[0] * onward[2] / onward[0] + 53.0 == pytest.approx(apex_moves_mm, abs=0.01)


@pytest.mark.parametrize("glass", [Glass(thickness_mm=1.5), LEANING], ids=["straight", "leaning"])
def test_both_ways_draw_the_same_picture_through_glass(glass: Glass) -> None:
    pipe = PLAIN.model_copy(update={"features": (POCKET,)})
    drawn, cast = (way.draw(pipe, np.eye(4), SMALL, Optics(glass=glass)) for way in (drawing, raycast))
    bare = raycast.draw(pipe, np.eye(4), SMALL, Optics())
    assert np.sqrt(np.mean((drawn - cast) ** 2)) < 0.012
    assert np.sqrt(np.mean((bare - cast) ** 2)) > 0.04


def off_the_slits_px(picture: np.ndarray, pixel: np.ndarray) -> float:
    """How far outward of pixels the middle of the dark is, on average."""
    camera = preset_rig().camera
    outward = pixel - [camera.cx_px, camera.cy_px]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    offsets = np.arange(-7, 7.01, 0.1)
    at = (pixel[:, None] + offsets[:, None] * outward[:, None]).astype(np.float32)
    dark = cv2.remap(picture, at[..., 0], at[..., 1], cv2.INTER_LINEAR) < 0.3
    return float(np.mean((dark * offsets).sum(axis=1) / dark.sum(axis=1)))


def test_slit_pixels_lie_in_the_slits_of_the_picture() -> None:
    glass = LEANING.model_copy(update={"ghost": 0.0})
    picture = raycast.draw(PLAIN, np.eye(4), preset_rig(), Optics.ideal().model_copy(update={"glass": glass}))
    seen, bare = (
        see_slits(PLAIN, np.eye(4), preset_rig(), EXACT, np.random.default_rng(0), g) for g in (glass, Glass())
    )
    for slit in range(5):
        assert abs(off_the_slits_px(picture.sum(axis=2), seen.pixel[seen.slit == slit])) < 0.1
        assert abs(off_the_slits_px(picture.sum(axis=2), bare.pixel[bare.slit == slit])) > 0.5


def test_the_ghost_lights_the_struts_shadow() -> None:
    def dark(ghost: float) -> float:
        glass = Glass(thickness_mm=1.5, ghost=ghost)
        picture = raycast.draw(PLAIN, np.eye(4), SMALL, Optics.ideal().model_copy(update={"glass": glass}))
        return float(picture[40:100, 204].max())

    assert dark(0.0) == 0
    assert 0.01 < dark(1.0) < 0.3


def test_a_board_is_seen_through_the_glass_too() -> None:
    T = np.eye(4)
    T[2, 3] = 150.0
    picture = draw_board(aruco_sheet(2, 2, 30.0, 10.0), T, SMALL, Optics(glass=LEANING), rings=False)
    bare = draw_board(aruco_sheet(2, 2, 30.0, 10.0), T, SMALL, Optics(), rings=False)
    assert 0.5 < picture.max() / bare.max() < 0.95
    # and the markers' edges lie elsewhere
    assert np.abs(picture / picture.max() - bare / bare.max()).max() > 0.3


def radius_of(rig) -> float:
    seen = see_slits(PLAIN, np.eye(4), preset_rig(), EXACT, np.random.default_rng(0), LEANING)
    return fit_cylinder(triangulate(seen, rig)).radius_mm


def test_calibrating_through_the_glass_removes_its_bias() -> None:
    session = BoardSession(boards=25, own_apex=True, points=PointNoise(azimuths=90))
    rig = calibrate_behind_glass(preset_rig(), LEANING, 0, session).rig
    assert all(slit.apex_mm for slit in rig.projector.slits)
    assert abs(radius_of(preset_rig()) - 76.2) > 1.0
    assert abs(radius_of(rig) - 76.2) < 0.15


def test_what_does_not_fit_into_the_tube_is_refused() -> None:
    with pytest.raises(ValueError, match="inside inner_radius_mm"):
        Glass(thickness_mm=1, inner_radius_mm=20, offset_mm=(20, 0))
    leaning = Glass(thickness_mm=1, inner_radius_mm=17, offset_mm=(12, -8), tilt_deg=(-8, 5))
    with pytest.raises(ValueError, match=r"the projector is .* mm off the glass tube's axis, outside 17 mm"):
        raycast.draw(PLAIN, np.eye(4), SMALL, Optics(glass=leaning))
