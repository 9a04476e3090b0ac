"""Haze by the twin: as much of it as makes the drawn slits as dark as those of the picture, from the same place."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from algorithms.calibration.pipe_view import PipeView, view_pipe
from algorithms.decode import DecodeSettings
from algorithms.identification.estimate import Quantity, of_blocks
from scenarios.calibration.look import look_of
from sensor_model.focus import nearness_per_mm
from sensor_model.image_formation import expose
from sensor_model.optics import Optics
from sensor_model.raycast import draw
from sensor_model.rig import Rig
from twin.pipe import Pipe

TRIED = (0.0, 0.1, 0.25, 0.45, 0.7)
OTHERS_STD = 0.01  # of haze: what the other settings of the look, taken as they stand, leave open


def haze(pictures: list[UInt8[np.ndarray, "height width 3"]], rig: Rig, optics: Optics) -> Quantity:
    """Haze of pictures with a pipe in them, all else of the look as given (reflections lift the dark, too)."""
    found = []
    for picture in pictures:
        view = view_pipe(picture, rig, DecodeSettings())
        if view.alignment.converged:
            found += _of_slits(picture, view, rig, optics)
    return of_blocks(np.array(found), "contrast of the slits against the twin's from the same place", OTHERS_STD)


def _of_slits(picture: UInt8[np.ndarray, "height width 3"], view: PipeView, rig: Rig, optics: Optics) -> list[float]:
    """Haze by each slit of one picture; not a number where the twin's slit is never as dark, or never as bright."""
    real = look_of(picture, view, rig).contrast_pct
    pipe = Pipe(inner_radius_mm=view.alignment.radius_mm, wall_thickness_mm=7.5)
    T_pipe_camera = view.alignment.T_pipe_camera
    drawn = draw(pipe, T_pipe_camera, rig, optics)
    nearness = nearness_per_mm(pipe, T_pipe_camera, rig.camera, optics)
    by_haze = np.array([_contrast(drawn, nearness, rig, optics, share) for share in TRIED])
    return [_crossed(column, float(one)) for column, one in zip(by_haze.T, real, strict=True)]


def _contrast(
    drawn: np.ndarray, nearness: np.ndarray | None, rig: Rig, optics: Optics, share: float
) -> Float[np.ndarray, "slits"]:
    """Contrast of the twin's slits in so much haze, at its own places: its slide is printed otherwise."""
    hazy = optics.noiseless().model_copy(update={"haze": share})
    stored = expose(drawn, hazy, np.random.default_rng(0), rig.camera, nearness)
    seen = view_pipe(stored, rig, DecodeSettings())
    return (
        look_of(stored, seen, rig).contrast_pct
        if seen.alignment.converged
        else np.full(len(rig.projector.slits), np.nan)
    )


def _crossed(contrast: Float[np.ndarray, "tried"], wanted: float) -> float:
    """Where a falling contrast passes the wanted one; before the first of them by the same slope."""
    if not (np.isfinite(contrast).all() and np.isfinite(wanted)) or (np.diff(contrast) >= 0).any():
        return float("nan")
    if wanted > contrast[0]:
        slope = (contrast[1] - contrast[0]) / (TRIED[1] - TRIED[0])
        return float((wanted - contrast[0]) / slope)
    return float(np.interp(wanted, contrast[::-1], np.array(TRIED)[::-1])) if wanted > contrast[-1] else float("nan")
