"""The analytic wall against a ring of 48 boxes in MuJoCo's own collision, over a defect and a joint."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from sensor_model.geometry import wall_direction
from twin.drives.robot import _place, step
from twin.features.pocket import Pocket
from twin.joints import Joint
from twin.pipe import Pipe
from twin.robot import Robot, draw_build
from twin.robot_model import MM, RobotModel, build_model, robot_spec, wheel_names
from twin.wheel_contact import SOLIMP, SOLREF, WallContacts

RING, SLICE_MM, BOX_MM = 48, 0.25, 5.0
STOPS_MM = np.arange(-62.0, 111.0, 8.5)  # of the chassis: wheels on, beside and in the pocket and the joint's gap
MOVE_STEPS, REST_STEPS = 100, 300
SLIPPERY = 1e-3
# Shallow: on a flat nothing centres a wheel, and the further a robot shifts, the more the ring differs from the bore.
POCKET = Pocket(distance_mm=0, clock_deg="2:00", depth_mm=2.0, length_mm=40, width_mm=35)
JOINT = Joint(distance_mm=60, gap_mm=6, gap_depth_mm=1.5)
PIPE = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=(POCKET,), joints=(JOINT,))
BALLS = Robot(
    wheel_friction=SLIPPERY,
    wheel_crown_radius_mm=19.0,
    wheel_width_mm=20.0,
    preload_tolerance_pct=0,
    wheel_toe_tolerance_deg=0,
    end_wheel_skew_tolerance_deg=0,
    roller_ripple_mm=0,
    end_wheel_preload_n=0.1,
    leg_damping_n_s_m=20.0,
)


def ring_spec():
    """Ball-shaped, slippery wheels in boxes whose flats touch the wall in their middle, thin slices where it bends."""
    import mujoco

    spec = robot_spec(PIPE, BALLS, draw_build(BALLS, np.random.default_rng(0)))
    for geom in spec.geoms:
        if geom.name in wheel_names(BALLS):
            geom.type, geom.size, geom.fromto = mujoco.mjtGeom.mjGEOM_SPHERE, [geom.size[0], 0, 0], np.full(6, np.nan)
            geom.contype = geom.conaffinity = 1
            geom.friction, geom.solref, geom.solimp = [SLIPPERY, 0, 0], SOLREF, SOLIMP
    bends = [np.arange(z - half, z + half, SLICE_MM) for z, half in ((-20, 3), (20, 3), (60, 8))]
    lines = [-300.0, *np.concatenate(bends), 300.0]
    for theta in 2 * np.pi * np.arange(RING) / RING:
        flat = [(a, b, float(PIPE.radius(theta, (a + b) / 2))) for a, b in pairwise(lines)]
        for a, b, radius in flat:
            spec.worldbody.add_geom(
                type=mujoco.mjtGeom.mjGEOM_BOX,
                size=[np.pi / RING * (radius + BOX_MM) * MM, BOX_MM * MM, (b - a) / 2 * MM],
                pos=MM * ((radius + BOX_MM) * wall_direction(theta) + [0, 0, (a + b) / 2]),
                quat=[np.cos(theta / 2), 0, 0, np.sin(theta / 2)],
                friction=[SLIPPERY, 0, 0],
                solref=SOLREF,
                solimp=SOLIMP,
            )
    return spec


def pulled(model, advance) -> np.ndarray:
    """Chassis pose (x, y in mm, quaternion) at rest at every stop of being pulled along unturned, without gravity.

    The stops leave out the last millimetre before a wheel snaps out of the pocket, on which side it then is.
    """
    import mujoco

    model.opt.gravity[:] = 0
    data = mujoco.MjData(model)
    _place(data, PIPE, BALLS, STOPS_MM[0] + BALLS.camera_ahead_mm)
    poses, before_mm = [], STOPS_MM[0]
    for stop_mm in STOPS_MM:
        for i in range(MOVE_STEPS + REST_STEPS):
            told_mm = before_mm + (stop_mm - before_mm) * min(i / MOVE_STEPS, 1.0)
            data.xfrc_applied[1, 2] = 5e4 * (MM * told_mm - data.qpos[2]) - 400.0 * data.qvel[2]
            data.xfrc_applied[1, 5] = -20.0 * 2 * np.arctan2(data.qpos[6], data.qpos[3]) - 0.2 * data.qvel[5]
            advance(data)
        poses.append([data.qpos[0] / MM, data.qpos[1] / MM, *data.qpos[3:7]])
        before_mm = stop_mm
    return np.array(poses)


@pytest.fixture(scope="module")
def poses() -> tuple[np.ndarray, np.ndarray]:
    import mujoco

    robot: RobotModel = build_model(PIPE, BALLS, draw_build(BALLS, np.random.default_rng(0)))
    contacts = WallContacts(PIPE, robot, (SLIPPERY, SLIPPERY))
    boxes = ring_spec().compile()
    return (
        pulled(robot.model, lambda data: step(robot.model, data, contacts)),
        pulled(boxes, lambda data: mujoco.mj_step(boxes, data)),
    )


def test_the_pose_agrees_over_a_defect_and_a_joint(poses):
    analytic, ring = poses
    off_mm = np.linalg.norm(analytic[:, :2] - ring[:, :2], axis=1)
    turned_deg = np.degrees(2 * np.arccos(np.clip(np.abs(np.sum(analytic[:, 2:] * ring[:, 2:], axis=1)), -1, 1)))
    assert np.ptp(analytic[:, :2], axis=0).max() > 0.3  # it was moved
    assert off_mm.max() < 0.1
    assert turned_deg.max() < 0.1
