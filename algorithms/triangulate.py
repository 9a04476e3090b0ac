"""Triangulation: where the camera's ray through a slit pixel meets that slit's cone of light."""

from __future__ import annotations

from dataclasses import fields
from functools import lru_cache

import numpy as np
from numba import njit

from algorithms.types import RingPoints
from sensor_model.geometry import jag_rad, lens_of, projector_azimuth_rad, rays_and_angles
from sensor_model.recording import SlitPixels
from sensor_model.rig import Projector, Rig

NEAREST_PX = 1.0  # nearer to the picture's centre, outward is no direction


def triangulate(seen: SlitPixels, rig: Rig) -> RingPoints:
    """Slit pixels to wall points in the camera frame; a ray that misses its cone gives no point.

    The standard deviation comes from the movement of the point as the pixel moves across the slit: it slides along
    the light ray.
    """
    if any(slit.apex_mm for slit in rig.projector.slits):
        return _slit_by_slit(seen, rig)
    projector, intrinsics = rig.projector, rig.camera.intrinsics
    axis = tuple(projector.T_camera_projector[:3, 2].tolist())
    rays, angles = rays_and_angles(seen.pixel, intrinsics)
    half_rad = projector.slit_half_angles_rad
    cosine2 = (np.cos(half_rad) ** 2)[seen.slit]
    ends = _on_cones(seen.pixel, cosine2, rays, angles, intrinsics, projector.apex_mm, axis)
    if projector.jag_table_rad.size:
        # the azimuth on the slide hardly depends on which cone the point is thought to lie on
        azimuth_rad = projector_azimuth_rad(np.nan_to_num(ends[:, :1]) * rays, projector.T_camera_projector)
        jagged_rad = half_rad[seen.slit] + jag_rad(projector.jag_table_rad, seen.slit, azimuth_rad)
        ends = _on_cones(seen.pixel, np.cos(jagged_rad) ** 2, rays, angles, intrinsics, projector.apex_mm, axis)
    return RingPoints(*_points(seen.pixel, seen.slit, seen.sigma_px, rays, ends, projector.apex_mm))


def _slit_by_slit(seen: SlitPixels, rig: Rig) -> RingPoints:
    """`triangulate` where slits have apexes of their own; what was sorted by slit stays so."""
    parts = []
    for slit, projector in enumerate(_apart(rig.projector)):
        mine = seen.slit == slit
        one = SlitPixels(seen.pixel[mine], seen.slit[mine], seen.sigma_px[mine])
        parts.append(triangulate(one, rig.model_copy(update={"projector": projector})))
    return RingPoints(*(np.concatenate([getattr(part, f.name) for part in parts]) for f in fields(RingPoints)))


@lru_cache(maxsize=4)
def _apart(projector: Projector) -> tuple[Projector, ...]:
    return tuple(projector.of_slit(slit) for slit in range(len(projector.slits)))


@njit(cache=True, error_model="numpy")
def _on_cones(pixel, cosine2, rays, angles, intrinsics, apex, axis):
    """Range at which each ray leaves its cone, and how far that place slides, mm, as its pixel moves outward by one.

    NaN where a ray never leaves its cone. The slide is the derivative at the pixel, not a difference over one.
    """
    ends = np.empty((cosine2.size, 2))  # one array: of more, each would be guarded against lying over the others
    apex_a = apex[0] * axis[0] + apex[1] * axis[1] + apex[2] * axis[2]
    apex2 = apex[0] ** 2 + apex[1] ** 2 + apex[2] ** 2
    lens = lens_of(intrinsics)
    for i in range(cosine2.size):
        c2 = cosine2[i]
        wx, wy, wz = rays[i, 0], rays[i, 1], rays[i, 2]
        w_a = wx * axis[0] + wy * axis[1] + wz * axis[2]
        w_apex = wx * apex[0] + wy * apex[1] + wz * apex[2]
        # ((t w - A) . a)^2 = cos^2 |t w - A|^2; the camera sits inside the cone, so one root lies ahead
        a = w_a * w_a - c2
        b = -2.0 * (w_a * apex_a - c2 * w_apex)
        root = np.sqrt(b * b - 4.0 * a * (apex_a * apex_a - c2 * apex2))
        t = (-b - root) / (2.0 * a)
        du, dv = pixel[i, 0] - lens[3], pixel[i, 1] - lens[4]
        dx, dy, dz = _turned_outward(du, dv, wx, wy, wz, angles[i], lens)
        d_a = dx * axis[0] + dy * axis[1] + dz * axis[2]
        d_apex = dx * apex[0] + dy * apex[1] + dz * apex[2]
        # the same equation, differentiated by the pixel's movement
        dt = (2.0 * w_a * d_a * t * t - 2.0 * (d_a * apex_a - c2 * d_apex) * t) / root
        # false for NaN too: a negative root; and no jump, so that several are done at a time
        hit = (a < 0.0) & (root > 0.0) & (t > 0.0) & (t * w_a > apex_a) & (du * du + dv * dv >= NEAREST_PX**2)
        ends[i, 0] = t if hit else np.nan
        ends[i, 1] = np.sqrt((dt * wx + t * dx) ** 2 + (dt * wy + t * dy) ** 2 + (dt * wz + t * dz) ** 2)
    return ends


@njit(cache=True, error_model="numpy", forceinline=True)
def _turned_outward(du, dv, wx, wy, wz, angle, lens):
    """Change of a unit ray as its pixel moves away from the picture's centre, by one pixel."""
    fx, fy, skew, _, _, k1, k2, k3, k4 = lens
    off = np.sqrt(du * du + dv * dv)
    y = dv / fy
    x = (du - skew * y) / fx
    slant2 = x * x + y * y
    # (x, y) grows by its (off)th part: the ray turns outward, and does not turn about the optical axis
    t2 = angle * angle
    slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
    turn, sine = np.sqrt(slant2) / off / slope, np.sqrt(wx * wx + wy * wy)
    return turn * wz * wx / sine, turn * wz * wy / sine, -turn * sine


@njit(cache=True, error_model="numpy")
def _points(pixel, slit, sigma_px, rays, ends, apex):
    """The arrays of `RingPoints`, in its order, of those rays that leave their cone."""
    hit = np.isfinite(ends[:, 0])
    n = np.count_nonzero(hit)
    xyz, light, sigma_mm = np.empty((n, 3)), np.empty((n, 3)), np.empty(n)
    k = 0
    for i in range(slit.size):
        if not hit[i]:
            continue
        x, y, z = ends[i, 0] * rays[i, 0], ends[i, 0] * rays[i, 1], ends[i, 0] * rays[i, 2]
        length = np.sqrt((x - apex[0]) ** 2 + (y - apex[1]) ** 2 + (z - apex[2]) ** 2)
        xyz[k, 0], xyz[k, 1], xyz[k, 2] = x, y, z
        light[k, 0], light[k, 1], light[k, 2] = (x - apex[0]) / length, (y - apex[1]) / length, (z - apex[2]) / length
        sigma_mm[k] = sigma_px[i] * ends[i, 1]
        k += 1
    if n == slit.size:
        return xyz, slit, pixel, light, sigma_mm
    return xyz, slit[hit], pixel[hit], light, sigma_mm
