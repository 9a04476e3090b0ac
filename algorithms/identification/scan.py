"""A log walked through once by the measurement's own fold, keeping of each frame only what identification asks for."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from algorithms.calibration.pipe_view import WRONG_MM, radial_mm
from algorithms.identification.slits import SlitFigures, slit_figures
from algorithms.method import Method
from algorithms.reconstruct import ReconstructionFailed, begin, finish, step
from algorithms.robust import spread
from algorithms.types import Reconstruction
from sensor_model.recording import SLIT_PIXELS_SUFFIX, Recording, SlitPixels

COMMON_PRIOR_PCT, SCALE_PRIOR_PCT = 3.0, 2.0
FEATURE_MM = 1.2  # an oval bore rises less, and is no rule along the pipe
# the identification believes next to nothing of the wheels, and finds its way by what the rings see
IDENTIFYING = Method.model_validate(
    {
        "localisation": {
            "kind": "featured",
            "feature_mm": FEATURE_MM,
            "wheels": {"common_scale_std_pct": COMMON_PRIOR_PCT, "scale_std_pct": SCALE_PRIOR_PCT},
        },
    }
)


@dataclass(frozen=True)
class Walk:
    """What the fold left: the reconstruction, or why there is none, and a row of figures for each registered frame."""

    found: Reconstruction | None
    failure: str
    slits: list[SlitFigures]
    residual_mm: Float[np.ndarray, "registered"]
    yields: Float[np.ndarray, "frames"]


def walk(recording: Recording, seen: Iterable[SlitPixels], method: Method = IDENTIFYING) -> Walk:
    """Measure frame by frame from the slit pixels of each."""
    state = begin(recording.rig, recording.pipe, method)
    from_camera = recording.frame_files[0].endswith(SLIT_PIXELS_SUFFIX) is False
    figures: list[SlitFigures] = []
    residuals, yields = [], []
    for index, pixels in enumerate(seen):
        result = step(state, recording.frame(index), pixels)
        yields.append(result.decode_yield)
        if not result.alignment.converged:
            continue
        before = figures[-1] if figures else None
        figures.append(slit_figures(result.points, result.alignment, recording.rig, from_camera, before))
        if before is not None:
            figures[-2] = replace(before, rough_rad=before.rough_rad[:, :0])
        off = radial_mm(result.points.xyz_mm, result.alignment)
        residuals.append(spread(off[np.abs(off) < WRONG_MM]))
    try:
        found, failure = finish(state), ""
    except ReconstructionFailed as error:
        found, failure = None, str(error)
    return Walk(found, failure, figures, np.array(residuals), np.array(yields))
