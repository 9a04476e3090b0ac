"""Fig. 11 of the paper: the clouds that each registration leaves of one gantry scan, side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from scenarios.bench.clouds import MOST_POINTS, deviation_scale, draw_along, square, stretched
from scenarios.bench.contenders import METHODS
from scenarios.bench.scans import Scan, as_placed, registered, take_scan, triangulated
from scenarios.equations import circle, plane_normal
from scenarios.load import load_scenario
from scenarios.paper.folder import paper_folder
from scenarios.report.canvas import BLACK, BLUE, VERMILION, drawing, to_picture
from sensor_model.geometry import wall_direction
from twin.pipe import Pipe

Report = Callable[[str, int, int], None]

ARROW_MM = 60.0


class Clouds(NamedTuple):
    """What one method made of the scan (pipe frame), and one frame of it: the middle of the first defect."""

    method: str
    xyz_mm: Float[np.ndarray, "n 3"]
    frame_mm: Float[np.ndarray, "k 3"]


def clouds(scan: Scan, progress: Report) -> Iterator[Clouds]:
    """The registered points, thinned alike; false slits are left out by the true pose, alike for all methods."""
    points = triangulated(scan)
    shown = _frame_on_defect(scan)
    step = max(sum(frame.sigma_mm.size for frame in points) // MOST_POINTS, 1)
    for label, settings in METHODS.items():
        parts, single = [np.zeros((0, 3))], np.zeros((0, 3))
        for frame in registered(scan, points, settings):
            progress(label, frame.number + 1, len(points))
            if frame.alignment.converged:
                xyz = as_placed(scan, frame)
                parts.append(xyz[frame.number % step :: step])
                single = xyz if frame.number == shown else single
        yield Clouds(label, np.concatenate(parts), single)


def _frame_on_defect(scan: Scan) -> int:
    """The frame whose middle ring lies on the first defect's middle."""
    pipe = scan.truth.pipe
    at_mm = pipe.features[0].distance_mm - 1.5 * pipe.bore_radius_mm
    return int(np.argmin(np.abs(scan.T_true[:, 2, 3] - at_mm)))


def run_fig11(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> Path:
    """Scan, register and draw into a folder; returns the picture's path.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: when the scan fails.
    """
    scenario = load_scenario("paper-gantry", [f"sensing.fidelity={fidelity}"], seed)
    with paper_folder("fig11", scenario, out) as folder:
        scan = take_scan(scenario, workers, progress)
        (folder / "fig11.png").write_bytes(picture(scan, list(clouds(scan, progress))))
    return out / "fig11.png"


def picture(scan: Scan, all_clouds: list[Clouds]) -> bytes:
    """Three rows of views, a column a method, as a PNG."""
    pipe, scale = scan.truth.pipe, deviation_scale()
    with drawing(11.5, 3.3 * len(all_clouds) + 0.8) as figure:
        axes = figure.subplots(3, len(all_clouds), squeeze=False)
        for column, cloud in enumerate(all_clouds):
            times, xyz, off_mm = stretched(cloud.xyz_mm, pipe.bore_radius_mm)
            drawn = f"deviations × {times:g}" if times != 1 else "true to scale"
            draw_along(axes[0, column], xyz, scale.to_rgba(off_mm))
            _side(axes[1, column], pipe, xyz, scale.to_rgba(off_mm), times)
            _single(axes[2, column], cloud)
            axes[0, column].set_title(f"{cloud.method}\n\n", fontsize=13)
            for row, view in enumerate((f"(a) along the pipe, {drawn}", f"(b) side, {drawn}", "(c) one frame")):
                axes[row, column].text(0.0, 1.03, view, transform=axes[row, column].transAxes, fontsize=9.5)
        figure.colorbar(scale, ax=axes[:2], label="beyond the true bore (mm)", fraction=0.02, extend="both")
        figure.suptitle(
            "One gantry scan, off centre, tilted, and turned by 25 degrees between two pockets 7.5 mm deep, "
            "as each registration leaves it"
        )
        return to_picture(figure, "", "").file


def _side(axes: Any, pipe: Pipe, xyz: np.ndarray, colors: np.ndarray, times: float) -> None:
    """The side view, looked at square to the defects' clock position, so that they stand out from the wall."""
    up = xyz @ wall_direction(np.radians(pipe.features[0].clock_deg))
    axes.scatter(xyz[:, 2], up, s=0.6, c=colors, linewidths=0)
    for feature in pipe.features:
        size = feature.size(pipe.bore_radius_mm)
        ends = np.array([-0.5, 0.5]) * size.length_mm + feature.distance_mm
        floor = pipe.bore_radius_mm + times * size.depth_mm
        axes.plot(ends, [floor, floor], color=BLACK, lw=1.5, label="true floor")
    axes.legend(*([part[:1] for part in axes.get_legend_handles_labels()]), loc="lower right", frameon=True)
    axes.set_xlabel("along the pipe (mm)")
    axes.set_ylabel("towards the defects (mm)")


def _single(axes: Any, cloud: Clouds) -> None:
    """Fig. 11c: one frame seen along the pipe, the circle through it, and its plane's normal."""
    xyz = cloud.frame_mm
    if not len(xyz):
        axes.text(0.5, 0.5, "no pose", transform=axes.transAxes, ha="center")
        return
    (x, y), radius = circle(xyz[:, :2])
    normal, turn = plane_normal(xyz), np.linspace(0, 2 * np.pi, 181)
    axes.scatter(xyz[:, 0], -xyz[:, 1], s=1.0, c=BLACK, linewidths=0)
    axes.plot(x + radius * np.cos(turn), -y + radius * np.sin(turn), color=BLUE, lw=1.0)
    axes.plot(x, -y, "+", color=BLUE, ms=9)
    tip = (x + ARROW_MM * normal[0], -y - ARROW_MM * normal[1])
    axes.annotate("", tip, (x, -y), arrowprops={"arrowstyle": "-|>", "color": VERMILION, "lw": 1.6})
    slant = float(np.degrees(np.arccos(np.clip(normal[2], -1, 1))))
    words = f"centre {x:+.2f}, {-y:+.2f} mm\nradius {radius:.2f} mm\nnormal {slant:.1f}° off the axis"
    box = {"facecolor": "white", "edgecolor": "none", "alpha": 0.85, "pad": 1.5}
    axes.text(x, -y - 12, words, ha="center", va="top", fontsize=9, bbox=box)
    square(axes)
