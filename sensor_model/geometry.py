"""The mathematics that every room may use: frames, the angle around the wall, cones and the fisheye."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.spatial.transform import Rotation

GRAVITY_M_S2 = 9.80665
TURNS, TURNED_ON = 13, 8
FISHEYE_NEWTON_STEPS = 8
FISHEYE_CLOSE_RAD = 1e-9  # a step as small as this was the last: the next would be its square


def wall_angle_rad(x: np.ndarray | float, y: np.ndarray | float) -> np.ndarray:
    """Angle around the wall in [0, 2 pi): 0 at 12 o'clock, growing clockwise seen along +z (x right, y down)."""
    return np.asarray(np.mod(np.arctan2(x, -np.asarray(y, dtype=float)), 2 * np.pi))


def wall_direction(theta_rad: np.ndarray | float) -> Float[np.ndarray, "*batch 3"]:
    """Unit vector from the pipe's axis towards the wall at an angle around it (inverse of `wall_angle_rad`)."""
    theta = np.asarray(theta_rad, dtype=float)
    return np.stack([np.sin(theta), -np.cos(theta), np.zeros_like(theta)], axis=-1)


def wrap_rad(angle_rad: np.ndarray | float) -> np.ndarray:
    """The same angle in [-pi, pi)."""
    return np.asarray(np.mod(np.asarray(angle_rad, dtype=float) + np.pi, 2 * np.pi) - np.pi)


def clock_position(theta_rad: float) -> str:
    """Angle around the wall as the trade writes it, h:mm (twelve hours are one turn)."""
    minutes = round(float(np.mod(theta_rad, 2 * np.pi)) / (2 * np.pi) * 720) % 720
    return f"{minutes // 60 or 12}:{minutes % 60:02d}"


def turn_of_frame(frame_index: int) -> float:
    """Share of a step (0 to 1) by which the lines of this frame, along which slits are found, are turned clockwise.

    Were they the same in all frames, a robot that runs along the axis would see the wall along them alone, and a
    defect's side would stay hidden between two of them. By Fibonacci's numbers any few frames in succession spread
    their lines evenly; 13 is prime, so every second or tenth frame does, too.
    """
    return TURNED_ON * frame_index % TURNS / TURNS


def transform(
    rotation: Float[np.ndarray, "*batch 3 3"], translation_mm: Float[np.ndarray, "*batch 3"]
) -> Float[np.ndarray, "*batch 4 4"]:
    """Homogeneous `T_a_b` from `R_a_b` and b's origin in a, mm."""
    T_a_b = np.zeros((*rotation.shape[:-2], 4, 4))
    T_a_b[..., :3, :3] = rotation
    T_a_b[..., :3, 3] = translation_mm
    T_a_b[..., 3, 3] = 1.0
    return T_a_b


def inverse(T_a_b: Float[np.ndarray, "*batch 4 4"]) -> Float[np.ndarray, "*batch 4 4"]:
    """`T_b_a` of a rigid `T_a_b`."""
    R_b_a = np.swapaxes(T_a_b[..., :3, :3], -1, -2)
    return transform(R_b_a, -np.einsum("...ij,...j->...i", R_b_a, T_a_b[..., :3, 3]))


def apply(T_a_b: Float[np.ndarray, "4 4"], points_b_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Points given in b's coordinates, in a's."""
    return points_b_mm @ T_a_b[:3, :3].T + T_a_b[:3, 3]


def rotation_from_wxyz(q_wxyz: Float[np.ndarray, "*batch 4"]) -> Float[np.ndarray, "*batch 3 3"]:
    """Rotation matrices from quaternions w, x, y, z; they are normalised first.

    Raises:
        ValueError: where a quaternion has no length.
    """
    return Rotation.from_quat(np.asarray(q_wxyz)[..., [1, 2, 3, 0]]).as_matrix()


def wxyz_from_rotation(rotation: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch 4"]:
    """Quaternions w, x, y, z with w >= 0."""
    return Rotation.from_matrix(rotation).as_quat(canonical=True)[..., [3, 0, 1, 2]]


def twist_about_z_rad(rotation: Float[np.ndarray, "*batch 3 3"]) -> Float[np.ndarray, "*batch"]:
    """Turn about z of a rotation written as swing * twist (exact for any tilt below 180 degrees)."""
    q = wxyz_from_rotation(rotation)
    return wrap_rad(2 * np.arctan2(q[..., 3], q[..., 0]))


def swing_onto(
    direction_from: Float[np.ndarray, "3"], direction_to: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """The smallest rotation that carries one unit vector onto another.

    Raises:
        ValueError: for opposite vectors, which leave the rotation's axis open.
    """
    axis = np.cross(direction_from, direction_to)
    cosine = float(np.dot(direction_from, direction_to))
    if cosine < -1 + 1e-12:
        raise ValueError("opposite directions leave the axis of the smallest rotation open")
    K = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    return np.eye(3) + K + K @ K / (1 + cosine)


def fisheye_project(
    points_camera_mm: Float[np.ndarray, "*batch 3"], intrinsics: Float[np.ndarray, "9"]
) -> Float[np.ndarray, "*batch 2"]:
    """Pixels (u, v) of points in the camera frame, by the Kannala-Brandt model as OpenCV has it.

    Args:
        points_camera_mm: OpenCV camera axes: z forward, x right, y down.
        intrinsics: fx, fy, skew, cx, cy (px), k1 .. k4. The skew multiplies y and adds to u, in px.
    """
    fx, fy, skew, cx, cy, k1, k2, k3, k4 = intrinsics
    x, y, z = np.moveaxis(np.asarray(points_camera_mm, dtype=float), -1, 0)
    rho = np.hypot(x, y)
    theta = np.arctan2(rho, z)
    t2 = theta * theta
    theta_d = theta * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4))))
    scale = np.divide(theta_d, rho, out=np.zeros_like(rho), where=rho > 0)
    return np.stack([fx * scale * x + skew * scale * y + cx, fy * scale * y + cy], axis=-1)


def fisheye_rays(
    pixels: Float[np.ndarray, "*batch 2"], intrinsics: Float[np.ndarray, "9"]
) -> Float[np.ndarray, "*batch 3"]:
    """Unit rays in the camera frame of pixels (u, v): the inverse of `fisheye_project` by Newton's method."""
    flat = np.ascontiguousarray(pixels, dtype=float).reshape(-1, 2)
    return rays_and_angles(flat, intrinsics)[0].reshape(*np.shape(pixels)[:-1], 3)


@njit(cache=True, error_model="numpy", forceinline=True)
def lens_of(intrinsics):
    """The intrinsics as plain numbers, which a loop that writes elsewhere need not read again and again."""
    return (
        intrinsics[0],
        intrinsics[1],
        intrinsics[2],
        intrinsics[3],
        intrinsics[4],
        intrinsics[5],
        intrinsics[6],
        intrinsics[7],
        intrinsics[8],
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def fast_arctan2(y, x):
    """`numpy.arctan2` to its last digits, without a jump: a loop over it is done for several places at a time."""
    ax, ay = abs(x), abs(y)
    small, large = (ay, ax) if ay < ax else (ax, ay)
    steep = small > 0.41421356237309503 * large  # beyond 22.5 degrees, measured from 45
    below = small + large if steep else large
    u = (small - large if steep else small) / (1.0 if below == 0.0 else below)
    z = u * u
    # the rational form of the Cephes library
    over = (((-0.8750608600031904 * z - 16.157537187333652) * z - 75.00855792314705) * z - 122.88666844901361) * z
    under = ((((z + 24.858464901423062) * z + 165.02700983169885) * z + 432.88106049129027) * z + 485.3903996359137) * z
    angle = u + u * z * (over - 64.85021904942025) / (under + 194.5506571482614) + (0.25 * np.pi if steep else 0.0)
    angle = 0.5 * np.pi - angle if ay > ax else angle
    return np.copysign(np.pi - angle if x < 0 else angle, y)


@njit(cache=True, error_model="numpy", forceinline=True)
def _sine_and_cosine(angle):
    """Of an angle from 0 to 90 degrees, to their last digits; several places at a time, as `fast_arctan2`."""
    u = angle - 0.25 * np.pi
    z = u * u
    # Cephes again, about 45 degrees
    s = ((1.58962301576546568e-10 * z - 2.50507477628578072e-8) * z + 2.75573136213857245e-6) * z
    s = ((s - 1.98412698295895385e-4) * z + 8.33333333332211858e-3) * z - 1.66666666666666307e-1
    c = ((-1.13585365213876817e-11 * z + 2.08757008419747316e-9) * z - 2.75573141792967388e-7) * z
    c = ((c + 2.48015872888517045e-5) * z - 1.38888888888730564e-3) * z + 4.16666666666665929e-2
    sine, cosine = u + u * z * s, 1.0 - 0.5 * z + z * z * c
    return np.sqrt(0.5) * (cosine + sine), np.sqrt(0.5) * (cosine - sine)


@njit(cache=True, error_model="numpy", forceinline=True)
def fisheye_pixel(x, y, z, intrinsics):
    """`fisheye_project` of one point, for compiled code."""
    rho = np.sqrt(x * x + y * y)
    theta = fast_arctan2(rho, z)
    t2 = theta * theta
    poly = 1 + t2 * (intrinsics[5] + t2 * (intrinsics[6] + t2 * (intrinsics[7] + t2 * intrinsics[8])))
    scale = theta * poly / rho if rho > 0 else 0.0
    return (
        intrinsics[0] * scale * x + intrinsics[2] * scale * y + intrinsics[3],
        intrinsics[1] * scale * y + intrinsics[4],
    )


@njit(cache=True, error_model="numpy")
def rays_and_angles(pixel, intrinsics):
    """`fisheye_rays` for compiled code: unit rays of (n, 2) pixels, and their angles with the optical axis."""
    fx, fy, skew, cx, cy, k1, k2, k3, k4 = lens_of(intrinsics)
    n = pixel.shape[0]
    slant, theta, sine, rays = np.empty(n), np.empty(n), np.empty(n), np.empty((n, 3))
    for i in range(n):
        y = (pixel[i, 1] - cy) / fy
        x = (pixel[i, 0] - cx - skew * y) / fx
        slant[i] = np.sqrt(x * x + y * y)
        theta[i] = min(slant[i], 0.5 * np.pi)
    # step by step for all pixels at once, which the processor does several at a time
    for _ in range(FISHEYE_NEWTON_STEPS):
        moving = 0
        for i in range(n):
            t2 = theta[i] * theta[i]
            value = theta[i] * (1 + t2 * (k1 + t2 * (k2 + t2 * (k3 + t2 * k4)))) - slant[i]
            change = value / (1 + t2 * (3 * k1 + t2 * (5 * k2 + t2 * (7 * k3 + t2 * 9 * k4))))
            theta[i] -= change
            moving += abs(change) > FISHEYE_CLOSE_RAD
        if moving == 0:
            break
    behind = 0
    for i in range(n):
        sine[i], rays[i, 2] = _sine_and_cosine(theta[i])
        behind += not 0.0 <= theta[i] <= 0.5 * np.pi
    if behind > 0:  # a camera that looks behind itself, and pixels that it cannot see
        for i in range(n):
            sine[i], rays[i, 2] = np.sin(theta[i]), np.cos(theta[i])
    for i in range(n):
        y = (pixel[i, 1] - cy) / fy
        x = (pixel[i, 0] - cx - skew * y) / fx
        scale = sine[i] / slant[i] if slant[i] > 0 else 1.0
        rays[i, 0], rays[i, 1] = x * scale, y * scale
    return rays, theta


def half_angle_rad(
    points_camera_mm: Float[np.ndarray, "*batch 3"], apex_mm: Float[np.ndarray, "3"], axis: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "*batch"]:
    """Angle between the projector's axis and the line from its apex to each point."""
    ray = points_camera_mm - apex_mm
    along = ray @ axis
    across = np.linalg.norm(ray - along[..., None] * axis, axis=-1)
    return np.arctan2(across, along)


def cone_frame(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """`R_camera_projector`: the smallest rotation that carries the camera's z onto the projector's axis."""
    return swing_onto(np.array([0.0, 0.0, 1.0]), axis / np.linalg.norm(axis))


def projector_azimuth_rad(
    points_camera_mm: Float[np.ndarray, "n 3"], T_camera_projector: Float[np.ndarray, "4 4"]
) -> Float[np.ndarray, "n"]:
    """Azimuth of points about the projector's axis in [0, 2 pi): 0 at 12 o'clock, clockwise seen along the axis."""
    x, y, _ = ((points_camera_mm - T_camera_projector[:3, 3]) @ T_camera_projector[:3, :3]).T
    return wall_angle_rad(x, y)


def jag_rad(
    table_rad: Float[np.ndarray, "slits cells"], slit: Int[np.ndarray, "n"], azimuth_rad: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """The slide's jaggedness at points, linear between the middles of a table's cells."""
    cells = table_rad.shape[1]
    place = np.mod(azimuth_rad / (2 * np.pi) * cells - 0.5, cells)
    low = np.floor(place).astype(np.int64) % cells
    part = place - np.floor(place)
    return (1 - part) * table_rad[slit, low] + part * table_rad[slit, (low + 1) % cells]
