"""Which cause hurts which estimator: one drive a cause, measured by every estimator, against the truth."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.localisation import (
    AccelSettings,
    FeaturedSettings,
    FusedSettings,
    PaperSettings,
    SlipSettings,
)
from algorithms.localisation.fused_model import WheelSettings
from algorithms.localisation.slip import fit_line
from algorithms.localisation.wheels import calibrate_wheels, wheel_distances_mm
from algorithms.reconstruct import ReconstructionFailed, finish
from algorithms.types import Episode
from scenarios.bench.scans import Scan, take_scan
from scenarios.load import load_scenario
from scenarios.report.plain_rows import text_table, write_rows
from scenarios.run import RunFailed, fold, provenance
from scenarios.run_folder import run_folder
from scenarios.score import score

Report = Callable[[str, int, int], None]
Row = dict[str, Any]

JOINTS_MM = (500.0, 1100.0)
BASE = (
    "sensing.fidelity=points",
    "sensing.frame_rate_hz=10",
    "pipe.end_mm=2000",
    "drive.end_mm=1500",
    "pipe.joints=[{distance_mm: 500, gap_mm: 6, gap_depth_mm: 2}, {distance_mm: 1100, gap_mm: 6, gap_depth_mm: 2}]",
    "pipe.features=[{kind: pocket, distance_mm: 300, clock_deg: '4:00', length_mm: 50, width_mm: 35, depth_mm: 4}, "
    "{kind: pit, distance_mm: 800, clock_deg: '5:00', diameter_mm: 30, depth_mm: 4, shape: conical}, "
    "{kind: pocket, distance_mm: 1350, clock_deg: '8:00', length_mm: 50, width_mm: 35, depth_mm: 4}]",
)
CAUSES: dict[str, tuple[str, ...]] = {
    "none": (),
    "worn wheels, 1 %": ("robot.wheel_diameter_error_pct=[-1.2, -1, -0.8]",),
    "one wheel 3 % small": ("robot.wheel_diameter_error_pct=[-3, 0, 0]",),
    "missed counts, 1 %": ("sensing.encoders.missed_share=0.01",),
    "motor stalled 3 s": ("drive.faults=[{leg: 0, start_s: 12, duration_s: 3}]",),
    "wet stretch, tether": (
        "drive.tether_drag_n=5",
        "pipe.surfaces=[{from_mm: 500, to_mm: 1000, state: wet, creep_pct: 3}]",
    ),
    "debris": ("pipe.debris=[{distance_mm: 600, clock_deg: 180, diameter_mm: 25, height_mm: 3}]",),
    "rolls by 25 deg": ("drive.roll_to=[{start_s: 12, to_deg: 25}]",),
    "attitude in steps of 0.01": ("sensing.imu.update_rate=15", "sensing.imu.quaternion_rounding=0.01"),
    "gyroscope bias, 1 deg/s": ("sensing.imu.gyroscope_bias_deg_s=1",),
    "accelerometer bias, 20 mg": ("sensing.imu.accelerometer_bias_m_s2=0.2",),
    "frames lost, 10 %": ("sensing.timing.dropped_share=0.1",),
}
NOT_IN_CALIBRATION = ("motor stalled 3 s",)  # what goes wrong for once: nobody calibrates on it
KNOWN, JOINTED = "fused, calibrated", "featured, joints"
CALIBRATION_SEEDS = (1000, 1001)
FIGURES = {"distance_error_pct": "distance %", "roll_rms_deg": "roll deg", "depth_error_mm": "depth mm"}
NOTE = (
    "distance: end of travel against the truth, % of travel; roll: RMS against the true roll; depth: largest error of\n"
    "the defects that were found. `slip` (Eq. 27) and `fused, calibrated` learn from two other drives with the same\n"
    "cause; `featured, joints` has the joints' places. A dash: no map."
)


def bench(causes: list[str], seeds: int, out: Path, workers: int, progress: Report) -> list[Row]:
    """Every estimator over every cause; rows into a folder.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: for a cause that is not known, or a drive that fails.
    """
    unknown = [cause for cause in causes if cause not in CAUSES]
    if unknown:
        raise RunFailed(f"no cause is called {unknown[0]!r}; there are {', '.join(map(repr, CAUSES))}")
    with run_folder(out) as folder:
        start = time.perf_counter()
        rows = [row for cause in causes or list(CAUSES) for row in _of_cause(cause, seeds, workers, progress)]
        write_rows(rows, folder / "localisation")
        seconds = {"localisation": round(time.perf_counter() - start, 3)}
        made = provenance(load_scenario("paper-robot", BASE), seconds, {})
        (folder / "run.json").write_text(json.dumps(made, indent=1) + "\n")
    return rows


def _of_cause(cause: str, seeds: int, workers: int, progress: Report) -> Iterator[Row]:
    changes = [*BASE, *CAUSES[cause]]
    alike = [*BASE] if cause in NOT_IN_CALIBRATION else changes
    others = [take_scan(load_scenario("paper-robot", alike, seed), workers, progress) for seed in CALIBRATION_SEEDS]
    for seed in range(seeds):
        scan = take_scan(load_scenario("paper-robot", changes, seed), workers, progress)
        for name, settings in contenders(others).items():
            progress(f"{cause}, {name}", seed + 1, seeds)
            joints_mm = JOINTS_MM if name == JOINTED else ()
            yield {"cause": cause, "seed": seed, "estimator": name, **measured(told(scan, joints_mm), settings)}


def contenders(others: list[Scan]) -> dict[str, Any]:
    """Every estimator as it comes, and those that can learn from other drives as they are then."""
    line = fit_line(*map(np.concatenate, zip(*map(speeds_mm_s, others), strict=True)))
    wheels = calibrate_wheels(*map(np.array, zip(*map(lengths_mm, others), strict=True)))
    calibrated = WheelSettings(**wheels._asdict(), scale_std_pct=0.1)
    return {
        "paper": PaperSettings(),
        "accel": AccelSettings(),
        "slip": SlipSettings(**line._asdict()),
        "fused": FusedSettings(),
        KNOWN: FusedSettings(wheels=calibrated),
        "featured": FeaturedSettings(),
        JOINTED: FeaturedSettings(),
    }


def told(scan: Scan, joints_mm: tuple[float, ...]) -> Scan:
    """The scan with the joints' places written down for whoever measures it."""
    pipe = scan.recording.pipe.model_copy(update={"joints_mm": joints_mm})
    return replace(scan, recording=replace(scan.recording, pipe=pipe))


def _rolled_mm(scan: Scan) -> np.ndarray:
    frames = (scan.recording.frame(k) for k in range(len(scan.recording)))
    return np.array([wheel_distances_mm(frame.counts, scan.recording.rig) for frame in frames])


def speeds_mm_s(scan: Scan) -> tuple[np.ndarray, np.ndarray]:
    """Rolling speed of the middle wheel and speed over ground, frame by frame: what a calibration drive gives."""
    dt = np.diff(scan.recording.frame_stamps_ns) / 1e9
    return np.median(np.diff(_rolled_mm(scan), axis=0), axis=1) / dt, np.diff(scan.T_true[:, 2, 3]) / dt


def lengths_mm(scan: Scan) -> tuple[np.ndarray, float]:
    """What each wheel rolled and how far the robot went, from end to end."""
    rolled = _rolled_mm(scan)
    return rolled[-1] - rolled[0], float(scan.T_true[-1, 2, 3] - scan.T_true[0, 2, 3])


def measured(scan: Scan, settings: Any) -> Row:
    """Distance, roll and depth errors of a scan by an estimator, and its episodes by name."""
    method = scan.scenario.method.model_copy(update={"localisation": settings})
    state, tally = fold(scan.scenario.model_copy(update={"method": method}), scan.truth, scan.recording, scan.seen)
    try:
        found = finish(state)
    except ReconstructionFailed:
        return {**dict.fromkeys(FIGURES), "episodes": ""}
    row = score(found, scan.truth, tally)
    return {
        "distance_error_pct": row.distance_error_pct,
        "roll_rms_deg": row.roll_rms_deg,
        "depth_error_mm": row.depth_error_mm_max,
        "episodes": "; ".join(map(said, found.episodes)),
    }


def said(episode: Episode) -> str:
    """An episode in words."""
    unit = "s" if episode.kind == "gap" else "mm"
    return f"{episode.kind}: {episode.who}, from {episode.start_ns / 1e9:.1f} s, {episode.amount:+.1f} {unit}"


def words(rows: list[Row]) -> str:
    """A table a figure: causes by estimators, medians over the seeds."""
    names = list(dict.fromkeys(row["estimator"] for row in rows))
    tables = []
    for key, title in FIGURES.items():
        lines = []
        for cause in dict.fromkeys(row["cause"] for row in rows):
            of = {name: [r[key] for r in rows if r["cause"] == cause and r["estimator"] == name] for name in names}
            lines.append({"cause": cause, **{name: _median(values) for name, values in of.items()}})
        tables.append(text_table(lines, {"cause": "cause", **{name: name for name in names}}, title))
    return "\n\n".join([*tables, NOTE])


def _median(values: list[float | None]) -> float | None:
    there = [value for value in values if value is not None]
    return float(np.median(there)) if there else None
