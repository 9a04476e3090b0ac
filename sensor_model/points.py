"""The cheap fidelity: slit pixels straight from the wall radius, without drawing a picture."""

from __future__ import annotations

from functools import cache, lru_cache
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from pydantic import BeforeValidator, Field

from sensor_model.bent_light import seen_ends
from sensor_model.geometry import TURNS, fisheye_pixel, jag_rad, lens_of, turn_of_frame, wrap_rad
from sensor_model.glass import ORIGIN, Glass
from sensor_model.recording import SlitPixels
from sensor_model.rig import Projector, Rig, load_settings
from sensor_model.settings import Settings
from sensor_model.slide_print import slit_shifts
from sensor_model.wall_rays import in_shadow, is_hole, near_wall, point_at, wall_ranges_mm
from sensor_model.water import Water
from sensor_model.ways import View, view_of
from twin.pipe import Pipe

NOISES = Path(__file__).parent / "point_noises"
LEAST_SIGMA_PX = 0.01
NO_GLASS, NO_WATER = Glass(), Water()
Each = Annotated[tuple[Annotated[float, Field(ge=-5, le=5)], ...], Field(max_length=64)]


class PointNoise(Settings):
    """What stands for the picture's errors; every one has a zero.

    The last four are for a noise measured in pictures, a number a slit; left empty they change nothing.
    """

    azimuths: Annotated[int, Field(ge=36, le=7200)] = 720
    pixel_noise_px: Annotated[float, Field(ge=0)] = 0.25
    drop_out_share: Annotated[float, Field(ge=0, lt=1)] = 0.02
    slide_jag_deg: Annotated[float, Field(ge=0, le=2)] = 0.0
    """Largest shift of a slit's edges by the slide's print, which is the drawn picture's own, azimuth by azimuth."""
    slide_jag_cells: Annotated[int, Field(ge=16, le=4096)] = 1024
    slit_noise_px: Each = ()
    """Noise slit by slit, in place of `pixel_noise_px`."""
    slit_bias_px: Each = ()
    """How much further out a slit is found than it is."""
    slit_drop_out_share: Each = ()
    """Drop-outs slit by slit, in place of `drop_out_share`."""
    slit_sigma_px: Each = ()
    """What the decoder says of itself, slit by slit; else it is the noise."""

    def of_slits(self, slits: int) -> tuple[Float[np.ndarray, "slits"], ...]:
        """Noise, bias, drop-out share and stated standard deviation of every slit.

        Raises:
            ValueError: when a list has another length than the rig has slits.
        """
        same = {"slit_noise_px": self.pixel_noise_px, "slit_bias_px": 0.0, "slit_drop_out_share": self.drop_out_share}
        found: list[np.ndarray] = []
        for name, one in (*same.items(), ("slit_sigma_px", None)):
            each = getattr(self, name)
            if each and len(each) != slits:
                raise ValueError(f"sensing.points.{name}: got {len(each)} values; the rig has {slits} slits")
            found.append(np.array(each) if each else np.full(slits, one) if one is not None else found[0])
        return tuple(found)


def measured_noises() -> dict[str, Path]:
    """The files of measured noise, by name."""
    return {path.stem: path for path in sorted(NOISES.glob("*.yaml"))}


@cache
def point_noise(name: str) -> PointNoise:
    """The noise of `points` as measured in pictures of one kind, by the name of their optics.

    Raises:
        ValueError: for another name.
    """
    known = measured_noises()
    if name not in known:
        raise ValueError(f"no noise is called {name!r}; there are {', '.join(known)}")
    return load_settings(PointNoise, known[name])


def _by_name(value: Any) -> Any:
    return point_noise(value) if isinstance(value, str) else value


AnyPointNoise = Annotated[PointNoise, BeforeValidator(_by_name, json_schema_input_type=str | PointNoise)]


class Fan(NamedTuple):
    """The light that leaves the sensor, in the camera frame: rays of all slits that neither strut nor housing stops.

    `place` counts all rays, stopped or not, so that what is drawn for a place does not depend on what stops others.
    """

    slit: Int[np.ndarray, "n"]
    place: Int[np.ndarray, "n"]
    rays_camera: Float[np.ndarray, "n 3"]
    places: int


@lru_cache(maxsize=2 * TURNS)
def fan(projector: Projector, azimuths: int, jag_deg: float = 0.0, jag_cells: int = 1024, turn: float = 0.0) -> Fan:
    """Each slit's centre line, with the slide's jaggedness, followed at equal steps around the projector's axis.

    The first ray lies `turn` steps clockwise of 12 o'clock. Jaggedness is the rig's own, and beyond it the drawn
    slide's print where `jag_deg` says how large.
    """
    around = (np.arange(azimuths) + turn) * 2 * np.pi / azimuths
    slit, azimuth = (grid.ravel() for grid in np.meshgrid(np.arange(len(projector.slits)), around, indexing="ij"))
    alpha = projector.slit_half_angles_rad[slit]
    if projector.jag_table_rad.size:
        alpha = alpha + jag_rad(projector.printed_jag_rad, slit, azimuth)
    if jag_deg > 0:
        alpha = alpha + np.radians(jag_deg) * slit_shifts(slit, azimuth, jag_cells)
    rays = np.stack([np.sin(alpha) * np.sin(azimuth), -np.sin(alpha) * np.cos(azimuth), np.cos(alpha)], axis=-1)
    rays_camera = rays @ projector.T_camera_projector[:3, :3].T
    # the strut's soft edge passes half the light at its stated width
    from_strut = np.abs(wrap_rad(azimuth - np.radians(projector.strut_clock_deg)))
    apex = np.array(projector.apex_mm)
    at_camera = apex[:2] - rays_camera[:, :2] * (apex[2] / rays_camera[:, 2:])  # where it passes the camera's housing
    free = (from_strut > np.radians(projector.strut_width_deg) / 2) & (
        np.linalg.norm(at_camera, axis=1) > projector.housing_radius_mm
    )
    return Fan(slit[free], np.flatnonzero(free), rays_camera[free], slit.size)


def see_slits(
    pipe: Pipe,
    T_pipe_camera: Float[np.ndarray, "4 4"],
    rig: Rig,
    noise: PointNoise,
    rng: np.random.Generator,
    glass: Glass = NO_GLASS,
    water: Water = NO_WATER,
    frame_index: int = 0,
) -> SlitPixels:
    """Where the camera sees each slit: light from the apex to its first wall point, and from there to the camera.

    As by the decoder, slits are found along lines that turn from frame to frame (`turn_of_frame`).

    Lost: the strut's sector, what the rim of a defect hides from projector or camera, holes, what falls outside the
    picture, and drop-outs. A glass tube bends the light on both ways, and so does standing water, of which only what
    is seen through its surface is delivered: no mirror images, and none of the tube's ghosts.

    Raises:
        ValueError: when there is glass or water and the sensor does not fit into the one, or is in the other.
    """
    turn, camera = turn_of_frame(frame_index), rig.camera
    light = fan(rig.projector, noise.azimuths, noise.slide_jag_deg, noise.slide_jag_cells, turn)
    noise_px, bias_px, drop_out_share, sigma_px = noise.of_slits(len(rig.projector.slits))
    of_place = np.repeat(np.arange(noise_px.size), noise.azimuths)
    # drawn for all, so that draws do not depend on sight
    kept = rng.random(light.places) >= drop_out_share[of_place]
    jitter_px = rng.standard_normal(light.places) * noise_px[of_place] + bias_px[of_place]
    if glass.thickness_mm > 0 or water.depth_mm > 0:
        view = view_of(pipe, T_pipe_camera, rig, glass, water)
        pixel, slit = _seen_by_bent_light(pipe, view, rig, light, kept, jitter_px)
        return SlitPixels(pixel, slit, np.maximum(sigma_px, LEAST_SIGMA_PX)[slit])
    pixel, slit = _seen(
        near_wall(pipe, float(T_pipe_camera[2, 3])),
        (pipe.start_mm, pipe.end_mm, pipe.backed),
        T_pipe_camera,
        rig.projector.apex_mm,
        light,
        kept,
        jitter_px,
        camera.intrinsics,
        (camera.width_px - 1, camera.height_px - 1),
    )
    return SlitPixels(pixel, slit, np.maximum(sigma_px, LEAST_SIGMA_PX)[slit])


@njit(cache=True, error_model="numpy")
def _seen(wall, pipe, T_pipe_camera, apex, light, kept, jitter_px, intrinsics, corner):
    """Pixels and slits of the rays that end on a wall which the camera sees, moved outward by their jitter."""
    T, (start_mm, end_mm, backed) = T_pipe_camera, pipe
    eye = (T[0, 3], T[1, 3], T[2, 3])
    origin = point_at(eye, _turned(T, apex[0], apex[1], apex[2]), 1.0)
    n = light.slit.size
    rays, points = np.empty((n, 3)), np.empty((n, 3))
    for i in range(n):
        x, y, z = light.rays_camera[i, 0], light.rays_camera[i, 1], light.rays_camera[i, 2]
        rays[i, 0], rays[i, 1], rays[i, 2] = _turned(T, x, y, z)
    ranges = wall_ranges_mm(wall, origin, rays)
    for i in range(n):
        for k in range(3):
            points[i, k] = origin[k] + ranges[i] * rays[i, k]
    # false for NaN too, which a projector outside the bore gives
    seen = (points[:, 2] >= start_mm) & (points[:, 2] <= end_mm) & kept[light.place] & ~in_shadow(wall, points, eye)
    if not backed:
        seen &= ~is_hole(wall, points[:, 0], points[:, 1])
    return _pictured(light, seen, ranges, jitter_px, apex, intrinsics, corner)


def _seen_by_bent_light(
    pipe: Pipe, view: View, rig: Rig, light: Fan, kept: np.ndarray, jitter_px: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """`_seen` by way of glass and water: each ray has its own origin, and the wall seems to lie elsewhere."""
    camera = rig.camera
    wall = near_wall(pipe, view.eye[2])
    ends, seems, ranges, seen = seen_ends(wall, view, rig.projector.apex_mm, light.rays_camera)
    seen &= (ends[:, 2] >= pipe.start_mm) & (ends[:, 2] <= pipe.end_mm) & kept[light.place]
    if not pipe.backed:
        seen &= ~is_hole(wall, ends[:, 0], ends[:, 1])
    as_seen = light._replace(rays_camera=seems)
    corner = (camera.width_px - 1, camera.height_px - 1)
    return _pictured(as_seen, seen, ranges, jitter_px, ORIGIN, camera.intrinsics, corner)


@njit(cache=True, error_model="numpy")
def _pictured(light, seen, ranges, jitter_px, apex, intrinsics, corner):
    """Pixels, moved outward by their jitter, and slits of those rays whose end is seen, within the picture."""
    pixel, slit, lens, n = np.empty((ranges.size, 2)), np.empty(ranges.size, dtype=np.int64), lens_of(intrinsics), 0
    # first all, which the processor does several at a time, then those that are seen moved to the front
    for i in range(ranges.size):
        x = apex[0] + ranges[i] * light.rays_camera[i, 0]
        y = apex[1] + ranges[i] * light.rays_camera[i, 1]
        z = apex[2] + ranges[i] * light.rays_camera[i, 2]
        pixel[i, 0], pixel[i, 1] = fisheye_pixel(x, y, z, lens)
    for i in range(ranges.size):
        if not seen[i]:
            continue
        u, v = pixel[i, 0], pixel[i, 1]
        du, dv = u - lens[3], v - lens[4]
        shift = jitter_px[light.place[i]] / np.sqrt(du * du + dv * dv)
        u, v = u + shift * du, v + shift * dv
        if 0 <= u <= corner[0] and 0 <= v <= corner[1]:
            pixel[n, 0], pixel[n, 1], slit[n] = u, v, light.slit[i]
            n += 1
    return pixel[:n], slit[:n]


@njit(cache=True, error_model="numpy", forceinline=True)
def _turned(T, x, y, z):
    return (
        T[0, 0] * x + T[0, 1] * y + T[0, 2] * z,
        T[1, 0] * x + T[1, 1] * y + T[1, 2] * z,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z,
    )
