"""The drawn picture without GL: every pixel's ray followed to the exact wall, and from there to the projector."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba import njit

from sensor_model.camera_rays import camera_rays
from sensor_model.optics import Optics, light
from sensor_model.rig import Rig
from sensor_model.spot import aim, light_spot
from sensor_model.wall_rays import (
    inward_normal,
    is_bent,
    is_hole,
    near_wall,
    point_at,
    point_in_shadow,
    stretch_mm,
    wall_range_mm,
)
from sensor_model.water import mirrored_place, mirrored_way
from sensor_model.ways import (
    Sight,
    change_under,
    ghost_to,
    in_housing,
    is_under,
    path_by_water,
    path_to,
    range_to_pool,
    reaches_water,
    sight_along,
    sight_by_mirror,
    sight_under,
    turned,
    view_of,
    weakened,
)
from twin.pipe import Pipe


def draw(pipe: Pipe, T_pipe_camera: Float[np.ndarray, "4 4"], rig: Rig, optics: Optics) -> Float[np.ndarray, "h w 3"]:
    """The direct picture in linear light, float32 RGB; 1 is a white wall at the reference distance, lit head-on.

    Args:
        pipe: What is looked at.
        T_pipe_camera: Camera pose, mm.
        rig: The true camera and projector.
        optics: The settings that act on the wall; those of lens and chip are left to `expose`.

    Raises:
        ValueError: when the camera or the projector's apex lies outside the bore, or in the water.
    """
    view = view_of(pipe, T_pipe_camera, rig, optics.glass, optics.water)
    wall = near_wall(pipe, float(T_pipe_camera[2, 3]))
    rays = camera_rays(rig.camera)
    picture = np.zeros(rays.shape, dtype=np.float32)
    _draw(wall, view, light(rig.projector, optics), rig.projector.printed_jag_rad, rays, picture)
    return picture


@njit(cache=True, error_model="numpy")
def _draw(wall, view, beam, jag_table_rad, rays, picture):
    height, width, _ = rays.shape
    for row in range(height):
        up, below = max(row - 1, 0), min(row + 1, height - 1)
        for col in range(width):
            direction = turned(view.R_pipe_camera, rays[row, col, 0], rays[row, col, 1], rays[row, col, 2])
            first = sight_along(view, direction)
            pool_mm = range_to_pool(wall, view, first)
            for way in range(1 if pool_mm < 0 else 2):  # a sight that meets water goes on by its mirror, and in it
                sight = first
                if pool_mm >= 0:
                    sight = sight_by_mirror(view, first, pool_mm) if way == 0 else sight_under(view, first, pool_mm)
                s = _hit(wall, view, beam, sight)
                if s < 0:
                    continue
                point = point_at(sight.start, sight.direction, s)
                normal = inward_normal(wall, point)
                right = _ray_change(view, rays, row, max(col - 1, 0), row, min(col + 1, width - 1))
                down = _ray_change(view, rays, up, col, below, col)
                if pool_mm >= 0 and way == 0:
                    right, down = mirrored_way(view.surface, right), mirrored_way(view.surface, down)
                elif pool_mm >= 0:
                    right = change_under(view, first, sight, s, right)
                    down = change_under(view, first, sight, s, down)
                    sight = weakened(view, sight, s)
                path, under = path_to(view, point), is_under(view, point)
                spot = aim(view, beam, path, sight, s, right, down, point, normal)
                if spot.level > 0 and _arrives(wall, view, beam, path, point, under):
                    light_spot(picture[row, col], beam, jag_table_rad, spot)
                if view.tube.ghost > 0 and not under:
                    spot = aim(view, beam, ghost_to(view, point), sight, s, right, down, point, normal)
                    light_spot(picture[row, col], beam, jag_table_rad, spot)
                if view.surface.is_there and not under:
                    path = path_by_water(view, point)
                    spot = _aim_by_water(view, beam, path, sight, s, right, down, point, normal)
                    if spot.level > 0 and _arrives(wall, view, beam, path, point, True):
                        light_spot(picture[row, col], beam, jag_table_rad, spot)


@njit(cache=True, error_model="numpy", forceinline=True)
def _arrives(wall, view, beam, path, point, by_water):
    """Whether neither housing nor wall stops the light on its way to a place."""
    if by_water and not reaches_water(wall, view.apex, path.source):
        return False
    return not (in_housing(view, beam, path.aimed) or point_in_shadow(wall, point, path.source))


@njit(cache=True, error_model="numpy", forceinline=True)
def _aim_by_water(view, beam, path, sight, range_mm, right, down, point, normal):
    """`aim` in the mirror: all but camera and projector seem to be on the water's other side."""
    surface = view.surface
    mirrored = Sight(sight.start, mirrored_way(surface, sight.direction), sight.before_mm, sight.passed)
    return aim(
        view,
        beam,
        path,
        mirrored,
        range_mm,
        mirrored_way(surface, right),
        mirrored_way(surface, down),
        mirrored_place(surface, point),
        mirrored_way(surface, normal),
    )


@njit(cache=True, error_model="numpy")
def _ray_change(view, rays, row_a, col_a, row_b, col_b):
    """How a ray's direction changes from pixel to pixel."""
    steps = row_b - row_a + col_b - col_a
    x = (rays[row_b, col_b, 0] - rays[row_a, col_a, 0]) / steps
    y = (rays[row_b, col_b, 1] - rays[row_a, col_a, 1]) / steps
    z = (rays[row_b, col_b, 2] - rays[row_a, col_a, 2]) / steps
    return turned(view.R_pipe_camera, x, y, z)


@njit(cache=True, error_model="numpy", forceinline=True)
def _hit(wall, view, beam, sight):
    """Range to the first crossing of the wall, mm; -1 where no light can come from."""
    eye, direction = sight.start, sight.direction
    first, last = stretch_mm(wall, eye, direction)
    if first < 0:
        return -1.0
    t_first = _half_angle_tangent(view, point_at(eye, direction, first))
    t_last = _half_angle_tangent(view, point_at(eye, direction, last))
    unlit = max(t_first, t_last) < beam.lit_from[0] * 0.98 or min(t_first, t_last) > beam.lit_to[-1] * 1.02
    if unlit and not (view.tube.is_there or view.surface.is_there or is_bent(wall)):  # by which light goes anywhere
        return -1.0
    range_mm = wall_range_mm(wall, eye, direction, first, last)
    point = point_at(eye, direction, range_mm)
    if point[2] < view.start or point[2] > view.end:
        return -1.0
    if not view.backed and is_hole(wall, point[0], point[1]):
        return -1.0
    return range_mm


@njit(cache=True, error_model="numpy", forceinline=True)
def _half_angle_tangent(view, point):
    axis = view.R_projector_pipe[2]
    x, y, z = point[0] - view.apex[0], point[1] - view.apex[1], point[2] - view.apex[2]
    along = x * axis[0] + y * axis[1] + z * axis[2]
    if along <= 0:
        return 1e9
    return np.sqrt(max(x * x + y * y + z * z - along * along, 0.0)) / along
