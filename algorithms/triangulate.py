"""Triangulation: where the camera's ray through a slit pixel meets that slit's cone of light."""

from __future__ import annotations

import numpy as np
from numba import njit

from algorithms.types import RingPoints
from sensor_model.geometry import FISHEYE_NEWTON_STEPS
from sensor_model.recording import SlitPixels
from sensor_model.rig import Rig

HALF_STEP_PX = 0.5


def triangulate(seen: SlitPixels, rig: Rig) -> RingPoints:
    """Slit pixels to wall points in the camera frame; a ray that misses its cone gives no point.

    The standard deviation comes from the movement of the point as the pixel moves across the slit: it slides along
    the light ray.
    """
    projector = rig.projector
    axis = projector.T_camera_projector[:3, 2].copy()
    cosines = np.cos(projector.slit_half_angles_rad)
    apex = np.array(projector.apex_mm)
    xyz, slide = _triangulate(seen.pixel, seen.slit, rig.camera.intrinsics, apex, axis, cosines)
    hit = np.isfinite(slide)
    xyz, light = xyz[hit], xyz[hit] - apex
    light /= np.linalg.norm(light, axis=1, keepdims=True)
    return RingPoints(xyz, seen.slit[hit], seen.pixel[hit], light, seen.sigma_px[hit] * slide[hit])


@njit(cache=True)
def _triangulate(pixel, slit, intrinsics, apex, axis, cosines):
    """Points and how far each slides, mm, as its pixel moves outward by one pixel; NaN where there is none."""
    n = pixel.shape[0]
    xyz, slide = np.full((n, 3), np.nan), np.full(n, np.nan)
    center_u, center_v = intrinsics[3], intrinsics[4]
    for i in range(n):
        du, dv = pixel[i, 0] - center_u, pixel[i, 1] - center_v
        off = np.sqrt(du * du + dv * dv)
        if off < 1.0:
            continue
        du, dv = du / off * HALF_STEP_PX, dv / off * HALF_STEP_PX
        cosine = cosines[slit[i]]
        here = _on_cone(pixel[i, 0], pixel[i, 1], intrinsics, apex, axis, cosine)
        inward = _on_cone(pixel[i, 0] - du, pixel[i, 1] - dv, intrinsics, apex, axis, cosine)
        outward = _on_cone(pixel[i, 0] + du, pixel[i, 1] + dv, intrinsics, apex, axis, cosine)
        for k in range(3):
            xyz[i, k] = here[k]
        slide[i] = np.sqrt(
            (outward[0] - inward[0]) ** 2 + (outward[1] - inward[1]) ** 2 + (outward[2] - inward[2]) ** 2
        )
    return xyz, slide


@njit(cache=True)
def _on_cone(u, v, intrinsics, apex, axis, cosine):
    """Where one pixel's ray leaves the cone, NaN where it never does."""
    wx, wy, wz = _ray(u, v, intrinsics)
    w_a = wx * axis[0] + wy * axis[1] + wz * axis[2]
    apex_a = apex[0] * axis[0] + apex[1] * axis[1] + apex[2] * axis[2]
    w_apex = wx * apex[0] + wy * apex[1] + wz * apex[2]
    apex2 = apex[0] ** 2 + apex[1] ** 2 + apex[2] ** 2
    c2 = cosine * cosine
    # ((t w - A) . a)^2 = cos^2 |t w - A|^2; the camera sits inside the cone, so one root lies ahead
    a = w_a * w_a - c2
    b = -2.0 * (w_a * apex_a - c2 * w_apex)
    c = apex_a * apex_a - c2 * apex2
    root = b * b - 4.0 * a * c
    if a >= 0.0 or root < 0.0:
        return np.nan, np.nan, np.nan
    t = (-b - np.sqrt(root)) / (2.0 * a)
    if t <= 0.0 or t * w_a - apex_a <= 0.0:
        return np.nan, np.nan, np.nan
    return t * wx, t * wy, t * wz


@njit(cache=True)
def _ray(u, v, intrinsics):
    """Unit ray of one pixel: `geometry.fisheye_rays` for compiled code."""
    fx, fy, skew, cx, cy, k1, k2, k3, k4 = intrinsics
    y = (v - cy) / fy
    x = (u - cx - skew * y) / fx
    theta_d = np.sqrt(x * x + y * y)
    if theta_d == 0.0:
        return 0.0, 0.0, 1.0
    theta = min(theta_d, 0.5 * np.pi)
    for _ in range(FISHEYE_NEWTON_STEPS):
        t2 = theta * theta
        value = theta * (1.0 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) - theta_d
        slope = 1.0 + t2 * (3.0 * k1 + t2 * (5.0 * k2 + t2 * (7.0 * k3 + t2 * 9.0 * k4)))
        theta -= value / slope
        if abs(value) < 1e-14:
            break
    scale = np.sin(theta) / theta_d
    return x * scale, y * scale, np.cos(theta)
