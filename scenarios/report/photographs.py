"""Sample pictures of the sensor with what was decoded in them laid over."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, UInt8

from scenarios.report.canvas import Picture, photograph
from scenarios.run import Run, Sample

WIDTH_PX = 1000
# bright on dark slits, neighbours unlike in hue and in lightness
DOTS = ("#ffffff", "#00e5ff", "#ff5cf4", "#7dff4f", "#ffffff", "#00e5ff", "#ff5cf4", "#7dff4f")


def sample_picture(run: Run, sample: Sample) -> Picture | None:
    """One picture, at most 1000 px wide, with the decoded slit centres as dots; None where a frame has no picture."""
    import cv2

    picture = run.recording[sample.index].picture
    if picture is None:
        return None
    scale = min(WIDTH_PX / picture.shape[1], 1.0)
    size = round(picture.shape[1] * scale), round(picture.shape[0] * scale)
    small = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    # pixel centres lie at integers in both pictures
    places = (sample.seen.pixel + 0.5) * scale - 0.5
    dotted = _dotted(small, places, sample.seen.slit)
    return photograph(
        dotted,
        f"Camera picture of frame {sample.index} at {sample.z_mm:.0f} mm: coloured rings on the pipe's wall, the dark slits "
        f"between them marked by {len(places)} decoded points.",
        f"Frame {sample.index}, camera at {sample.z_mm:.0f} mm: {len(places)} slit points decoded.",
    )


def _dotted(
    rgb: UInt8[np.ndarray, "height width 3"], places: Float[np.ndarray, "n 2"], slit: np.ndarray
) -> UInt8[np.ndarray, "height width 3"]:
    out = rgb.copy()
    column, row = np.round(places).astype(int).T
    inside = (column >= 0) & (column < rgb.shape[1]) & (row >= 0) & (row < rgb.shape[0])
    colors = np.array([[int(dot[k : k + 2], 16) for k in (1, 3, 5)] for dot in DOTS], dtype=np.uint8)
    out[row[inside], column[inside]] = colors[slit[inside] % len(DOTS)]
    return out
