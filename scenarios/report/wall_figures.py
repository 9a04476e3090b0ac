"""Pictures of the wall: unrolled, in profile through each defect, and in space."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float

from algorithms.large_arrays import lines, percentile
from algorithms.types import Defect, WallMap, seen_share
from scenarios.report.canvas import (
    BLACK,
    BLUE,
    HATCH,
    UNSEEN,
    VERMILION,
    Picture,
    clock_axis,
    drawing,
    hatch_unseen,
    to_picture,
)
from scenarios.report.comparison import Row, true_size
from scenarios.run import Run, Scan
from sensor_model.geometry import clock_position, wrap_rad
from twin.features.base import Feature
from twin.pipe import Pipe

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COLOR_MAP = "cividis"
INWARD_MM = 1.0  # wall standing in by more than this is given colours of its own
LEAST_RANGE_MM = 0.5
MARGIN_MM = 18.0
SHALLOW_SHARE = 0.2
DEPTH_DRAWN = 2.0  # so many times in the view in space
VIEW_STRIPES = 130, 420
MOST_COLUMNS = 4000  # of the map, several to a dot
VIEW_RAD = np.radians([-28.0, 16.0])  # turned about the upright, and looked down upon
LAMP = np.array([0.35, -0.80, 0.48])


def undamaged(pipe: Pipe) -> Pipe:
    """The same pipe without its features."""
    return Pipe.model_validate({**pipe.model_dump(), "features": ()})


def true_depth_mm(pipe: Pipe, theta_rad: np.ndarray | float, z_mm: np.ndarray | float) -> Float[np.ndarray, "*batch"]:
    """Depth of the true wall below the undamaged bore."""
    return pipe.radius(theta_rad, z_mm) - undamaged(pipe).radius(theta_rad, z_mm)


def depth_range_mm(run: Scan) -> tuple[float, float]:
    """Ends of the depth colours: the deepest defect, true or measured."""
    low = percentile(run.found.deviation_mm, 0.5)
    deepest = [feature.size(_bore_mm(run)).depth_mm for feature in _true_features(run)]
    deepest += [defect.depth_mm for defect in run.found.defects]
    return (low if low < -INWARD_MM else 0.0), max([LEAST_RANGE_MM, *deepest])


def _true_features(run: Scan) -> tuple[Feature, ...]:
    """What really is in the wall, where that is known."""
    return run.truth.pipe.features if isinstance(run, Run) else ()


def _bore_mm(run: Scan) -> float:
    """Radius of the bore, as it is or as the operator has it."""
    return run.truth.pipe.bore_radius_mm if isinstance(run, Run) else run.recording.pipe.inner_radius_mm


def wall_map(run: Scan, rows: list[Row]) -> Picture:
    """The unrolled wall, coloured by depth, with measured boxes and, where they are known, true outlines."""
    wall = run.found.wall
    columns = wall.touched()
    half_cell = (wall.z_mm[1] - wall.z_mm[0]) / 2
    ends = float(wall.z_mm[columns][0] - half_cell), float(wall.z_mm[columns][-1] + half_cell)
    low, high = depth_range_mm(run)
    with drawing(5.3) as figure:
        axes = figure.subplots()
        axes.grid(visible=False)
        hatch_unseen(axes)
        shown = axes.imshow(
            np.ma.masked_invalid(_drawn(run.found.deviation_mm[:, columns])),
            extent=(*ends, 360, 0),
            aspect="auto",
            interpolation="nearest",
            cmap=COLOR_MAP,
            vmin=low,
            vmax=high,
        )
        for row in rows:
            _outline(axes, row, run)
        clock_axis(axes)
        axes.set_xlim(*ends)
        axes.set_xlabel("distance along the pipe (mm)")
        axes.set_title("Unrolled wall: depth below the undamaged bore")
        _map_key(axes, isinstance(run, Run))
        figure.colorbar(shown, ax=axes, label="depth (mm)", fraction=0.025, pad=0.01)
        unseen, true = 100 * (1 - (seen_share(run.found.wall) or 0.0)), _true_features(run)
        outlines = f" over {len(true)} true outlines" if isinstance(run, Run) else ""
        dashed = "Dashed: the true outline at half depth; " if isinstance(run, Run) else ""
        return to_picture(
            figure,
            f"Unrolled map of the wall from {ends[0]:.0f} to {ends[1]:.0f} mm, clock positions 12 to 12 from top to "
            f"bottom, coloured by depth up to {high:.1f} mm; {len(run.found.defects)} measured boxes{outlines}; "
            "hatched grey is not seen.",
            f"The wall unrolled, clock positions as seen looking downstream. {dashed}"
            f"{'solid' if dashed else 'Solid'} box: as measured, numbered as in the table. Hatched grey: not seen "
            f"({unseen:.1f} % of the scanned wall), never filled in.",
        )


def _drawn(deviation_mm: Float[np.ndarray, "around along"]) -> Float[np.ndarray, "around drawn"]:
    """Of a long pipe evenly as many columns as are several to a dot."""
    along = deviation_mm.shape[1]
    columns = ((np.arange(min(along, MOST_COLUMNS)) + 0.5) * max(along / MOST_COLUMNS, 1)).astype(int)
    return np.array([line[columns] for (line,) in lines(deviation_mm)])


def _outline(axes: Axes, row: Row, run: Scan) -> None:
    """True outline and measured box of one defect, drawn a turn up and down too, for those that cross 12 o'clock."""
    from matplotlib.patches import Rectangle

    radius = _bore_mm(run)
    half_width_deg = 0.0
    if row.feature is not None and isinstance(run, Run):
        _true_outline(axes, row.feature, run.truth.pipe)
        half_width_deg = float(np.degrees(row.feature.size(radius).width_mm / 2 / radius))
    label_z, label_deg = row.distance_mm, np.degrees(row.theta_rad)
    if row.defect is not None:
        box = row.defect
        height = float(np.degrees(box.width_mm / radius))
        top = float(np.degrees(box.theta_rad)) - height / 2
        for turn in (-360, 0, 360):
            corner = box.start_mm, top + turn
            axes.add_patch(Rectangle(corner, box.length_mm, height, fill=False, edgecolor=VERMILION, linewidth=1.6))
        half_width_deg = max(half_width_deg, height / 2)
    place = float(np.mod(label_deg - half_width_deg - 9, 360))
    words = f"{row.number}" if row.kind in ("found", "measured") else f"{row.number} {row.kind}"
    box_style = {"boxstyle": "round,pad=0.25", "facecolor": "white", "edgecolor": BLACK, "linewidth": 0.8}
    left, right = axes.get_xlim()
    side = (
        "right"
        if label_z > right - 0.08 * (right - left)
        else "left"
        if label_z < left + 0.08 * (right - left)
        else "center"
    )
    axes.text(label_z, place, words, ha=side, va="center", fontsize=9, bbox=box_style, clip_on=True)


def _true_outline(axes: Axes, feature: Feature, pipe: Pipe) -> None:
    size = feature.size(pipe.bore_radius_mm)
    z = feature.distance_mm + np.linspace(-0.75, 0.75, 181) * size.length_mm
    arc = np.linspace(-0.75, 0.75, 181) * size.width_mm
    theta = np.radians(feature.clock_deg) + arc / pipe.bore_radius_mm
    depth = true_depth_mm(pipe, theta[:, None], z[None, :])
    for turn in (-360, 0, 360):
        degrees = np.degrees(theta) + turn
        if degrees[-1] < 0 or degrees[0] > 360:
            continue
        half = [-size.depth_mm / 2 if feature.inward else size.depth_mm / 2]
        axes.contour(z, degrees, depth, half, colors="black", linestyles="solid", linewidths=2.4)
        axes.contour(z, degrees, depth, half, colors="white", linewidths=1.4, linestyles="dashed")


def _map_key(axes: Axes, with_truth: bool) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    true = [Line2D([], [], color=BLACK, linestyle=(0, (2.5, 1.5)), label="true outline")] if with_truth else []
    axes.legend(
        handles=[
            *true,
            Patch(facecolor="none", edgecolor=VERMILION, linewidth=1.6, label="measured"),
            Patch(facecolor=UNSEEN, edgecolor=HATCH, hatch="////", label="not seen"),
        ],
        loc="lower right",
        bbox_to_anchor=(1.0, 1.0),
        ncols=3,
        borderaxespad=0.2,
    )


def profiles(run: Run, row: Row) -> Picture:
    """Depth along and around through the middle of one defect, measured against the true wall."""
    wall, pipe = run.found.wall, run.truth.pipe
    around = int(np.argmin(np.abs(wrap_rad(wall.theta_rad - row.theta_rad))))
    along = int(np.argmin(np.abs(wall.z_mm - row.distance_mm)))
    length, width = _extent_mm(row, run)
    reach_z, reach_arc = length / 2 + MARGIN_MM, min(width / 2 + MARGIN_MM, np.pi * pipe.bore_radius_mm)
    offset = wrap_rad(wall.theta_rad - row.theta_rad) * pipe.bore_radius_mm
    order = np.argsort(offset)
    fine_z = row.distance_mm + np.linspace(-reach_z, reach_z, 801)
    fine_arc = np.linspace(-reach_arc, reach_arc, 801)
    spread, deviation = wall.spread_mm, run.found.deviation_mm
    with drawing(3.5) as figure:
        axial, across = figure.subplots(1, 2, sharey=True)
        theta, z = float(wall.theta_rad[around]), float(wall.z_mm[along])
        true_z = true_depth_mm(pipe, theta, fine_z)
        true_arc = true_depth_mm(pipe, row.theta_rad + fine_arc / pipe.bore_radius_mm, z)
        _profile(axial, wall.z_mm, deviation[around], spread[around], fine_z, true_z)
        _profile(across, offset[order], deviation[order, along], spread[order, along], fine_arc, true_arc)
        _mark_box(axial, across, row, pipe.bore_radius_mm)
        axial.set_title(f"Defect {row.number}: along the pipe at {row.clock}")
        axial.set_xlabel("distance along the pipe (mm)")
        across.set_title(f"Defect {row.number}: around the wall at {z:.0f} mm")
        across.set_xlabel("arc from its middle, clockwise (mm)")
        axial.set_ylabel("depth (mm)")
        for axes in (axial, across):
            axes.axhline(pipe.wall_mm, color=BLACK, linewidth=0.9, linestyle=(0, (1, 2)))
        deepest = max(float(np.max(true_z)), row.defect.depth_mm if row.defect else 0.0, LEAST_RANGE_MM)
        # a shallow one fills the plot; any other is shown against the full wall
        shallow = deepest < SHALLOW_SHARE * pipe.wall_mm
        deepest = 1.6 * deepest if shallow else max(deepest, pipe.wall_mm)
        axial.set_ylim(deepest * 1.12, -deepest if shallow else -0.2 * deepest)
        figure.legend(*_legend(axial, across), loc="outside lower center", ncols=5)
        return to_picture(
            figure,
            f"Depth profiles through defect {row.number} ({row.kind}) at {row.distance_mm:.0f} mm, {row.clock}: "
            "measured points over the true wall, along and around the pipe; stretches that were not seen are hatched.",
            f"Defect {row.number} ({row.kind}). Dots: cells of the wall map with the spread of their points; line: the "
            f"true wall; dotted line: the full wall, {pipe.wall_mm:g} mm.",
        )


def _extent_mm(row: Row, run: Run) -> tuple[float, float]:
    """The larger of true and measured size."""
    sizes = [(size.length_mm, size.width_mm) for size in [true_size(row, run)] if size]
    sizes += [(d.length_mm, d.width_mm) for d in [row.defect] if d]
    length, width = np.nanmax(np.array(sizes), axis=0)
    return float(length), float(width)


def _profile(
    axes: Axes, x: np.ndarray, depth: np.ndarray, spread: np.ndarray, fine: np.ndarray, true: np.ndarray
) -> None:
    near = (x >= fine[0]) & (x <= fine[-1])
    x, depth, spread = x[near], depth[near], spread[near]
    unseen = ~np.isfinite(depth)
    half = (x[1] - x[0]) / 2 if x.size > 1 else 0.5
    for k, (first, last) in enumerate(stretches(unseen)):
        words = "not seen" if k == 0 else None
        axes.axvspan(
            x[first] - half, x[last] + half, facecolor=UNSEEN, edgecolor=HATCH, hatch="////", lw=0, label=words
        )
    axes.plot(fine, true, color=BLACK, label="true wall")
    axes.errorbar(
        x,
        depth,
        np.nan_to_num(spread),
        fmt="o",
        markersize=3,
        color=BLUE,
        ecolor="#9cc4df",
        elinewidth=0.9,
        label="measured",
    )
    axes.set_xlim(float(fine[0]), float(fine[-1]))


def _legend(*panels: Axes) -> tuple[list, list[str]]:
    """Every mark of the panels once."""
    marks = {words: mark for axes in panels for mark, words in zip(*axes.get_legend_handles_labels(), strict=True)}
    return list(marks.values()), list(marks)


def _mark_box(axial: Axes, across: Axes, row: Row, radius_mm: float) -> None:
    if row.defect is None:
        return
    d = row.defect
    middle = float(wrap_rad(d.theta_rad - row.theta_rad)) * radius_mm
    edges = (
        (axial, (d.start_mm, d.start_mm + d.length_mm)),
        (across, (middle - d.width_mm / 2, middle + d.width_mm / 2)),
    )
    for axes, places in edges:
        for k, place in enumerate(places):
            words = "measured edges, at half depth" if k == 0 else None
            axes.axvline(place, color=VERMILION, linewidth=1.2, label=words)


def stretches(flags: np.ndarray) -> list[tuple[int, int]]:
    """First and last index of every run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(int), 0]))
    return [(int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def pipe_in_space(run: Scan) -> Picture:
    """The reconstructed wall cut open lengthwise and coloured by its deviation, seen from the open side."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import Normalize

    focus = _focus_rad(run.found.defects)
    corners, depth = _half_pipe(run.found.wall, run.found.deviation_mm, focus, _bore_mm(run))
    flat, away = _seen_from_the_side(corners)
    order = np.argsort(-away, kind="stable")
    low, high = depth_range_mm(run)
    scale = ScalarMappable(Normalize(low, high), COLOR_MAP)
    colors = _lit(scale.to_rgba(depth)[:, :3], corners)[order]
    wide, tall = np.ptp(flat.reshape(-1, 2), axis=0)
    clock, ends = clock_position(focus), (corners[..., 0].min(), corners[..., 0].max())
    with drawing(float(np.clip(8.6 * tall / wide + 0.9, 2.4, 7))) as figure:
        axes = figure.subplots()
        cells: Any = flat[order]  # an array is taken whole, though the stubs ask for a list
        axes.add_collection(PolyCollection(cells, facecolors=colors, edgecolors=colors, linewidths=0.3))
        axes.autoscale_view()
        axes.set_aspect("equal")
        axes.set_axis_off()
        axes.set_title(f"Reconstructed wall from {ends[0]:.0f} mm (left) to {ends[1]:.0f} mm, cut open to show {clock}")
        _scale_bar(axes, flat)
        figure.colorbar(scale, ax=axes, label="deviation (mm)", fraction=0.02, pad=0.01)
        return to_picture(
            figure,
            f"The reconstructed pipe in space, the half around {clock} seen from inside and coloured by wall deviation "
            f"up to {high:.1f} mm; holes are places that were not seen.",
            f"The half of the wall around {clock} seen from inside, depths drawn {DEPTH_DRAWN:g} times as deep. Open "
            "places were not seen.",
            shaded=True,
        )


def _focus_rad(defects: tuple[Defect, ...]) -> float:
    """The clock position to look at: the deepest defect's, or 6 o'clock."""
    return max(defects, key=lambda defect: defect.depth_mm).theta_rad if defects else np.pi


def _half_pipe(
    wall: WallMap, deviation_mm: Float[np.ndarray, "around along"], focus_rad: float, radius_mm: float
) -> tuple[Float[np.ndarray, "n 4 3"], Float[np.ndarray, "n"]]:
    """The seen cells of the half wall around `focus_rad` as quadrilaterals (along, away, up), and their depths."""
    touched = wall.touched()
    length = touched.stop - touched.start
    columns = touched.start + np.unique(np.linspace(0, length - 1, VIEW_STRIPES[1]).astype(int))
    turn = np.linspace(-np.pi / 2, np.pi / 2, VIEW_STRIPES[0])
    around = np.floor(np.mod(turn + focus_rad, 2 * np.pi) / (2 * np.pi) * wall.theta_rad.size).astype(int)
    some = np.array([line[columns] for (line,) in lines(deviation_mm)])
    depth = some[around % wall.theta_rad.size]
    drawn = radius_mm + DEPTH_DRAWN * np.nan_to_num(depth)
    along = np.broadcast_to(wall.z_mm[columns], drawn.shape)
    # the focus lies straight away from the reader; downstream to the right, so clockwise is downward
    point = np.stack([along, drawn * np.cos(turn)[:, None], -drawn * np.sin(turn)[:, None]], axis=-1)
    quads = np.stack([point[:-1, :-1], point[1:, :-1], point[1:, 1:], point[:-1, 1:]], axis=2).reshape(-1, 4, 3)
    corner = np.isfinite(depth)
    whole = (corner[:-1, :-1] & corner[1:, :-1] & corner[1:, 1:] & corner[:-1, 1:]).ravel()
    return quads[whole], depth[:-1, :-1].ravel()[whole]


def _seen_from_the_side(
    corners: Float[np.ndarray, "n 4 3"],
) -> tuple[Float[np.ndarray, "n 4 2"], Float[np.ndarray, "n"]]:
    """The cells in the plane of the paper, and how far away each is."""
    (sin_yaw, sin_pitch), (cos_yaw, cos_pitch) = np.sin(VIEW_RAD), np.cos(VIEW_RAD)
    along, away, up = np.moveaxis(corners, -1, 0)
    across, back = cos_yaw * along + sin_yaw * away, cos_yaw * away - sin_yaw * along
    flat = np.stack([across, cos_pitch * up + sin_pitch * back], axis=-1)
    return flat, np.mean(cos_pitch * back - sin_pitch * up, axis=1)


def _lit(colors: Float[np.ndarray, "n 3"], corners: Float[np.ndarray, "n 4 3"]) -> Float[np.ndarray, "n 3"]:
    """Colours under a lamp beside the reader, so that the shape shows."""
    normal = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    facing = np.abs(normal @ LAMP)[:, None]
    return np.clip(colors * (0.55 + 0.45 * facing) + 0.30 * facing**6, 0, 1)


def _scale_bar(axes: Axes, flat: Float[np.ndarray, "n 4 2"]) -> None:
    left, bottom = flat.reshape(-1, 2).min(axis=0)
    length = 100 * float(np.cos(VIEW_RAD[0]))
    axes.plot([left, left + length], [bottom - 12, bottom - 12], color=BLACK, linewidth=2)
    axes.text(left + length + 8, bottom - 12, "100 mm along the pipe", va="center", fontsize=9)
