"""What of a run is played: poses, wheels, rings and cloud at an even pace, small enough for one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scenarios.found_run import read_map
from scenarios.run import scenario_and_truth
from scenarios.scenario import Scenario
from sensor_model.geometry import rotation_from_wxyz, twist_about_z_rad, wall_direction
from sensor_model.rig import Projector
from sensor_model.wall_rays import near_wall, wall_ranges_mm
from twin.pipe import Pipe
from twin.robot import Robot
from twin.truth import Truth

RATE_HZ, MOST_FRAMES = 10.0, 600
AZIMUTHS = 36
MOST_POINTS = 15_000


@dataclass(frozen=True)
class Playback:
    """One drive, a row a frame; angles in degrees, wheels as `robot_model.wheel_names` has them (none on a gantry).

    `light_mm` is how far each slit's light goes from the projector's apex along `rays_camera` until it meets the wall,
    NaN where it meets none; `cloud_mm` the reconstruction's points with their deviation from the nominal wall.
    """

    scenario: Scenario
    pipe: Pipe
    time_s: Float[np.ndarray, "n"]
    T_pipe_camera: Float[np.ndarray, "n 4 4"]
    roll_deg: Float[np.ndarray, "n"]
    speed_mm_s: Float[np.ndarray, "n"]
    hubs_mm: Float[np.ndarray, "n wheels 3"]
    spin_rad: Float[np.ndarray, "n wheels"]
    slip_mm_s: Float[np.ndarray, "n wheels"]
    force_n: Float[np.ndarray, "n wheels"]
    apex_camera_mm: Float[np.ndarray, "3"]
    rays_camera: Float[np.ndarray, "slits azimuths 3"]
    light_mm: Float[np.ndarray, "n slits azimuths"]
    cloud_mm: Float[np.ndarray, "points 3"]
    cloud_dev_mm: Float[np.ndarray, "points"]


def read_run(folder: Path) -> Playback:
    """What a run's folder tells of its drive.

    Raises:
        BadInput: when it is not a whole run.
    """
    return playback(*scenario_and_truth(folder), *_cloud(folder / "reconstruction" / "wall_map.npz"))


def playback(scenario: Scenario, truth: Truth, cloud_mm: np.ndarray, cloud_dev_mm: np.ndarray) -> Playback:
    """A drive at `RATE_HZ`, or at what a page can carry of a long one."""
    duration_s = truth.time_s[-1] - truth.time_s[0]
    time_s = np.linspace(truth.time_s[0], truth.time_s[-1], int(np.clip(duration_s * RATE_HZ, 2, MOST_FRAMES)))
    T = truth.pose_at(time_s)
    wheels = 0 if truth.wheels is None else truth.wheels.force_n.shape[1]
    spin, slip, force = (np.zeros((time_s.size, wheels)) for _ in range(3))
    if truth.wheels is not None:
        at, log = np.searchsorted(truth.wheels.time_s, time_s).clip(max=truth.wheels.time_s.size - 1), truth.wheels
        spin = (np.cumsum(log.spin_rad_s, axis=0, dtype=float) * np.diff(log.time_s[:2]))[at]
        # of the time between two frames, not of one moment: a spike is over sooner
        slip, force = (_means(values, at) for values in (log.slip_mm_s, log.force_n))
    hubs = hub_places_mm(truth.pipe, scenario.robot, T) if wheels else np.zeros((time_s.size, 0, 3))
    projector = (scenario.true_rig or scenario.rig).projector
    apex, rays = projector.T_camera_projector[:3, 3], slit_rays(projector)
    light = np.stack([light_ranges_mm(truth.pipe, pose, apex, rays) for pose in T])
    return Playback(
        scenario,
        truth.pipe,
        time_s,
        T,
        np.degrees(np.unwrap(twist_about_z_rad(rotation_from_wxyz(_attitudes(truth, time_s))))),
        np.gradient(T[:, 2, 3], time_s),
        hubs,
        spin,
        slip,
        force,
        apex,
        rays,
        light,
        cloud_mm,
        cloud_dev_mm,
    )


def _attitudes(truth: Truth, time_s: np.ndarray) -> np.ndarray:
    return truth.q_pipe_camera_wxyz[np.searchsorted(truth.time_s, time_s).clip(max=truth.time_s.size - 1)]


def _means(values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Mean of the rows from each place to the next."""
    total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0, dtype=float)])
    after = np.append(at[1:], len(values)).clip(min=at + 1)
    return (total[after] - total[at]) / (after - at)[:, None]


def hub_places_mm(pipe: Pipe, robot: Robot, T_pipe_camera: np.ndarray) -> Float[np.ndarray, "n wheels 3"]:
    """Where every wheel's hub is when each stands off the wall below it by its radius, as a spring holds it there."""
    legs = [(angle, side * robot.wheel_spacing_mm / 2) for angle in robot.leg_clock_rad for side in (1, -1)]
    ends = [(np.radians(robot.end_wheel_clock_deg), side * robot.end_wheel_ahead_mm) for side in (1, -1)]
    radii = [robot.wheel_radius_mm] * len(legs) + [robot.end_wheel_radius_mm] * len(ends)
    places = []
    for (angle, ahead), radius in zip([*legs, *ends], radii, strict=True):
        outward = T_pipe_camera[:, :3, :3] @ wall_direction(angle)
        foot = T_pipe_camera[:, :3, :3] @ [0.0, 0.0, ahead - robot.camera_ahead_mm] + T_pipe_camera[:, :3, 3]
        wall = pipe.radius(np.arctan2(outward[:, 0], -outward[:, 1]), foot[:, 2])
        # the way from a foot off the axis to a circle about it
        along = np.sum(outward[:, :2] * foot[:, :2], axis=1)
        reach = -along + np.sqrt(along**2 + wall**2 - np.sum(foot[:, :2] ** 2, axis=1))
        places.append(foot + (reach - radius)[:, None] * outward)
    return np.stack(places, axis=1)


def slit_rays(projector: Projector) -> Float[np.ndarray, "slits azimuths 3"]:
    """Directions of the light beside each slit, in camera axes."""
    half, turn = np.meshgrid(projector.slit_half_angles_rad, 2 * np.pi * np.arange(AZIMUTHS) / AZIMUTHS, indexing="ij")
    rays = np.stack([np.sin(half) * np.sin(turn), -np.sin(half) * np.cos(turn), np.cos(half)], axis=-1)
    return rays @ projector.T_camera_projector[:3, :3].T


def light_ranges_mm(
    pipe: Pipe, T_pipe_camera: np.ndarray, apex_camera_mm: np.ndarray, rays_camera: np.ndarray
) -> Float[np.ndarray, "slits azimuths"]:
    """How far the light goes until it meets the wall."""
    apex = T_pipe_camera[:3, :3] @ apex_camera_mm + T_pipe_camera[:3, 3]
    rays = np.ascontiguousarray(rays_camera.reshape(-1, 3) @ T_pipe_camera[:3, :3].T)
    ranges = wall_ranges_mm(near_wall(pipe, float(T_pipe_camera[2, 3])), tuple(apex.tolist()), rays)
    return ranges.reshape(rays_camera.shape[:2])


def _cloud(file: Path) -> tuple[np.ndarray, np.ndarray]:
    """Some of the cells of a wall map as points, and their deviations; none where the run left no map."""
    if not file.is_file():
        return np.zeros((0, 3)), np.zeros(0)
    wall, dev = read_map(file)
    around, along = np.nonzero(np.isfinite(dev))
    kept = slice(None, None, max(around.size // MOST_POINTS, 1))
    around, along = around[kept], along[kept]
    places = wall_direction(wall.theta_rad[around]) * wall.radius_mm[around, along][:, None]
    places[:, 2] = wall.z_mm[along]
    return places, dev[around, along]
