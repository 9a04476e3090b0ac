"""The glass tube around the sensor: how it bends, weakens and mirrors light on its way out and back in."""

from __future__ import annotations

from functools import lru_cache
from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float
from numba import njit
from pydantic import Field, model_validator

from sensor_model.geometry import cone_frame
from sensor_model.rig import Rig
from sensor_model.settings import Settings
from twin.pipe import Pipe

ORIGIN = (0.0, 0.0, 0.0)  # of the camera frame: where the camera is
ALONG_AXIS = 1e-10  # square of the share across the tube's axis below which light is taken to miss the glass
TOWARDS_STEPS = 5  # each takes the miss below a tenth of what it was
INSIDE_MM = 0.5


class Glass(Settings):
    """A round tube about camera and projector, as long as light needs it; without thickness there is none.

    `offset_mm` and `tilt_deg` (x and y) place its axis against the camera's, at the camera. `ghost` is how much of what
    bare glass mirrors across the tube is let through: 1 is uncoated, 0 leaves the ghosts out.
    """

    thickness_mm: Annotated[float, Field(ge=0, le=10)] = 0.0
    inner_radius_mm: Annotated[float, Field(gt=0, le=200)] = 24.0
    index: Annotated[float, Field(gt=1, le=2.5)] = 1.5
    offset_mm: tuple[float, float] = (0.0, 0.0)
    tilt_deg: tuple[Annotated[float, Field(ge=-10, le=10)], Annotated[float, Field(ge=-10, le=10)]] = (0.0, 0.0)
    ghost: Annotated[float, Field(ge=0, le=1)] = 1.0

    @model_validator(mode="after")
    def _holds_the_camera(self) -> Glass:
        if self.thickness_mm > 0 and not np.hypot(*self.offset_mm) < self.inner_radius_mm - INSIDE_MM:
            raise ValueError(f"offset_mm must keep the camera inside inner_radius_mm, {self.inner_radius_mm:g}")
        return self


class Tube(NamedTuple):
    """The tube as compiled code reads it; rows of `axes` are its own axes in the camera frame, z along it."""

    axes: tuple[tuple[float, ...], ...]
    center: tuple[float, ...]  # a place of its axis, camera frame
    inner: float
    outer: float
    refraction: float
    ghost: float
    is_there: bool


@lru_cache(maxsize=8)
def tube_of(glass: Glass) -> Tube:
    """The tube in the camera frame."""
    slope = np.tan(np.radians(glass.tilt_deg))
    axes = cone_frame(np.array([slope[0], slope[1], 1.0])).T
    return Tube(
        tuple(tuple(row) for row in axes.tolist()),
        (*glass.offset_mm, 0.0),
        glass.inner_radius_mm,
        glass.inner_radius_mm + glass.thickness_mm,
        glass.index,
        glass.ghost if glass.thickness_mm > 0 else 0.0,
        glass.thickness_mm > 0,
    )


def check_inside(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, glass: Glass) -> None:
    """See that camera and projector are in the pipe, and in the glass tube if there is one.

    Raises:
        ValueError: when the camera or the projector's apex lies outside the bore or the tube.
    """
    apex = (T_pipe_camera @ rig.projector.T_camera_projector)[:3, 3]
    for name, place in (("camera", T_pipe_camera[:3, 3]), ("projector", apex)):
        offset = np.hypot(place[0], place[1])
        if not offset < pipe.wall.smallest_radius:
            raise ValueError(
                f"the {name} is {offset:.1f} mm off the axis, outside the bore of {pipe.bore_radius_mm:.1f} mm"
            )
    x, y, _ = np.array(tube_of(glass).axes) @ (np.array(rig.projector.apex_mm) - tube_of(glass).center)
    off = np.hypot(x, y)
    if glass.thickness_mm > 0 and off > glass.inner_radius_mm - INSIDE_MM:
        raise ValueError(
            f"the projector is {off:.1f} mm off the glass tube's axis, outside {glass.inner_radius_mm:g} mm"
        )


@njit(cache=True, error_model="numpy")
def through(tube, origin, direction):
    """Where a ray from inside leaves the glass, its direction from there on, and the share of light that passes.

    All in the camera frame, directions of length 1. A ray along the axis goes on as it is.
    """
    place, onward, passed = _traced(tube, _to_tube(tube, origin, True), _to_tube(tube, direction, False))
    return _from_tube(tube, place, True), _from_tube(tube, onward, False), passed


@njit(cache=True, error_model="numpy")
def towards(tube, origin, point):
    """Which way light has to leave a place inside to arrive at a point outside: direction, exit, share that passes.

    The apparent origin of light hardly depends on its direction, so aiming again by what the last aim missed settles.
    """
    o, p = _to_tube(tube, origin, True), _to_tube(tube, point, True)
    aim = _unit(p[0] - o[0], p[1] - o[1], p[2] - o[2])
    place, onward, passed = _traced(tube, o, aim)
    for _ in range(TOWARDS_STEPS):
        x, y, z = place[0] - o[0], place[1] - o[1], place[2] - o[2]
        back = np.sqrt(x * x + y * y + z * z)
        want = _unit(
            p[0] - place[0] + back * onward[0],
            p[1] - place[1] + back * onward[1],
            p[2] - place[2] + back * onward[2],
        )
        aim = _unit(aim[0] + want[0] - onward[0], aim[1] + want[1] - onward[1], aim[2] + want[2] - onward[2])
        place, onward, passed = _traced(tube, o, aim)
    return _from_tube(tube, aim, False), _from_tube(tube, place, True), passed


@njit(cache=True, error_model="numpy")
def beyond(tube, origin, rays):
    """Of (n, 3) rays from inside: where each leaves the glass, and which way it goes on."""
    starts, onward = np.empty_like(rays), np.empty_like(rays)
    for i in range(rays.shape[0]):
        start, direction, _ = through(tube, origin, (rays[i, 0], rays[i, 1], rays[i, 2]))
        starts[i, 0], starts[i, 1], starts[i, 2] = start
        onward[i, 0], onward[i, 1], onward[i, 2] = direction
    return starts, onward


@njit(cache=True, error_model="numpy")
def aimed_at(tube, origin, points):
    """Of (n, 3) points outside: the places at the same distance that they seem to be at from inside."""
    out = np.empty_like(points)
    for i in range(points.shape[0]):
        point = (points[i, 0], points[i, 1], points[i, 2])
        out[i, 0], out[i, 1], out[i, 2] = seems_at(origin, point, towards(tube, origin, point)[0])
    return out


@njit(cache=True, error_model="numpy")
def seems_at(origin, point, direction):
    """The place at a point's distance in a direction."""
    x, y, z = point[0] - origin[0], point[1] - origin[1], point[2] - origin[2]
    length = np.sqrt(x * x + y * y + z * z)
    return (origin[0] + length * direction[0], origin[1] + length * direction[1], origin[2] + length * direction[2])


@njit(cache=True, error_model="numpy")
def mirrored(tube, origin, point):
    """How a point outside is lit by way of the far side of the tube: where it seems to be, whence it is lit, the share.

    The tube is unfolded at the mirror: right for one about the origin, and within its decentring otherwise.
    """
    o, p = _to_tube(tube, origin, True), _to_tube(tube, point, True)
    rho = np.sqrt(p[0] * p[0] + p[1] * p[1])
    over = -(rho + 2.0 * tube.inner) / rho
    x, y = over * p[0], over * p[1]
    across, along = np.sqrt((x - o[0]) ** 2 + (y - o[1]) ** 2), p[2] - o[2]
    cosine = across / np.sqrt(across * across + along * along)
    whence = (p[0] - across * p[0] / rho, p[1] - across * p[1] / rho, o[2])
    once = reflected(cosine, 1.0 / tube.refraction)
    both = 2.0 * once / (1.0 + once)  # of both surfaces, to and fro within the glass
    seems = _from_tube(tube, (x, y, p[2]), True)
    return seems, _from_tube(tube, whence, True), tube.ghost * both * (1.0 - both)


@njit(cache=True, error_model="numpy")
def _traced(tube, origin, direction):
    """`through` in the tube's own frame."""
    if direction[0] ** 2 + direction[1] ** 2 < ALONG_AXIS:
        return origin, direction, 0.0
    first = _leave(origin, direction, tube.inner)
    inside, passed_in = _bent(direction, first[0] / tube.inner, first[1] / tube.inner, 1.0 / tube.refraction)
    last = _leave(first, inside, tube.outer)
    onward, passed_out = _bent(inside, last[0] / tube.outer, last[1] / tube.outer, tube.refraction)
    return last, onward, passed_in * passed_out


@njit(cache=True, error_model="numpy", forceinline=True)
def _leave(origin, direction, radius):
    """Where a ray from inside a cylinder about z leaves it."""
    a = direction[0] ** 2 + direction[1] ** 2
    b = origin[0] * direction[0] + origin[1] * direction[1]
    c = origin[0] ** 2 + origin[1] ** 2 - radius**2
    s = (-b + np.sqrt(b * b - a * c)) / a
    return (origin[0] + s * direction[0], origin[1] + s * direction[1], origin[2] + s * direction[2])


@njit(cache=True, error_model="numpy", forceinline=True)
def _bent(direction, nx, ny, eta):
    """Snell's law at a surface whose normal (nx, ny, 0) the light follows, and the share that passes (Fresnel)."""
    cosine = direction[0] * nx + direction[1] * ny
    inside2 = 1.0 - eta * eta * (1.0 - cosine * cosine)
    if inside2 <= 0.0:  # mirrored wholly
        return direction, 0.0
    along = np.sqrt(inside2) - eta * cosine
    bent = (eta * direction[0] + along * nx, eta * direction[1] + along * ny, eta * direction[2])
    return bent, 1.0 - reflected(cosine, eta)


@njit(cache=True, error_model="numpy", forceinline=True)
def reflected(cosine, eta):
    """Fresnel's share of unpolarised light that a surface mirrors; `eta` is the index before over that behind."""
    behind = np.sqrt(max(1.0 - eta * eta * (1.0 - cosine * cosine), 0.0))
    across = (eta * cosine - behind) / (eta * cosine + behind)
    along = (cosine - eta * behind) / (cosine + eta * behind)
    return 0.5 * (across * across + along * along)


@njit(cache=True, error_model="numpy", forceinline=True)
def _unit(x, y, z):
    length = np.sqrt(x * x + y * y + z * z)
    return (x / length, y / length, z / length)


@njit(cache=True, error_model="numpy", forceinline=True)
def _to_tube(tube, v, is_place):
    R, c = tube.axes, tube.center
    x, y, z = (v[0] - c[0], v[1] - c[1], v[2] - c[2]) if is_place else (v[0], v[1], v[2])
    return (
        R[0][0] * x + R[0][1] * y + R[0][2] * z,
        R[1][0] * x + R[1][1] * y + R[1][2] * z,
        R[2][0] * x + R[2][1] * y + R[2][2] * z,
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def _from_tube(tube, v, is_place):
    R, c = tube.axes, tube.center
    x = R[0][0] * v[0] + R[1][0] * v[1] + R[2][0] * v[2]
    y = R[0][1] * v[0] + R[1][1] * v[1] + R[2][1] * v[2]
    z = R[0][2] * v[0] + R[1][2] * v[1] + R[2][2] * v[2]
    return (x + c[0], y + c[1], z + c[2]) if is_place else (x, y, z)
