"""What the paper's figures and tables came to here: read from the folders that their commands wrote."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from scenarios.document import BadInput
from scenarios.paper.checked import Found, verdict
from scenarios.paper.printed import TABLE_2_ERR_PCT, TABLE_2_ERROR_PCT, TABLE_4_QUALITY_PCT
from scenarios.paper.table1 import PAPER

Row = dict[str, Any]
NOT_MADE = Found("not made here yet", "run the command")
ROBOT, GANTRY = "runs/paper-robot-seed0/score.json", "runs/paper-gantry-seed0/score.json"
LARGEST_BYTES = 5_000_000
PAPER_RMSE_RAD = (0.019, 0.022)
PAPER_CLOSENESS_PCT = 0.95


def read(root: Path, file: str) -> Any | None:
    """A result file's content, or None where the command has not been run.

    Raises:
        BadInput: for a file that is there and is no JSON.
    """
    path = root / file
    if not path.is_file():
        return None
    try:
        if path.stat().st_size > LARGEST_BYTES:
            raise BadInput([f"{path}: is larger than {LARGEST_BYTES / 1e6:g} MB"])
        return json.loads(path.read_text())
    except (ValueError, RecursionError) as error:
        raise BadInput([f"{path}: is no JSON: {error}; make it again"]) from error


def fidelity(root: Path, command: str) -> str:
    """How the frames were made that a command's folder rests on; nothing where it rests on none."""
    verb, name = command.split()[:2]
    file = (
        root
        / ("paper" if verb == "paper" else "runs")
        / (name if verb == "paper" else f"{name}-seed0")
        / "scenario.yaml"
    )
    said = re.search(r"^ *fidelity: (\w+)$", file.read_text(), re.MULTILINE) if file.is_file() else None
    return said.group(1) if said else ""


def by(rows: list[Row], key: str, value: Any) -> Row:
    """The row that has a value."""
    return next(row for row in rows if row[key] == value)


def decoded(file: str) -> Callable[[Path], Found]:
    """What reads how many of a run's slit pixels were found, and how many of those are right."""

    def found(root: Path) -> Found:
        figures = read(root, file)
        if figures is None:
            return NOT_MADE
        seen, wrong = 100 * figures["decode_yield"], 100 * figures["wrong_words"]
        said = f"{seen:.1f} % of all slit places found, {wrong:.2f} % of them given to a wrong slit"
        return Found(said, verdict(wrong < 1))

    return found


def registered(root: Path) -> Found:
    """How many of the robot's frames found their place."""
    figures = read(root, ROBOT)
    if figures is None:
        return NOT_MADE
    done, every = figures["frames_registered"], figures["frames"]
    return Found(f"{done} of {every} frames registered", verdict(done == every))


def rebuilt(root: Path) -> Found:
    """Fig. 13: the wall map against the true wall."""
    figures = read(root, ROBOT)
    if figures is None or figures["map_rms_mm"] is None:
        return NOT_MADE
    said = (
        f"map against the true wall {figures['map_rms_mm']:.3f} mm RMS, {100 * figures['seen_share']:.1f} % of it seen"
    )
    return Found(said, verdict(figures["map_rms_mm"] < 0.5))


def fig5(root: Path) -> Found:
    """The isolated defect, point by point."""
    rows = read(root, "paper/fig5/fig5.json")
    if rows is None:
        return NOT_MADE
    row = by(rows, "method", "cylinder")
    said = f"{row['recall_pct']:.1f} % of the defect's points set apart, {row['precision_pct']:.1f} % of those right"
    return Found(said, verdict(row["recall_pct"] > 99))


def mount(root: Path) -> Found:
    """Fig. 6: the mount that the calibration found."""
    run = read(root, "paper/fig7/run.json")
    if run is None:
        return NOT_MADE
    return Found(f"mount off by {run['mount_error_deg']:.3f} deg", verdict(run["mount_error_deg"] < 0.3))


def fig7(root: Path) -> Found:
    """Rotation by camera and IMU."""
    run = read(root, "paper/fig7/run.json")
    if run is None:
        return NOT_MADE
    rmse = run["rmse_rad"]
    said = ", ".join(f"{value:.4f}" for value in rmse)
    return Found(f"RMSE {said} rad on blocks left out", "better" if max(rmse) < PAPER_RMSE_RAD[0] else verdict(False))


def fig11(root: Path) -> Found:
    """How far each cloud's frames stand beside their true place."""
    rows = read(root, "paper/table1/table1.json")
    if rows is None or not (root / "paper/fig11/fig11.png").is_file():
        return NOT_MADE
    names = ("ellipsoid", "icp, plane start", "cylinder")
    off = [by(rows, "method", name)["center_rms_mm"] for name in names]
    said = ", ".join(f"{name} {value:.3g} mm" for name, value in zip(names, off, strict=True))
    return Found(f"centres off by {said} RMS", verdict(off[2] == min(off)))


def fig12(root: Path) -> Found:
    """The angle left between two defects."""
    rows = read(root, "paper/fig12/fig12.json")
    if rows is None:
        return NOT_MADE
    angles = {}
    for estimator in ("paper", "fused"):
        row = next(r for r in rows if r["estimator"] == estimator and r["imu"] == "with IMU")
        angles[estimator] = (row["angle_8_deg"], row["angle_25_deg"])
    if any(angle is None for pair in angles.values() for angle in pair):
        return Found("a defect was not found", verdict(False))
    said = "; ".join(f"{name} {a:.2f} and {b:.2f} deg" for name, (a, b) in angles.items())
    return Found(said, "better" if max(angles["paper"]) < 2.3 else verdict(False))


def fig14(root: Path) -> Found:
    """Blind Err beside the oracle's."""
    rows = read(root, "paper/fig14/fig14.json")
    if rows is None:
        return NOT_MADE
    blind, oracle = (next(r for r in rows if r["chosen"].startswith(way)) for way in ("blind", "the true size"))
    said = f"Err blind {blind['err_pct']:.2f} %, by the true size {oracle['err_pct']:.2f} %"
    return Found(said, "better blind" if blind["err_pct"] <= oracle["err_pct"] else "the oracle is better")


def fig15(root: Path) -> Found:
    """The depth over the background."""
    rows = read(root, "paper/fig15/fig15.json")
    if rows is None:
        return NOT_MADE
    measured, true = (by(rows, "what", f"depth, {which}") for which in ("measured", "true"))
    said = f"{measured['mm']:.2f} +- {measured['std_mm']:.2f} mm of {true['mm']:g} mm"
    return Found(said, verdict(abs(measured["mm"] - true["mm"]) <= 0.3))


def fig17(root: Path) -> Found:
    """Wall losses as the map shows them."""
    rows = read(root, "paper/fig17/fig17.json")
    if rows is None:
        return NOT_MADE
    said = ", ".join(f"{row['measured_loss_pct']:.1f} of {row['wall_loss_pct']:.0f} %" for row in rows)
    worst = max(abs(row["measured_loss_pct"] - row["wall_loss_pct"]) for row in rows)
    return Found(said, verdict(worst <= 10))


def fig18(root: Path) -> Found:
    """Scratches found, and the worst depth."""
    rows = read(root, "paper/fig18/fig18.json")
    if rows is None:
        return NOT_MADE
    seen = [row for row in rows if row["disposition"] != "missed"]
    if not seen:
        return Found(f"none of {len(rows)} scratches found", verdict(False))
    worst = max(abs(row["found_depth_mm"] - row["depth_mm"]) for row in seen)
    return Found(f"{len(seen)} of {len(rows)} found, depths within {worst:.2f} mm", verdict(len(seen) == len(rows)))


def table1(root: Path) -> Found:
    """The paper's three figures of the cylinder fit."""
    rows = read(root, "paper/table1/table1.json")
    if rows is None:
        return NOT_MADE
    row = by(rows, "method", "cylinder")
    ours = row["normal_variance"], row["center_variance_mm2"], row["radius_closeness_pct"]
    said = f"cylinder {ours[0]:.2g}, {ours[1]:.3f} mm2, {ours[2]:.2f} %"
    order = row["center_rms_mm"] == min(by(rows, "method", name)["center_rms_mm"] for name in PAPER)
    return Found(said, "same order, by the errors; these figures cannot rank" if order else verdict(False))


def closeness(root: Path) -> Found:
    """Eq. 28 of the cylinder fit."""
    rows = read(root, "paper/table1/table1.json")
    if rows is None:
        return NOT_MADE
    row = by(rows, "method", "cylinder")
    own, wall = row["radius_closeness_pct"], row["radius_closeness_wall_pct"]
    return Found(
        f"{own:.2f} %; without the defects' points {wall:.4f} %",
        "better" if own < PAPER_CLOSENESS_PCT else verdict(False),
    )


def table2(root: Path) -> Found:
    """Eqs 29 and 30 at worst over six scans."""
    rows = read(root, "paper/table2/table2.json")
    if rows is None:
        return NOT_MADE
    err, error = (max(row[key] for row in rows) for key in ("err_pct", "error_pct"))
    held = err < max(TABLE_2_ERR_PCT) and error < max(TABLE_2_ERROR_PCT)
    return Found(f"Err {err:.2f} %, Error {error:.2f} % at worst, blind", "better" if held else verdict(False))


def table4(root: Path) -> Found:
    """Eq. 32 by wall loss."""
    rows = read(root, "paper/table4/table4.json")
    if rows is None:
        return NOT_MADE
    ours = [by(rows, "wall_loss_pct", loss)["quality_pct"] for loss in (75.0, 50.0, 25.0)]
    held = bool(np.all(np.array(ours) > TABLE_4_QUALITY_PCT))
    return Found(" / ".join(f"{value:.1f}" for value in ours) + " %", "better" if held else verdict(False))
