"""A calibration session in closed loop: the true rig's slits on flat boards at known poses, and the rig they give."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from jaxtyping import Float, Int
from pydantic import Field
from scipy.spatial.transform import Rotation

from algorithms.calibration.cone_fit import ConeFit, Sight, fit_cones
from algorithms.calibration.cones import cones_of, with_cones
from algorithms.calibration.surfaces import FlatBoard
from sensor_model.geometry import cone_frame, fisheye_project, fisheye_rays
from sensor_model.glass import ORIGIN, Glass, aimed_at, beyond, tube_of
from sensor_model.points import PointNoise, fan
from sensor_model.rig import Camera, Rig
from sensor_model.settings import Settings
from sensor_model.streams import stream

DESIGN_APEX_OFF_MM = (0.5, -0.5, 1.0)
DESIGN_AXIS_OFF = (0.005, -0.005, 0.0)
DESIGN_ANGLE_OFF_DEG = 0.2
NEAREST_MM = 5.0
LEAST_PLACE_STD = 1e-6  # mm and rad: a place without error has no infinite information


class BoardSession(Settings):
    """A board held before the sensor so many times, and how well its place is known; every error has a zero."""

    boards: Annotated[int, Field(ge=3, le=1000)] = 25
    nearest_mm: Annotated[float, Field(gt=20)] = 60.0
    farthest_mm: Annotated[float, Field(gt=20, le=1000)] = 200.0
    tilt_deg: Annotated[float, Field(ge=0, le=60)] = 30.0
    board_distance_std_mm: Annotated[float, Field(ge=0, le=10)] = 0.02
    board_tilt_std_deg: Annotated[float, Field(ge=0, le=10)] = 0.02
    own_apex: bool = False
    """Whether each slit gets an apex of its own: what a glass tube before the projector asks for."""
    points: PointNoise = PointNoise()


class Plane(NamedTuple):
    """Places p with `normal . p = distance_mm`, camera frame."""

    normal: Float[np.ndarray, "3"]
    distance_mm: float


class Calibrated(NamedTuple):
    """The rig to measure with, and what its fit says of itself."""

    rig: Rig
    fit: ConeFit


def calibrate(true_rig: Rig, seed: int, session: BoardSession | None = None, glass: Glass | None = None) -> Calibrated:
    """See the slits on every board, through the glass tube if there is one, and fit the projector's cones.

    The camera is taken as known, the boards' places as well as the session knows them.

    The fit starts from a projector that is wrong by as much as a drawing is.
    """
    session, rng = session or BoardSession(), stream(seed, "boards")
    held, sights = known_place(session), []
    for _ in range(session.boards):
        board = draw_board(session, rng)
        pixel, slit = see_board(true_rig, board, session.points, rng, glass or Glass())
        rays = fisheye_rays(pixel, true_rig.camera.intrinsics)
        sights.append(
            Sight(
                rays,
                slit,
                FlatBoard(pose_of(believed(board, session, rng)), held),
                ray_noise(rays, session, true_rig.camera),
            )
        )
    return fitted(true_rig, sights, session)


def fitted(rig: Rig, sights: list[Sight], session: BoardSession) -> Calibrated:
    """The rig with the cones that the boards give."""
    fit = fit_cones(sights, cones_of(as_drawn(rig).projector), own_apex=session.own_apex)
    return Calibrated(rig.model_copy(update={"projector": with_cones(rig.projector, fit.cones, session.own_apex)}), fit)


def ray_noise(rays: Float[np.ndarray, "n 3"], session: BoardSession, camera: Camera) -> Float[np.ndarray, "n"]:
    """Standard deviation of the rays' angles."""
    return np.full(len(rays), session.points.pixel_noise_px / camera.fx_px)


def known_place(session: BoardSession) -> Float[np.ndarray, "6 6"]:
    """Information on a board's pose that the session's errors leave."""
    std = [np.radians(session.board_tilt_std_deg)] * 3 + [session.board_distance_std_mm] * 3
    return np.diag(np.maximum(std, LEAST_PLACE_STD) ** -2.0)


def pose_of(board: Plane) -> Float[np.ndarray, "6"]:
    """Rotation vector and origin of the board's frame, whose z is its normal."""
    ahead = np.array([0.0, 0.0, board.distance_mm / board.normal[2]])
    return np.concatenate([Rotation.from_matrix(cone_frame(board.normal)).as_rotvec(), ahead])


def as_drawn(rig: Rig) -> Rig:
    """The rig before its calibration: apex, axis and half angles are off."""
    projector = rig.projector
    slits = tuple(
        slit.model_copy(update={"half_angle_deg": slit.half_angle_deg + DESIGN_ANGLE_OFF_DEG})
        for slit in projector.slits
    )
    apex = tuple((np.array(projector.apex_mm) + DESIGN_APEX_OFF_MM).tolist())
    axis = tuple((np.array(projector.axis) + DESIGN_AXIS_OFF).tolist())
    changed = projector.model_copy(update={"apex_mm": apex, "axis": axis, "slits": slits})
    return rig.model_copy(update={"projector": changed})


def draw_board(session: BoardSession, rng: np.random.Generator) -> Plane:
    """A board before the camera, tilted in any direction."""
    tilt = np.radians(session.tilt_deg) * np.sqrt(rng.uniform())
    return _plane(tilt, rng.uniform(0, 2 * np.pi), rng.uniform(session.nearest_mm, session.farthest_mm))


def believed(board: Plane, session: BoardSession, rng: np.random.Generator) -> Plane:
    """Where the session takes the board to be."""
    tilt = np.radians(session.board_tilt_std_deg) * rng.standard_normal(3)
    normal = board.normal + np.cross(tilt, board.normal)
    distance_mm = board.distance_mm + session.board_distance_std_mm * rng.standard_normal()
    return Plane(normal / np.linalg.norm(normal), float(distance_mm))


def _plane(tilt_rad: float, towards_rad: float, ahead_mm: float) -> Plane:
    """The plane through a place straight ahead of the camera."""
    sine = np.sin(tilt_rad)
    normal = np.array([sine * np.cos(towards_rad), sine * np.sin(towards_rad), np.cos(tilt_rad)])
    return Plane(normal, float(normal[2] * ahead_mm))


def see_board(
    rig: Rig, board: Plane, noise: PointNoise, rng: np.random.Generator, glass: Glass
) -> tuple[Float[np.ndarray, "n 2"], Int[np.ndarray, "n"]]:
    """Pixels of the slits' light on a board, moved outward by their noise, and their slits."""
    light, camera = fan(rig.projector, noise.azimuths), rig.camera
    kept = rng.random(light.places)[light.place] >= noise.drop_out_share
    jitter_px = rng.standard_normal(light.places)[light.place] * noise.pixel_noise_px
    if glass.thickness_mm > 0:
        tube = tube_of(glass)
        starts, onward = beyond(tube, rig.projector.apex_mm, light.rays_camera)
        xyz = starts + onward * ((board.distance_mm - starts @ board.normal) / (onward @ board.normal))[:, None]
        seen = aimed_at(tube, ORIGIN, xyz)
    else:
        xyz = seen = np.array(rig.projector.apex_mm) + on_plane(
            light.rays_camera,
            board._replace(distance_mm=board.distance_mm - float(board.normal @ rig.projector.apex_mm)),
        )
    pixel = fisheye_project(seen, camera.intrinsics)
    outward = pixel - [camera.cx_px, camera.cy_px]
    pixel = pixel + (jitter_px / np.linalg.norm(outward, axis=1))[:, None] * outward
    corner = np.array([camera.width_px - 1, camera.height_px - 1])
    kept &= (xyz[:, 2] > NEAREST_MM) & ((pixel >= 0) & (pixel <= corner)).all(axis=1)
    return pixel[kept], light.slit[kept]


def on_plane(rays: Float[np.ndarray, "n 3"], plane: Plane) -> Float[np.ndarray, "n 3"]:
    """Where rays from the origin meet a plane."""
    return rays * (plane.distance_mm / (rays @ plane.normal))[:, None]
