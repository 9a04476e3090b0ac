"""The clouds that registrations leave of a whole scan, side by side as in Fig. 11 of the paper."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Float

from scenarios.report.canvas import Picture, drawing, to_picture

if TYPE_CHECKING:
    from matplotlib.cm import ScalarMappable

MOST_POINTS = 60_000
MOST_CLOUDS = 8
COLOR_MAP, COLORS_TO_MM = "managua_r", 1.5  # what lies further off has the end's colour
TIMES, FAR_OFF_MM = 5.0, 20.0  # deviations are drawn so many times as large, unless they are large as they are


class Cloud(NamedTuple):
    """What one method made of a scan (pipe frame), thinned."""

    scenario: str
    method: str
    xyz_mm: Float[np.ndarray, "n 3"]
    bore_mm: float


def clouds_picture(clouds: list[Cloud]) -> Picture:
    """Each method's cloud of one scan, seen along the pipe and from its side."""
    shown, scale = clouds[:MOST_CLOUDS], deviation_scale()
    with drawing(3.4 * -(-len(shown) // 2)) as figure:
        grid = figure.subplots(-(-len(shown) // 2), 4, width_ratios=[1, 1.5] * 2, squeeze=False).ravel()
        for k, cloud in enumerate(shown):
            along, side = grid[2 * k : 2 * k + 2]
            times, xyz, off_mm = stretched(cloud.xyz_mm, cloud.bore_mm)
            draw_along(along, xyz, scale.to_rgba(off_mm))
            side.scatter(xyz[:, 2], -xyz[:, 1], s=0.6, c=scale.to_rgba(off_mm), linewidths=0)
            side.set_xlabel("along the pipe (mm)")
            along.set_title(cloud.method)
            side.set_title(f"from the side, deviations × {times:g}", fontsize=9, fontweight="normal")
        for axes in grid[2 * len(shown) :]:
            axes.set_visible(False)
        figure.colorbar(scale, ax=list(grid), label="beyond the true bore (mm)", fraction=0.02, extend="both")
        return to_picture(
            figure,
            f"The cloud of {shown[0].scenario} as each method leaves it.",
            "All frames of the first recording put together by each method's poses, as in the paper's Fig. 11: a wall "
            "put together well is one thin circle. False slits are left out by the true poses, alike for all.",
        )


def deviation_scale() -> ScalarMappable:
    """Colours of a deviation from the true bore."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    return ScalarMappable(Normalize(-COLORS_TO_MM, COLORS_TO_MM), COLOR_MAP)


def stretched(xyz_mm: Float[np.ndarray, "n 3"], bore_mm: float) -> tuple[float, np.ndarray, np.ndarray]:
    """How many times deviations from the bore are enlarged, the points moved so, and their true deviations."""
    radius = np.hypot(xyz_mm[:, 0], xyz_mm[:, 1])
    off_mm = radius - bore_mm
    times = TIMES if off_mm.size and np.percentile(np.abs(off_mm), 99) < FAR_OFF_MM else 1.0
    part = (bore_mm + times * off_mm) / np.maximum(radius, 1e-9)
    return times, xyz_mm * np.column_stack([part, part, np.ones(part.size)]), off_mm


def draw_along(axes: Any, xyz: np.ndarray, colors: np.ndarray) -> None:
    """The top view: a pipe that is put together well is one thin circle."""
    axes.scatter(xyz[:, 0], -xyz[:, 1], s=0.6, c=colors, linewidths=0)
    square(axes)


def square(axes: Any) -> None:
    """Right and up at one scale."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("right (mm)")
    axes.set_ylabel("up (mm)")
