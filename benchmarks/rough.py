"""Ten metres of a rough drive by every estimator, over many seeds: medians, the worst, and how honest they are."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from algorithms.localisation import FeaturedSettings, FusedSettings, PaperSettings
from algorithms.localisation.fused_model import WheelSettings
from algorithms.localisation.wheels import calibrate_wheels
from scenarios.bench.localisation import lengths_mm, measured, told
from scenarios.bench.scans import take_scan
from scenarios.load import load_scenario
from scenarios.report.plain_rows import text_table
from scenarios.scenario import Scenario

FIGURES = {"distance_error_pct": "distance, %", "roll_rms_deg": "roll RMS, deg"}
CALIBRATION_WET_MM = (900, 1000, 1100, 1200)
CALIBRATION = (
    "pipe.end_mm=3400",
    "pipe.joints=[]",
    "drive.end_mm=3000",
    "drive.faults=[]",
    "sensing.points.azimuths=36",
)
CUT = ("pipe.end_mm=3400", "drive.end_mm=3000", "drive.faults=[{leg: 0, start_s: 25, duration_s: 3}]")
CUT_WET_MM = ((500, 900), (1600, 1900), (2500, 2800))
CUT_JOINTS_MM = (1000.0, 2000.0)


def wet(*stretches: tuple[float, float]) -> str:
    """The change that makes stretches of the pipe wet, and others dry."""
    each = (f"{{from_mm: {a}, to_mm: {b}, state: wet, creep_pct: 3}}" for a, b in stretches)
    return f"pipe.surfaces=[{', '.join(each)}]"


def shorter(fidelity: str) -> list[str]:
    """The drive cut to 3 m, each cause at the same share of the way, for pictures that take their time."""
    gaps = ", ".join(f"{{distance_mm: {z:g}, gap_mm: 6, gap_depth_mm: 2}}" for z in CUT_JOINTS_MM)
    return [*CUT, f"pipe.joints=[{gaps}]", wet(*CUT_WET_MM), f"sensing.fidelity={fidelity}"]


def calibrated() -> WheelSettings:
    """The wheels by four drives of 3 m, of which 0.9 to 1.2 m are wet."""
    drives = (
        load_scenario("rough-10m", [*CALIBRATION, wet((1000, 1000 + length))], 1000 + k)
        for k, length in enumerate(CALIBRATION_WET_MM)
    )
    rolled, went = zip(*(lengths_mm(take_scan(drive, 1, _quiet)) for drive in drives), strict=True)
    found = calibrate_wheels(np.array(rolled), np.array(went))
    scale = ", ".join(f"{value:+.3f}" for value in found.scale_pct)
    print(f"calibration: wheels go {scale} % further than they roll, all +- {found.common_scale_std_pct:.3f} %")
    return WheelSettings(**found._asdict(), scale_std_pct=0.1)


def rows(scenario: Scenario, joints_mm: tuple[float, ...], wheels: WheelSettings) -> Iterator[dict]:
    """One drive by every estimator."""
    scan = take_scan(scenario, 1, _quiet)
    for name, known_mm, settings in (
        ("paper", (), PaperSettings()),
        ("fused", (), FusedSettings()),
        ("fused, calibrated", (), FusedSettings(wheels=wheels)),
        ("featured", (), FeaturedSettings()),
        ("featured, joints", joints_mm, FeaturedSettings()),
        ("featured, joints, calibrated", joints_mm, FeaturedSettings(wheels=wheels)),
    ):
        yield {"seed": scenario.seed, "estimator": name, **measured(told(scan, known_mm), settings)}


def summary(table: list[dict]) -> list[dict]:
    """Median and worst of every figure by every estimator."""
    lines = []
    for name in dict.fromkeys(row["estimator"] for row in table):
        of = {key: np.array([row[key] for row in table if row["estimator"] == name]) for key in FIGURES}
        figures = {
            f"{key} {word}": float(f(of[key]))
            for key in FIGURES
            for word, f in (("median", np.median), ("worst", np.max))
        }
        lines.append({"estimator": name, **figures})
    return lines


def _quiet(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def main() -> None:
    """Drive, measure, and print a row a seed and estimator, then medians and worst."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="?", default=10)
    parser.add_argument("--pictures", action="store_true", help="3 m in pictures in place of 10 m in points")
    parser.add_argument("--out", type=Path, default=Path("bench/rough.json"))
    args = parser.parse_args()
    wheels, table = calibrated(), []
    for seed in range(args.seeds):
        scenario = load_scenario("rough-10m", shorter("picture") if args.pictures else [], seed)
        joints = tuple(joint.distance_mm for joint in scenario.pipe.joints)
        for row in rows(scenario, joints, wheels):
            table.append(row)
            print(json.dumps(row), flush=True)
        args.out.parent.mkdir(parents=True, exist_ok=True)
        args.out.write_text(json.dumps(table, indent=1) + "\n")
    columns = {f"{key} {word}": f"{title}, {word}" for key, title in FIGURES.items() for word in ("median", "worst")}
    print(text_table(summary(table), {"estimator": "estimator", **columns}))


if __name__ == "__main__":
    main()
