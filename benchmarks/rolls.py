"""Fig. 12's two roll experiments over many seeds: the angle left between two defects in line, median and worst."""

from __future__ import annotations

import argparse

import numpy as np

from scenarios.bench.scans import take_scan
from scenarios.load import load_scenario
from scenarios.paper.fig12 import COARSE, SCENARIOS, WITH, WITHOUT, angle_deg, logs
from scenarios.report.plain_rows import text_table

ASKED = (("paper", WITH), ("paper", COARSE), ("paper", WITHOUT), ("fused", WITH), ("fused", COARSE), ("fused", WITHOUT))


def _quiet(stage: str, done: int, total: int) -> None:
    """Progress that nobody watches."""


def main() -> None:
    """Drive both experiments with every seed, measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("seeds", type=int, nargs="?", default=10)
    parser.add_argument("--fidelity", choices=("points", "picture", "raycast"), default="points")
    args = parser.parse_args()
    table = []
    for name in SCENARIOS.values():
        angles: dict[tuple[str, str], list[float]] = {one: [] for one in ASKED}
        for seed in range(args.seeds):
            scan = take_scan(load_scenario(name, [f"sensing.fidelity={args.fidelity}"], seed), 1, _quiet)
            of_imu = logs(scan)
            for estimator, imu in ASKED:
                angle = angle_deg(scan, of_imu[imu], estimator)
                angles[estimator, imu].append(np.nan if angle is None else angle)
            print(name, seed, *(f"{one[0]}, {one[1]}: {values[-1]:.3f};" for one, values in angles.items()), flush=True)
        for (estimator, imu), values in angles.items():
            row = {"scenario": name, "estimator": estimator, "imu": imu}
            table.append({**row, "median": float(np.median(values)), "worst": float(np.max(values))})
    columns = {
        "scenario": "scenario",
        "estimator": "estimator",
        "imu": "IMU",
        "median": "deg, median",
        "worst": "worst",
    }
    print(text_table(table, columns))


if __name__ == "__main__":
    main()
