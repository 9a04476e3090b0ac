"""Fig. 5 of the paper: a deep defect set apart by the cylinder fit's RANSAC, judged point by point by the truth."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from algorithms.registration.cylinder import CylinderSettings
from algorithms.registration.cylinder_map import CylinderMapSettings
from algorithms.registration.from_axis import sigma_across_mm
from algorithms.types import RingPoints
from algorithms.wall_map import on_a_wall
from scenarios.bench.scans import Registered, Scan, registered, take_scan, triangulated
from scenarios.load import load_scenario
from scenarios.paper.folder import paper_folder
from scenarios.report.canvas import BLACK, BLUE, SKY, VERMILION, drawing, to_picture
from scenarios.report.plain_rows import text_table
from sensor_model.geometry import apply
from sensor_model.recording import NominalPipe
from sensor_model.wall_rays import near_wall, wall_ranges_mm

Report = Callable[[str, int, int], None]

DEPTH_MM, WALL_MM = 10.16, 12.7
DEFECT_SIGMAS = 3.0
POCKET = "kind: pocket, distance_mm: 285, clock_deg: 120, length_mm: 70, width_mm: 35"
CHANGES = [
    f"pipe.wall_thickness_mm={WALL_MM}",
    f"pipe.features=[{{{POCKET}, depth_mm: {DEPTH_MM}}}]",
    "drive.start_mm=40",
    "drive.stages=[{to_mm: 185, roll_to_deg: 25}]",
    "sensing.frame_rate_hz=2",
]
METHODS: dict[str, Any] = {"cylinder": CylinderSettings(), "cylinder-map": CylinderMapSettings()}
LABELS = ("defect, set apart", "defect, taken for wall", "wall, set apart", "wall, taken for wall")
KEYS = ("defect_outlier", "defect_inlier", "wall_outlier", "wall_inlier")
MARKS = dict(zip(LABELS, ((BLUE, "o"), (VERMILION, "^"), ("#e69f00", "x"), ("#b8b8b8", ".")), strict=True))


class Fig5(NamedTuple):
    """The fixed frame (the first) and the moving one (the last, turned, before the defect) as the fit leaves them."""

    fixed: Registered
    moving: Registered
    on_defect: Bool[np.ndarray, "n"]
    pipe: NominalPipe
    rows: list[dict[str, Any]]


def true_depth_mm(scan: Scan, index: int, points: RingPoints) -> Float[np.ndarray, "n"]:
    """How far beyond the bore the wall truly is where each point's light meets it."""
    pipe, T_true = scan.truth.pipe, scan.T_true[index]
    apex = apply(T_true, np.array([(scan.scenario.true_rig or scan.scenario.rig).projector.apex_mm]))[0]
    light = points.direction @ T_true[:3, :3].T
    ranges = wall_ranges_mm(near_wall(pipe, float(T_true[2, 3])), tuple(apex.tolist()), light)
    hit = apex + ranges[:, None] * light
    return np.hypot(hit[:, 0], hit[:, 1]) - pipe.bore_radius_mm


def confusion(method: str, inliers: Bool[np.ndarray, "n"], on_defect: Bool[np.ndarray, "n"]) -> dict[str, Any]:
    """How many points of each kind were set apart or kept, and what share of either is right."""
    counts = [int(np.sum(part)) for part in _parts(inliers, on_defect)]
    apart, defect = counts[0] + counts[2], counts[0] + counts[1]
    return {
        "method": method,
        **dict(zip(KEYS, counts, strict=True)),
        "precision_pct": 100.0 * counts[0] / apart if apart else None,
        "recall_pct": 100.0 * counts[0] / defect if defect else None,
    }


def _parts(inliers: Bool[np.ndarray, "n"], on_defect: Bool[np.ndarray, "n"]) -> tuple[np.ndarray, ...]:
    return on_defect & ~inliers, on_defect & inliers, ~on_defect & ~inliers, ~on_defect & inliers


def isolate(scan: Scan) -> Fig5:
    """Register the scan and compare the last frame's inliers with the truth."""
    points = triangulated(scan)
    index = len(points) - 1
    sigma = sigma_across_mm(points[index], scan.T_true[index][2, :3].copy())
    on_defect = true_depth_mm(scan, index, points[index]) > DEFECT_SIGMAS * sigma
    found = {label: list(registered(scan, points, settings)) for label, settings in METHODS.items()}
    rows = [confusion(label, frames[index].alignment.inliers, on_defect) for label, frames in found.items()]
    return Fig5(found["cylinder"][0], found["cylinder"][index], on_defect, scan.recording.pipe, rows)


def words(rows: list[dict[str, Any]]) -> str:
    """The confusion matrices for a terminal."""
    columns = {"method": "method", **dict(zip(KEYS, LABELS, strict=True))}
    return text_table(rows, {**columns, "precision_pct": "precision %", "recall_pct": "recall %"})


def run_fig5(fidelity: str, seed: int | None, out: Path, workers: int, progress: Report) -> list[dict[str, Any]]:
    """Scan, judge and draw into a folder.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: when the scan fails.
    """
    scenario = load_scenario("paper-gantry", [*CHANGES, f"sensing.fidelity={fidelity}"], seed)
    with paper_folder("fig5", scenario, out) as folder:
        figure = isolate(take_scan(scenario, workers, progress))
        (folder / "fig5.json").write_text(json.dumps(figure.rows, indent=1, allow_nan=False) + "\n")
        (folder / "fig5.png").write_bytes(picture(figure))
    return figure.rows


def picture(figure: Fig5) -> bytes:
    """Input, isolated defect, and both frames aligned, as a PNG."""
    with drawing(5.6, 14.0) as canvas:
        axes = canvas.subplots(1, 3, subplot_kw={"projection": "3d"})
        moving = figure.moving.points.xyz_mm
        _input(axes[0], moving)
        _isolated(axes[1], moving, figure)
        _aligned(axes[2], figure)
        for one in axes:
            _look(one)
        canvas.suptitle(
            f"A pocket {DEPTH_MM} mm deep in a 6 inch pipe with a {WALL_MM} mm wall: one frame and its cylinder fit"
        )
        return to_picture(canvas, "", "").file


def _input(axes: Any, xyz: np.ndarray) -> None:
    axes.scatter(*_drawn(xyz), s=1.5, c=BLACK, linewidths=0)
    axes.set_title("(a) Input: moving frame, camera frame")


def _isolated(axes: Any, xyz: np.ndarray, figure: Fig5) -> None:
    parts = _parts(figure.moving.alignment.inliers, figure.on_defect)
    for (label, (color, marker)), part in reversed(list(zip(MARKS.items(), parts, strict=True))):
        size = 1.5 if label == LABELS[3] else 9
        axes.scatter(*_drawn(xyz[part]), s=size, c=color, marker=marker, linewidths=0.8 if marker == "x" else 0)
    from matplotlib.lines import Line2D

    marks = [
        Line2D([], [], ls="", marker=m if m != "." else "o", ms=5, color=c, label=f"{label}: {int(part.sum())}")
        for (label, (c, m)), part in zip(MARKS.items(), parts, strict=True)
    ]
    axes.legend(handles=marks, loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=2)
    axes.set_title("(b) Set apart by RANSAC, judged by the truth")


def _aligned(axes: Any, figure: Fig5) -> None:
    from matplotlib.lines import Line2D

    for frame, color in ((figure.fixed, BLACK), (figure.moving, VERMILION)):
        T = frame.alignment.T_pipe_camera
        kept = on_a_wall(frame.points, T, figure.pipe)  # as the chain does before it maps them
        axes.scatter(*_drawn(apply(T, frame.points.xyz_mm[kept])), s=1.5, c=color, linewidths=0)
    marks = [
        Line2D([], [], ls="", marker="o", ms=5, color=color, label=label)
        for color, label in ((BLACK, "fixed frame"), (VERMILION, "moving frame"))
    ]
    axes.plot([0, 0], [100, 360], [0, 0], color=SKY, lw=1.5)
    marks.append(Line2D([], [], color=SKY, label="axis of the pipe"))
    axes.legend(handles=marks, loc="upper center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    axes.set_title("(c) After alignment, pipe frame")


def _drawn(xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points as the plot's axes: to the right, along the pipe, up."""
    return xyz[:, 0], xyz[:, 2], -xyz[:, 1]


def _look(axes: Any) -> None:
    from matplotlib.ticker import MultipleLocator

    axes.xaxis.set_major_locator(MultipleLocator(50))
    axes.yaxis.set_major_locator(MultipleLocator(100))
    axes.zaxis.set_major_locator(MultipleLocator(50))
    axes.set_xlabel("right (mm)")
    axes.set_ylabel("along (mm)")
    axes.set_zlabel("up (mm)")
    axes.set_aspect("equal")
    axes.view_init(elev=16, azim=-62)
