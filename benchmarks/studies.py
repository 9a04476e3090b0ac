"""What a study costs beside its runs: planning, the ledger, the overhead of a run, the start of a resumed study."""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from hashlib import sha256
from pathlib import Path

from scenarios.study.ledger import FILE, Ledger, Outcome, PlannedRun

ROOT = Path(__file__).resolve().parents[1]
STUDY = """
name: many
base: paper-gantry
set: {{sensing.fidelity: points}}
factors:
  sensing.points.pixel_noise_px: [0.1, 0.2]
design: {{kind: grid, seeds: {seeds}}}
"""
DRIVER = """
import os, sys, time
started = time.time()
from pathlib import Path
from scenarios.study import conduct as study

study.write_page = lambda *_, **__: None
most = int(sys.argv[3])

class Enough(Exception):
    pass

def said(stage, done, total):
    global started
    if started:
        print(time.time() - started, flush=True)
        started = 0
    if done >= most:
        print(time.time(), flush=True)
        raise Enough

try:
    study.conduct(Path(sys.argv[1]), Path(sys.argv[2]), study.How(int(sys.argv[4]), make="standin:maker"), said, print)
except Enough:
    pass
"""
FIGURES: list[float | int | None] = [0.1234567890123 * k for k in range(29)]
DEFECTS = [[70.0, 35.0, 7.5, 70.123456789, 35.123456789, 7.523456789]] * 2
BATCH = 1000


def main() -> None:
    """Measure and print."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--rows", type=int, nargs="*", default=[100_000, 1_000_000])
    asked = words.parse_args()
    for rows in asked.rows:
        with tempfile.TemporaryDirectory() as folder:
            synthetic(Path(folder), rows)
    with tempfile.TemporaryDirectory() as folder:
        resumed(Path(folder), 100_000)
    with tempfile.TemporaryDirectory() as folder:
        overhead(Path(folder), 4000)


def synthetic(folder: Path, rows: int) -> None:
    """A ledger of so many made-up rows, each of 29 figures and two defects."""
    start = time.perf_counter()
    with Ledger(folder) as ledger:
        ledger.plan((PlannedRun(_key(i), i // 2, "ab"[i % 2], i, (0.1 * i, "x")) for i in range(rows)), {"x": 1})
        print(f"{rows} rows: entered as planned in {time.perf_counter() - start:.1f} s")
        few = min(rows, 5000)
        start = time.perf_counter()
        for i in range(few):
            ledger.started([_key(i)])
            ledger.finished([Outcome(_key(i), 1.0, FIGURES, DEFECTS)])
        print(f"{rows} rows: {1000 * (time.perf_counter() - start) / few:.3f} ms a run to note start and end")
        for first in range(few, rows * 9 // 10, BATCH):
            ledger.finished([Outcome(_key(i), 1.0, FIGURES, DEFECTS) for i in range(first, first + BATCH)])
    print(f"{rows} rows: {(folder / FILE).stat().st_size / 1e6:.0f} MB on disk")
    start = time.perf_counter()
    with Ledger(folder) as ledger:
        ledger.recover()
        counts, job = ledger.counts(), next(ledger.todo())
        print(
            f"{rows} rows: opened, recovered, counted {counts} and first job (point {job.point}) read "
            f"in {time.perf_counter() - start:.3f} s"
        )
        start = time.perf_counter()
        read = sum(1 for _ in ledger.rows())
        print(f"{read} rows: read in the order of their keys in {time.perf_counter() - start:.1f} s")


def resumed(folder: Path, rows: int) -> None:
    """From the start of the program to the first worker started, with so many rows of which nine tenths are done."""
    study = folder / "study.yaml"
    study.write_text(STUDY.format(seeds=rows // 2))
    planned_s, _ = _drive(study, folder / "out", 0, 1)
    with Ledger(folder / "out") as ledger:
        keys = [job.key for job in ledger.todo()][: rows * 9 // 10]
        for first in range(0, len(keys), BATCH):
            ledger.finished([Outcome(key, 1.0, FIGURES, DEFECTS) for key in keys[first : first + BATCH]])
    again_s = [_drive(study, folder / "out", 0, 1)[0] for _ in range(3)]
    print(f"{rows} rows: first start {planned_s:.2f} s, planning included; resumed in {min(again_s):.2f} s (best of 3)")


def overhead(folder: Path, runs: int) -> None:
    """Engine and ledger together, for runs that do nothing."""
    study = folder / "study.yaml"
    study.write_text(STUDY.format(seeds=runs))
    for workers in (1, 2):
        begin_s, end_s = _drive(study, folder / f"out{workers}", runs, workers)
        print(f"{runs} empty runs on {workers} processes: {1000 * (end_s - begin_s) / runs:.2f} ms a run")


def _drive(study: Path, out: Path, runs: int, workers: int) -> tuple[float, float]:
    """Seconds to the first job, and from there to the end of so many runs (after the first job's start)."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "campaigns"), os.environ.get("PYTHONPATH", "")])
    words = [sys.executable, "-c", DRIVER, str(study), str(out), str(runs), str(workers)]
    begin = time.time()
    done = subprocess.run(words, env={**os.environ, "PYTHONPATH": path}, capture_output=True, text=True, check=True)
    numbers = [float(line) for line in done.stdout.splitlines() if line.replace(".", "").isdigit()]
    return numbers[0], numbers[1] - begin


def _key(number: int) -> str:
    return sha256(str(number).encode()).hexdigest()[:32]


if __name__ == "__main__":
    main()
