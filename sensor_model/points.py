"""The cheap fidelity: slit pixels straight from the wall radius, without drawing a picture."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field

from sensor_model.geometry import fisheye_project, wall_angle_rad, wrap_rad
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig
from sensor_model.settings import Settings
from twin.pipe import Pipe, wall_radius_mm

STEP_MM = 0.5
BISECTIONS = 24
CLEARANCE_MM = 0.05  # a sight line this near its own foot on the wall is not blocked by it


class PointNoise(Settings):
    """What stands for the picture's errors; every one has a zero."""

    azimuths: Annotated[int, Field(ge=36, le=7200)] = 720
    pixel_noise_px: Annotated[float, Field(ge=0)] = 0.25
    drop_out_share: Annotated[float, Field(ge=0, lt=1)] = 0.02


def see_slits(
    pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, noise: PointNoise, rng: np.random.Generator
) -> SlitPixels:
    """Where the camera sees each slit: light from the apex to its first wall point, and from there to the camera.

    Slit centre lines are followed at equal steps around the projector's axis. Lost: the strut's sector, what the rim
    of a defect hides from projector or camera, holes, what falls outside the picture, and drop-outs.
    """
    projector = rig.projector
    angles = projector.slit_half_angles_rad
    around = np.arange(noise.azimuths) * 2 * np.pi / noise.azimuths
    slit, azimuth = (grid.ravel() for grid in np.meshgrid(np.arange(angles.size), around, indexing="ij"))
    alpha = angles[slit]
    rays = np.stack([np.sin(alpha) * np.sin(azimuth), -np.sin(alpha) * np.cos(azimuth), np.cos(alpha)], axis=-1)
    T_pipe_projector = T_pipe_camera @ projector.T_camera_projector
    lit = first_wall_points(
        pipe.wall, T_pipe_projector[:3, 3].copy(), rays @ T_pipe_projector[:3, :3].T, pipe.start_mm, pipe.end_mm
    )
    seen = np.isfinite(lit[:, 0])
    seen[seen] &= in_sight(pipe.wall, lit[seen], T_pipe_camera[:3, 3].copy())
    seen[seen] &= ~pipe.through(wall_angle_rad(lit[seen, 0], lit[seen, 1]), lit[seen, 2])
    # the strut's soft edge passes half the light at its stated width
    seen &= (
        np.abs(wrap_rad(azimuth - np.radians(projector.strut_clock_deg))) > np.radians(projector.strut_width_deg) / 2
    )
    rays_camera = rays @ projector.T_camera_projector[:3, :3].T
    apex = np.array(projector.apex_mm)
    at_camera = apex[:2] - rays_camera[:, :2] * (
        apex[2] / rays_camera[:, 2:]
    )  # where light passes the camera's housing
    seen &= np.linalg.norm(at_camera, axis=1) > projector.housing_radius_mm
    seen &= rng.random(slit.size) >= noise.drop_out_share
    jitter = (
        rng.standard_normal(slit.size) * noise.pixel_noise_px
    )  # drawn for all, so that draws do not depend on sight

    points_camera = (lit[seen] - T_pipe_camera[:3, 3]) @ T_pipe_camera[:3, :3]
    pixel = fisheye_project(points_camera, rig.camera.intrinsics)
    center = np.array([rig.camera.cx_px, rig.camera.cy_px])
    outward = (pixel - center) / np.linalg.norm(pixel - center, axis=1, keepdims=True)
    pixel = pixel + jitter[seen, None] * outward
    size = np.array([rig.camera.width_px, rig.camera.height_px])
    inside = np.all((pixel >= 0) & (pixel <= size - 1), axis=1)
    sigma = np.full(int(inside.sum()), max(noise.pixel_noise_px, 0.01))
    return SlitPixels(pixel[inside], slit[seen][inside], sigma)


@njit(cache=True)
def first_wall_points(wall, origin, rays, start_mm, end_mm):
    """First point of each ray on the wall, NaN where it leaves the pipe; the origin lies inside the bore."""
    out = np.full(rays.shape, np.nan)
    smallest = wall.inner_radius * (1.0 - wall.ovality) - 1e-6
    for i in range(rays.shape[0]):
        dx, dy, dz = rays[i]
        across2 = dx * dx + dy * dy
        if across2 < 1e-12:
            continue
        b = origin[0] * dx + origin[1] * dy
        c = origin[0] ** 2 + origin[1] ** 2
        near = (-b + np.sqrt(b * b - across2 * (c - smallest**2))) / across2
        far = (-b + np.sqrt(b * b - across2 * (c - (wall.outer_radius + 1e-6) ** 2))) / across2
        low, high = near, near
        while high < far:
            high = min(low + STEP_MM, far)
            if _beyond(wall, origin, dx, dy, dz, high) >= 0:
                break
            low = high
        for _ in range(BISECTIONS):
            middle = 0.5 * (low + high)
            if _beyond(wall, origin, dx, dy, dz, middle) >= 0:
                high = middle
            else:
                low = middle
        z = origin[2] + high * dz
        if start_mm <= z <= end_mm:
            out[i, 0], out[i, 1], out[i, 2] = origin[0] + high * dx, origin[1] + high * dy, z
    return out


@njit(cache=True)
def _beyond(wall, origin, dx, dy, dz, t):
    """How far a ray's point lies beyond the wall, mm."""
    x, y = origin[0] + t * dx, origin[1] + t * dy
    return np.hypot(x, y) - wall_radius_mm(wall, np.arctan2(x, -y), origin[2] + t * dz)


@njit(cache=True)
def in_sight(wall, points, eye):
    """Whether the straight line from each wall point to the eye stays inside the wall."""
    out = np.ones(points.shape[0], dtype=np.bool_)
    smallest = wall.inner_radius * (1.0 - wall.ovality) - CLEARANCE_MM
    for i in range(points.shape[0]):
        away = eye - points[i]
        length = np.sqrt(away[0] ** 2 + away[1] ** 2 + away[2] ** 2)
        t = STEP_MM
        while t < length:
            x, y = points[i, 0] + away[0] * t / length, points[i, 1] + away[1] * t / length
            rho = np.hypot(x, y)
            if rho < smallest:
                break
            if rho > wall_radius_mm(wall, np.arctan2(x, -y), points[i, 2] + away[2] * t / length) + CLEARANCE_MM:
                out[i] = False
                break
            t += STEP_MM
    return out
