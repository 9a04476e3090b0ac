"""The drawn picture: rings where the closed form puts them, and the same picture from two independent ways."""

from __future__ import annotations

import subprocess
import sys

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sensor_model import drawing, raycast
from sensor_model.geometry import apply, fisheye_project, inverse, jag_rad, transform
from sensor_model.glass import Glass
from sensor_model.optics import Optics, light, look
from sensor_model.rig import Rig, preset_rig
from sensor_model.shader_inputs import shadow_crop
from sensor_model.wall_rays import inward_normal
from sensor_model.water import Water
from sensor_model.ways import sight_along, view_of
from twin.features.pit import Pit
from twin.features.pocket import Pocket
from twin.features.scratch import Scratch
from twin.pipe import Pipe, wall_radius_mm

BORE_MM = 76.2
POCKET = Pocket(distance_mm=285, clock_deg=120, depth_mm=7.5, length_mm=70, width_mm=35)
PLAIN = Pipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5)
CARVED = Pipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5, features=(POCKET,))
SMALL_CAMERA = {"width_px": 416, "height_px": 308, "fx_px": 147.2, "fy_px": 147.1, "skew_px": 0.17}
SMALL = preset_rig().model_copy(
    update={"camera": preset_rig().camera.model_copy(update={**SMALL_CAMERA, "cx_px": 204.1, "cy_px": 152.0})}
)
WAYS = {"picture": drawing.draw, "raycast": raycast.draw}


def pose(z_mm: float = 160.0) -> np.ndarray:
    """Off the axis and tilted."""
    return transform(Rotation.from_euler("xyz", [2, -1.5, 0], degrees=True).as_matrix(), np.array([4.0, -3.0, z_mm]))


def jagged(rig: Rig, cells: int) -> Rig:
    """The rig with slits that wander by up to 0.3 degrees around the slide, each in its own way."""
    around = np.arange(cells) / cells * 2 * np.pi
    slits = [
        slit.model_copy(update={"jag_deg": tuple((0.3 * np.sin(3 * around + number)).tolist())})
        for number, slit in enumerate(rig.projector.slits)
    ]
    return rig.model_copy(update={"projector": rig.projector.model_copy(update={"slits": tuple(slits)})})


def ring_px(rig: Rig, T_pipe_camera: np.ndarray, half_angle: np.ndarray, azimuth: np.ndarray) -> np.ndarray:
    """Closed form: pixels where the cone of a half angle, azimuth by azimuth, meets a plain cylinder."""
    T = T_pipe_camera @ rig.projector.T_camera_projector
    tangent = np.tan(half_angle)
    local = np.stack([tangent * np.sin(azimuth), -tangent * np.cos(azimuth), np.ones_like(azimuth)], axis=-1)
    ray, apex = local @ T[:3, :3].T, T[:3, 3]
    a, b, c = (ray[:, :2] ** 2).sum(axis=1), ray[:, :2] @ apex[:2], apex[:2] @ apex[:2] - BORE_MM**2
    wall = apex + ((-b + np.sqrt(b * b - a * c)) / a)[:, None] * ray
    return fisheye_project(apply(inverse(T_pipe_camera), wall), rig.camera.intrinsics)


def crossing(profile: np.ndarray, offsets: np.ndarray) -> float:
    """Where a profile first rises through half its last level."""
    level = profile[-10:].mean() / 2
    i = int(np.argmax(profile > level))
    return float(np.interp(level, profile[i - 1 : i + 1], offsets[i - 1 : i + 1]))


def slit_offsets_px(picture: np.ndarray, rig: Rig, T_pipe_camera: np.ndarray, slit: int) -> np.ndarray:
    """Measured less true centre of one slit along many lines across it."""
    azimuth = np.radians(np.arange(25, 335, 2.0))
    half_angle = np.full(azimuth.size, rig.projector.slit_half_angles_rad[slit])
    if rig.projector.jag_table_rad.size:
        half_angle += jag_rad(rig.projector.jag_table_rad, np.full(azimuth.size, slit), azimuth)
    true = ring_px(rig, T_pipe_camera, half_angle, azimuth)
    outward = ring_px(rig, T_pipe_camera, half_angle + 1e-4, azimuth) - true
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    offsets = np.arange(0, 11, 0.1)
    levels = []
    for side in (1, -1):
        at = (true[:, None] + side * offsets[:, None] * outward[:, None]).astype(np.float32)
        levels.append(cv2.remap(picture.sum(axis=2), at[..., 0], at[..., 1], cv2.INTER_LINEAR))
    return np.array([(crossing(o, offsets) - crossing(i, offsets)) / 2 for o, i in zip(*levels, strict=True)])


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("rig", [preset_rig(), jagged(preset_rig(), 60)], ids=["smooth slide", "jagged slide"])
def test_slits_lie_where_the_closed_form_has_them(way: str, rig: Rig) -> None:
    picture = WAYS[way](PLAIN, pose(), rig, Optics.ideal())
    for slit in range(len(rig.projector.slits)):
        off_px = slit_offsets_px(picture, rig, pose(), slit)
        assert abs(off_px.mean()) < 0.05
        assert np.median(np.abs(off_px)) < 0.15


@pytest.mark.parametrize(
    ("pipe", "optics", "limit"),
    [
        (PLAIN, Optics.ideal(), 0.01),
        (CARVED, Optics.ideal(), 0.012),
        (CARVED, Optics(), 0.012),
        (PLAIN, look("endoscope"), 0.012),
    ],
    ids=["plain", "carved", "carved, all effects", "as the real sensor"],
)
def test_both_ways_give_the_same_picture(pipe: Pipe, optics: Optics, limit: float) -> None:
    drawn, cast = (draw(pipe, pose(), preset_rig(), optics) for draw in WAYS.values())
    assert cast.max() > 0.5
    assert np.sqrt(np.mean((drawn - cast) ** 2)) < limit


@pytest.mark.parametrize(
    "pipe",
    [
        PLAIN.model_copy(update={"ovality_pct": 3.0, "ovality_clock_deg": 20.0}),
        CARVED.model_copy(update={"backed": False}),
        PLAIN.model_copy(
            update={
                "features": (
                    Pit(distance_mm=260, clock_deg=70, depth_mm=6, diameter_mm=18),
                    Pit(distance_mm=270, clock_deg=80, depth_mm=4, diameter_mm=20, shape="conical"),
                    Scratch(distance_mm=280, clock_deg=200, depth_mm=2, path_length_mm=60, width_mm=3, heading_deg=50),
                    Pocket(distance_mm=255, clock_deg=300, depth_mm=3, length_mm=30, width_mm=25, floor="planar"),
                )
            }
        ),
        Pipe(inner_radius_mm=BORE_MM, wall_thickness_mm=7.5, start_mm=0, end_mm=300),
    ],
    ids=["oval", "hole", "many", "ending"],
)
def test_both_ways_agree_on_every_kind_of_wall(pipe: Pipe) -> None:
    drawn, cast = (draw(pipe, pose(), SMALL, Optics()) for draw in WAYS.values())
    assert np.sqrt(np.mean((drawn - cast) ** 2)) < 0.012


def test_both_ways_draw_a_rigs_own_jagged_slide_and_the_optics_print_on_it() -> None:
    rig = jagged(SMALL, 17)
    drawn, cast = (draw(PLAIN, pose(), rig, Optics(slide_jag_deg=0.2)) for draw in WAYS.values())
    assert np.sqrt(np.mean((drawn - cast) ** 2)) < 0.005
    assert np.sqrt(np.mean((cast - raycast.draw(PLAIN, pose(), SMALL, Optics(slide_jag_deg=0.2))) ** 2)) > 0.02


@pytest.mark.parametrize("way", WAYS)
def test_light_falls_with_the_true_distance_from_the_projector(way: str) -> None:
    far_off = transform(np.eye(3), np.array([25.0, -15.0, 160.0]))
    even, fading = (
        WAYS[way](PLAIN, far_off, SMALL, Optics.ideal().model_copy(update={"distance_power": power})).max(axis=2)
        for power in (0.0, 2.0)
    )
    row, column = np.nonzero(even > 0.3)
    rays = raycast.camera_rays(SMALL.camera)[row, column].astype(float)
    a, b = (rays[:, :2] ** 2).sum(axis=1), rays[:, :2] @ far_off[:2, 3]
    reach = (-b + np.sqrt(b * b - a * (far_off[:2, 3] @ far_off[:2, 3] - BORE_MM**2))) / a
    range_mm = np.linalg.norm(reach[:, None] * rays - np.array(SMALL.projector.apex_mm), axis=1)
    assert range_mm.max() / range_mm.min() > 2
    np.testing.assert_allclose(fading[row, column] / even[row, column], (130.0 / range_mm) ** 2, rtol=2e-3)


def test_a_scene_changed_and_changed_back_is_the_same() -> None:
    first = drawing.draw(CARVED, pose(), SMALL, Optics())
    drawing.draw(PLAIN, pose(500.0), SMALL, Optics())
    np.testing.assert_array_equal(first, drawing.draw(CARVED, pose(), SMALL, Optics()))


@pytest.mark.parametrize("way", WAYS)
def test_the_strut_and_the_housing_take_light_away(way: str) -> None:
    def lit(**change: float) -> float:
        rig = SMALL.model_copy(update={"projector": preset_rig().projector.model_copy(update=change)})
        return float((WAYS[way](PLAIN, np.eye(4), rig, Optics.ideal()) > 0).mean())

    whole = lit(strut_width_deg=0.0)
    assert lit(strut_width_deg=90.0, strut_softness_deg=0.0) / whole == pytest.approx(0.75, abs=0.02)
    assert lit(housing_radius_mm=25.0) < 0.8 * lit()


@pytest.mark.parametrize("way", WAYS)
def test_a_hole_returns_no_light_and_a_backing_does(way: str) -> None:
    floor = fisheye_project(apply(inverse(pose()), hole_floor_mm()), SMALL.camera.intrinsics).round().astype(int)
    backed, unbacked = (
        WAYS[way](CARVED.model_copy(update={"backed": b}), pose(), SMALL, Optics.ideal()) for b in (True, False)
    )
    assert backed[floor[:, 1], floor[:, 0]].max() > 0.5
    assert unbacked[floor[:, 1], floor[:, 0]].max() == 0


def hole_floor_mm() -> np.ndarray:
    z = np.linspace(275, 300, 12)
    theta, rho = np.radians(120), BORE_MM + 7.5
    return np.stack([np.full(12, rho * np.sin(theta)), np.full(12, -rho * np.cos(theta)), z], axis=-1)


def test_the_pocket_shades_its_own_floor_behind_the_rim() -> None:
    """Past the rim at 250 mm, light at half angle a meets a floor 7.5 mm down only 7.5 / tan(a) further on.

    The camera, nearer to the rim, sees the floor from 0.63 of that.
    """
    T = np.eye(4)
    T[2, 3] = 160.0
    theta, rho = np.radians(120), BORE_MM + 7.5
    half_angle = np.arctan(BORE_MM / (250 - 160 + 53))
    dark, bright = 250 + 0.8 * 7.5 / np.tan(half_angle), 250 + 1.4 * 7.5 / np.tan(half_angle)
    for draw in WAYS.values():
        picture = draw(CARVED, T, preset_rig(), Optics.ideal())
        for z, expected in ((dark, False), (bright, True)):
            wall = np.array([[rho * np.sin(theta), -rho * np.cos(theta), z - 160.0]])
            u, v = fisheye_project(wall, preset_rig().camera.intrinsics)[0].round().astype(int)
            assert bool(picture[v - 1 : v + 2, u - 1 : u + 2].max() > 0.3) == expected


def test_the_ray_caster_finds_the_wall_that_plain_bisection_finds() -> None:
    rng = np.random.default_rng(0)
    view = view_of(CARVED, pose(), preset_rig(), Glass(), Water())
    beam = light(preset_rig().projector, Optics())
    compared = 0
    for _ in range(300):
        aim = hole_floor_mm()[5] + rng.normal(0, 12, 3) - np.array(view.eye)
        aim /= np.linalg.norm(aim)
        found = raycast._hit(CARVED.wall, view, beam, sight_along(view, tuple(aim.tolist())))
        if found < 0:
            continue
        s = np.arange(found - 30, found + 5, 0.002)
        x, y, z = (view.eye[i] + s * aim[i] for i in range(3))
        beyond = np.hypot(x, y) >= CARVED.radius(np.arctan2(x, -y), z) - 1e-9
        assert s[np.argmax(beyond)] == pytest.approx(found, abs=0.004)
        compared += 1
    assert compared > 100


def test_the_inward_normal_is_the_walls() -> None:
    for theta, z in ((2.0, 250.3), (2.28, 280.0), (1.0, 100.0)):
        rho = wall_radius_mm(CARVED.wall, theta, z)
        point = (rho * np.sin(theta), -rho * np.cos(theta), z)
        normal = np.array(inward_normal(CARVED.wall, point))
        assert np.linalg.norm(normal) == pytest.approx(1)
        for d_theta, d_z in ((1e-4, 0.0), (0.0, 1e-2)):
            ends = []
            for sign in (-1, 1):
                t, at = theta + sign * d_theta, z + sign * d_z
                r = wall_radius_mm(CARVED.wall, t, at)
                ends.append(np.array([r * np.sin(t), -r * np.cos(t), at]))
            along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
            assert abs(normal @ along) < 2e-3


@pytest.mark.parametrize("way", WAYS)
def test_a_camera_outside_the_bore_is_refused(way: str) -> None:
    T = np.eye(4)
    T[0, 3] = 90.0
    with pytest.raises(ValueError, match="off the axis"):
        WAYS[way](PLAIN, T, SMALL, Optics())


def test_memory_does_not_grow_with_the_pipe() -> None:
    """Each pipe in a process of its own: the peak of a process never falls, and `ru_maxrss` begins at the parent's."""
    peaks = [int(subprocess.check_output([sys.executable, "-c", MEMORY, str(end)])) for end in (900, 20_000)]
    assert max(peaks) < 700_000
    assert peaks[1] < peaks[0] * 1.1


MEMORY = """
import sys
import numpy as np
from sensor_model.drawing import draw
from sensor_model.optics import Optics
from sensor_model.rig import preset_rig
from twin.pipe import Pipe
end = float(sys.argv[1])
pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, end_mm=end)
T = np.eye(4)
for z in np.linspace(0, end - 300, 12):
    T[2, 3] = z
    draw(pipe, T, preset_rig(), Optics())
print(next(line.split()[1] for line in open('/proc/self/status') if line.startswith('VmHWM')))
"""


def test_a_feature_that_the_light_hardly_reaches_has_a_shadow_map_too():
    """Wherever the camera is on its way to a pocket, what may be shaded has some size."""
    rig, optics = preset_rig(), Optics()
    tangent = light(rig.projector, optics).lit_to[-1]
    halves = []
    for z_mm in np.arange(100.0, 320.0, 0.25):
        T_projector_pipe = inverse(pose(z_mm) @ rig.projector.T_camera_projector)
        crop = shadow_crop(CARVED, [0], z_mm, T_projector_pipe, tangent, optics)
        halves += [] if crop is None else [crop[2]]
    assert len(halves) > 100
    assert min(halves) >= 0.01
    assert sorted(halves)[0] < 1.5 * 0.01  # and there are places where that decides
