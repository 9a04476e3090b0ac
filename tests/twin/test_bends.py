"""Coiled pipe and swept bends: places, light and the robot against closed forms of an arc, and what is refused."""

from __future__ import annotations

import re

import numpy as np
import pytest
from pydantic import ValidationError

from sensor_model import drawing
from sensor_model.geometry import GRAVITY_M_S2, inverse, rotation_from_wxyz, transform
from sensor_model.imu import NO_IMU_NOISE, measure_imu
from sensor_model.optics import Optics
from sensor_model.rig import preset_rig
from sensor_model.wall_rays import in_shadow, near_wall, wall_ranges_mm
from twin.bends import Bend, bent, followed, rows_about, unbent
from twin.drives.gantry import GantryDrive, Stage
from twin.drives.gantry import drive as gantry
from twin.drives.robot import RobotDrive, simulate_motion, truth_of
from twin.pipe import Pipe
from twin.robot import Robot

BORE = {"inner_radius_mm": 76.2, "wall_thickness_mm": 7.5}
OUTER_MM = 2 * 83.7
COIL_MM = 25 * OUTER_MM
CAMERA = {"width_px": 416, "height_px": 308, "fx_px": 147.2, "fy_px": 147.1, "skew_px": 0.17, "cx_px": 204.1}
SMALL = preset_rig().model_copy(update={"camera": preset_rig().camera.model_copy(update={**CAMERA, "cy_px": 152.0})})


def coil(*bends: Bend) -> Pipe:
    """A pipe that bends so, or is straight."""
    return Pipe(**BORE, start_mm=-600, end_mm=1900, bends=bends)


MOUNT = preset_rig().imu
COIL = coil(Bend(from_mm=-600, to_mm=1900))
SNAKE = Pipe(
    **BORE,
    start_mm=-400,
    end_mm=6000,
    bends=(
        Bend(from_mm=100, to_mm=1500, radius_od=5),
        Bend(from_mm=2000, to_mm=3000, radius_od=10, towards="up"),
        Bend(from_mm=3000, to_mm=4000, radius_od=10, towards="down"),
        Bend(from_mm=4100, to_mm=5500, radius_od=3, towards="left"),
    ),
)
SLIPPERY = Robot(
    wheel_friction=0.05,
    roller_friction=1e-4,
    roller_ripple_mm=0,
    preload_tolerance_pct=0,
    wheel_toe_tolerance_deg=0,
    end_wheel_skew_tolerance_deg=0,
)


def test_places_go_into_the_world_and_come_back():
    rng = np.random.default_rng(0)
    place = np.column_stack([rng.uniform(-60, 60, (500, 2)), np.sort(rng.uniform(-300, 5900, 500))])
    world = bent(SNAKE.axis, SNAKE.start_mm, place)
    assert followed(SNAKE.wall.axis, world) == pytest.approx(place, abs=1e-9)

    near = place[np.abs(place[:, 2] - 2500) < 400]
    rows = rows_about(SNAKE.axis, 2500.0, 900.0)
    there = [unbent(rows, *point) for point in bent(SNAKE.axis, 2500.0, near).tolist()]
    assert np.array(there) == pytest.approx(near, abs=1e-9)


def test_axis_runs_on_without_a_kink_and_as_long_as_it_says():
    z = np.linspace(-400, 6000, 6401)
    T = SNAKE.axis.frame(z)
    way = np.diff(T[:, :3, 3], axis=0)
    assert np.linalg.norm(way, axis=1) == pytest.approx(1.0, abs=1e-5)
    assert np.einsum("ni,ni->n", way, T[:-1, :3, 2]) == pytest.approx(1.0, abs=1e-5)
    assert inverse(T) @ T == pytest.approx(np.broadcast_to(np.eye(4), T.shape), abs=1e-9)
    ends = Pipe(**BORE, bends=(Bend(from_mm=0, to_mm=np.pi / 2 * 5 * OUTER_MM, radius_od=5),), end_mm=2000).axis
    assert ends.frame(1400.0)[:3, 2] == pytest.approx([1.0, 0.0, 0.0])


@pytest.mark.parametrize("radius_od", [25.0, 4.0])
def test_light_meets_the_torus(radius_od):
    pipe = coil(Bend(from_mm=-600, to_mm=1900, radius_od=radius_od))
    eye, radius_mm = (3.0, -2.0, 500.0), radius_od * OUTER_MM
    alpha, turn = np.radians(np.linspace(19, 37, 60)), np.linspace(0, 6, 60)
    rays = np.column_stack([np.sin(alpha) * np.sin(turn), -np.sin(alpha) * np.cos(turn), np.cos(alpha)])
    wall = near_wall(pipe, eye[2])
    ends = np.array(eye) + wall_ranges_mm(wall, eye, rays)[:, None] * rays
    from_axis = np.hypot(radius_mm - np.hypot(radius_mm - ends[:, 0], ends[:, 2] - eye[2]), ends[:, 1])
    assert from_axis == pytest.approx(76.2, abs=1e-5)
    # the inner side of a sharp bend hides what lies around the corner
    around = bent(pipe.axis, eye[2], np.array([[76.2, 0.0, 900.0], [-76.2, 0.0, 600.0]]))
    assert in_shadow(wall, around, eye).tolist() == [radius_od < 10, False]


def test_robot_lies_on_its_chord_and_turns_with_the_pipe():
    motion = simulate_motion(COIL, SLIPPERY, RobotDrive(end_mm=90), np.random.default_rng(0))
    truth = truth_of(COIL, SLIPPERY, motion)
    assert truth.position_mm[0, 2] == pytest.approx(0.0, abs=1e-3)
    # two wheels 80 mm apart on an arc: their middle lies L^2 / 8 R inside, and the camera on the tangent there
    outside_mm = (SLIPPERY.camera_ahead_mm**2 - (SLIPPERY.wheel_spacing_mm / 2) ** 2) / (2 * COIL_MM)
    nose = rotation_from_wxyz(truth.q_pipe_camera_wxyz[0])[:, 2]
    assert truth.position_mm[0, 0] == pytest.approx(-outside_mm, abs=0.03)
    assert np.degrees(nose[0]) == pytest.approx(-np.degrees(SLIPPERY.camera_ahead_mm / COIL_MM), abs=0.01)

    steady = slice(900, 1500)
    speed = np.gradient(truth.position_mm[:, 2], truth.time_s)[steady].mean()
    turning = truth.angular_velocity_camera_rad_s[steady, 1].mean()
    assert turning == pytest.approx(speed / COIL_MM, rel=0.02)
    assert truth.acceleration_mm_s2[steady, 0].mean() == pytest.approx(speed**2 / COIL_MM, rel=0.1)
    # all wheels roll alike, but the way at 2 o'clock is shorter than that at 10 o'clock
    slip = truth.wheels.slip_mm_s[steady.start // 5 : steady.stop // 5, :6].mean(axis=0).reshape(3, 2).mean(axis=1)
    shorter = 76.2 * (np.sin(np.radians(60)) - np.sin(np.radians(300))) / COIL_MM
    assert slip[0] - slip[2] == pytest.approx(speed * shorter, rel=0.1)


def test_imu_feels_a_bend():
    up = Pipe(**BORE, end_mm=1900, bends=(Bend(from_mm=0, to_mm=1900, towards="up"),))
    truth = gantry(up, Robot(), GantryDrive(stages=(Stage(to_mm=1000),), speed_mm_s=100), np.random.default_rng(0))
    log = measure_imu(truth, MOUNT, NO_IMU_NOISE, np.random.default_rng(0), np.random.default_rng(0))
    middle = len(log.stamp_ns) // 2
    slope = (truth.pose_at(log.stamp_ns[[middle]] / 1e9)[0, 2, 3]) / COIL_MM
    R_camera_imu = MOUNT.R_camera_imu
    force, gyro = R_camera_imu @ log.acceleration_m_s2[middle], R_camera_imu @ log.gyro_rad_s[middle]
    assert gyro == pytest.approx([100 / COIL_MM, 0, 0], abs=1e-5)
    centripetal = 0.1**2 / (COIL_MM / 1e3)
    assert force == pytest.approx(
        [0, -GRAVITY_M_S2 * np.cos(slope) - centripetal, GRAVITY_M_S2 * np.sin(slope)], abs=2e-3
    )
    q = rotation_from_wxyz(log.q_world_imu_wxyz[middle]) @ R_camera_imu.T
    assert q[2, 2] == pytest.approx(np.sin(slope), abs=1e-6)  # the nose points up


def test_drawn_picture_of_a_coil_is_the_ray_casters():
    from sensor_model import raycast

    T = transform(np.eye(3), np.array([3.0, -2.0, 500.0]))
    drawn, cast = (draw(COIL, T, SMALL, Optics()) for draw in (drawing.draw, raycast.draw))
    assert np.abs(drawn - cast).mean() < 3e-4
    assert np.abs(drawing.draw(coil(), T, SMALL, Optics()) - drawn).mean() > 3e-3


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"inclination_deg": 5, "bends": [{"from_mm": 0, "to_mm": 100}]}, "only a level pipe may bend sideways"),
        ({"bends": [{"from_mm": 0, "to_mm": 100}, {"from_mm": 50, "to_mm": 200}]}, "begins before 100 mm"),
        ({"bends": [{"from_mm": -900, "to_mm": 100}]}, "begins before -400 mm"),
        ({"bends": [{"from_mm": 0, "to_mm": 900, "radius_od": 3, "towards": "up"}]}, "no 12 o'clock"),
        ({"backed": False, "bends": [{"from_mm": 0, "to_mm": 100}]}, "must be backed"),
    ],
)
def test_impossible_bends_are_refused(changes, words):
    with pytest.raises(ValidationError, match=re.escape(words)):
        Pipe.model_validate({**BORE, **changes})


def test_a_bend_that_shades_itself_is_not_drawn():
    sharp = coil(Bend(from_mm=0, to_mm=500, radius_od=5))
    with pytest.raises(ValueError, match="raycast and points can"):
        drawing.draw(sharp, transform(np.eye(3), np.array([0.0, 0.0, 100.0])), preset_rig(), Optics())
