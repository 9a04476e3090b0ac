"""A picture of the robot in the pipe: halfway through its drive, the near half of the wall cut away."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float

from scenarios.report.canvas import BLACK, ORANGE, SERIES, Picture, drawing, to_picture
from scenarios.run import Run
from scenarios.view.drive import hub_places_mm, light_ranges_mm, slit_rays
from sensor_model.geometry import wall_direction
from twin.pipe import Pipe
from twin.robot import Robot

AROUND, STEP_MM = 48, 8.0
BEHIND_MM, AHEAD_MM = 60.0, 230.0  # how much of the wall is drawn beyond the robot's tail and the camera
VIEW_YAW_DEG, VIEW_PITCH_DEG = 28.0, 18.0
LIGHT = np.array([0.45, 0.4, 0.8])  # towards the light: to the right, towards the reader, up
WALL_GREY, BODY_GREY, SENSOR_GREY, TIRE = "#cfd6db", "#8795a5", "#4a5561", "#33383d"


def robot_in_pipe(run: Run) -> Picture:
    """The robot as it was halfway, its light on the wall, and the far half of the pipe behind it."""
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.colors import to_rgb

    truth, robot = run.truth, run.scenario.robot
    middle = np.array([0.5 * (truth.time_s[0] + truth.time_s[-1])])
    T = truth.pose_at(middle)
    parts = robot_parts(truth.pipe, robot, T)
    quads = np.concatenate([faces for faces, _ in parts])
    colors = np.concatenate([np.tile(to_rgb(color), (len(faces), 1)) for faces, color in parts])
    flat, away = _seen(quads)
    order = np.argsort(-away, kind="stable")
    shaded = (colors * _brightness(quads)[:, None])[order]
    wide, tall = np.ptp(flat.reshape(-1, 2), axis=0)
    with drawing(float(np.clip(10 * tall / wide + 0.5, 3, 6))) as figure:
        axes = figure.subplots()
        faces: Any = flat[order]  # an array is taken whole, though the stubs ask for a list
        axes.add_collection(PolyCollection(faces, facecolors=shaded, edgecolors=shaded, linewidths=0.4))
        rings: Any = [_seen(ring[:, None])[0][:, 0] for ring in _far_light(run, T[0])]
        axes.add_collection(LineCollection(rings, colors=SERIES, linewidths=1.6))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_axis_off()
        at = T[0, 2, 3]
        axes.set_title(f"The robot at {middle[0]:.1f} s, its camera at {at:.0f} mm; downstream to the right")
        left, low = flat.reshape(-1, 2).min(axis=0)
        axes.plot([left, left + 100], [low, low], color=BLACK, lw=2)
        axes.text(left + 50, low + 6, "100 mm", ha="center", fontsize=9, color=BLACK)
        return to_picture(
            figure,
            "The robot in the pipe: a chassis on sprung legs with two wheels each, an end wheel before and behind "
            "them, the sensor ahead, and rings of light on the far half of the wall.",
            "Halfway through the drive, drawn from the truth; the near half of the wall is cut away. Lines: where the "
            "light beside each slit falls.",
            shaded=True,
        )


def robot_parts(
    pipe: Pipe, robot: Robot, T_pipe_camera: Float[np.ndarray, "1 4 4"]
) -> list[tuple[Float[np.ndarray, "faces 4 3"], str]]:
    """The far half of the wall and the robot's bodies as quadrilaterals in the pipe frame, mm, each with a colour."""
    R, camera = T_pipe_camera[0, :3, :3], T_pipe_camera[0, :3, 3]
    axis, chassis = R[:, 2], camera - robot.camera_ahead_mm * R[:, 2]
    half = robot.chassis_length_mm / 2 * axis
    parts = [
        (_half_wall(pipe, camera[2] - robot.behind_camera_mm - BEHIND_MM, camera[2] + AHEAD_MM), WALL_GREY),
        (_cylinder(chassis - half, chassis + half, robot.chassis_radius_mm), BODY_GREY),
        (_cylinder(camera - robot.sensor_length_mm * axis, camera, robot.sensor_radius_mm), SENSOR_GREY),
        (_cylinder(chassis + half, camera - robot.sensor_length_mm * axis, 6.0), BODY_GREY),
    ]
    for w, hub in enumerate(hub_places_mm(pipe, robot, T_pipe_camera)[0]):
        root = chassis + np.dot(hub - chassis, axis) * axis
        out, end = (hub - root) / np.linalg.norm(hub - root), w >= 2 * robot.leg_count
        axle = axis if end else np.cross(axis, out)
        radius = robot.end_wheel_radius_mm if end else robot.wheel_radius_mm
        wide = robot.wheel_width_mm / 2 * axle
        parts += [(_cylinder(root, hub, 4.0), BODY_GREY), (_cylinder(hub - wide, hub + wide, radius), TIRE)]
        parts.append((_cylinder(hub - 1.3 * wide, hub + 1.3 * wide, 0.3 * radius), ORANGE))
    return parts


def _half_wall(pipe: Pipe, from_mm: float, to_mm: float) -> Float[np.ndarray, "faces 4 3"]:
    """The half around 9 o'clock."""
    z = np.arange(max(from_mm, pipe.start_mm), min(to_mm, pipe.end_mm), STEP_MM)
    theta = np.linspace(np.pi, 2 * np.pi, AROUND)
    radius = pipe.radius(theta[:, None], z[None, :])
    return _grid(np.concatenate([radius[..., None] * wall_direction(theta)[:, None, :2], _deep(z, radius)], axis=-1))


def _deep(z_mm: np.ndarray, like: np.ndarray) -> np.ndarray:
    return np.broadcast_to(z_mm, like.shape)[..., None]


def _grid(places: Float[np.ndarray, "rows columns 3"]) -> Float[np.ndarray, "faces 4 3"]:
    """The cells of a grid of places."""
    return np.stack([places[:-1, :-1], places[1:, :-1], places[1:, 1:], places[:-1, 1:]], axis=2).reshape(-1, 4, 3)


def _cylinder(start: np.ndarray, end: np.ndarray, radius_mm: float) -> Float[np.ndarray, "faces 4 3"]:
    """A closed cylinder in small faces, so that they can be sorted by how far away they are."""
    length = float(np.linalg.norm(end - start))
    axis = (end - start) / length
    side = np.cross(axis, [1.0, 0, 0] if abs(axis[0]) < 0.7 else [0, 1.0, 0])
    side /= np.linalg.norm(side)
    turn = np.linspace(0, 2 * np.pi, AROUND // 2 + 1)
    out = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(axis, side)
    steps = np.linspace(0, length, max(int(length / STEP_MM), 1) + 1)
    mantle = start + radius_mm * out[:, None] + steps[None, :, None] * axis
    shares = np.linspace(0, 1, 4)[None, :, None]
    lids = [_grid(place + radius_mm * shares * out[:, None]) for place in (start, end)]
    return np.concatenate([_grid(mantle), *lids])


def _seen(quads: Float[np.ndarray, "n k 3"]) -> tuple[Float[np.ndarray, "n k 2"], Float[np.ndarray, "n"]]:
    """Places in the plane of the paper, seen from 3 o'clock and above, and how far away each group of them is."""
    yaw, pitch = np.radians([VIEW_YAW_DEG, VIEW_PITCH_DEG])
    along, away, up = quads[..., 2], -quads[..., 0], -quads[..., 1]
    across, back = np.cos(yaw) * along + np.sin(yaw) * away, np.cos(yaw) * away - np.sin(yaw) * along
    flat = np.stack([across, np.cos(pitch) * up + np.sin(pitch) * back], axis=-1)
    return flat, np.mean(np.cos(pitch) * back - np.sin(pitch) * up, axis=1)


def _brightness(quads: Float[np.ndarray, "n 4 3"]) -> Float[np.ndarray, "n"]:
    """How brightly each face is lit, whichever of its sides is seen."""
    normal = np.cross(quads[:, 2] - quads[:, 0], quads[:, 3] - quads[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-9)[:, None]
    towards = np.array([LIGHT[1], -LIGHT[2], LIGHT[0]]) / np.linalg.norm(LIGHT)
    return 0.55 + 0.45 * np.abs(normal @ towards)


def _far_light(run: Run, T_pipe_camera: Float[np.ndarray, "4 4"]) -> list[np.ndarray]:
    """The rings of light on the far half of the wall, from the bottom up."""
    projector = (run.scenario.true_rig or run.scenario.rig).projector
    apex, rays = projector.T_camera_projector[:3, 3], slit_rays(projector)
    light = light_ranges_mm(run.truth.pipe, T_pipe_camera, apex, rays)
    rings = (apex + light[..., None] * rays) @ T_pipe_camera[:3, :3].T + T_pipe_camera[:3, 3]
    far = [ring[(ring[:, 0] < 0) & (ring[:, 2] < T_pipe_camera[2, 3] + AHEAD_MM)] for ring in rings]
    return [ring[np.argsort(-ring[:, 1])] for ring in far if len(ring) > 1]
