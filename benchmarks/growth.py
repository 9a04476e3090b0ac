"""Do the stated intervals of growth hold, and how often does a sound rig fail its check: over many seeds, in points."""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from algorithms.reconstruct import reconstruct
from scenarios.field.match import SIZES, matched
from scenarios.field.spool import CertifiedDefect, Spool
from scenarios.field.verify import check_of
from scenarios.found_run import FoundRun, found_of
from scenarios.load import load_scenario
from scenarios.scenario import nominal_pipe
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate

POCKETS = ((150.0, 120.0), (230.0, 240.0))
BASE = ("sensing.fidelity=points", "pipe.end_mm=520", "drive.stages=[{to_mm: 230}]")


def scan(sizes: list[tuple[float, float, float]], seed: int, offset_mm: tuple[float, float]) -> FoundRun:
    """Two pockets of given lengths, widths and depths, measured."""
    features = ", ".join(
        f"{{kind: pocket, distance_mm: {z}, clock_deg: {clock}, length_mm: {a}, width_mm: {b}, depth_mm: {c}}}"
        for (z, clock), (a, b, c) in zip(POCKETS, sizes, strict=True)
    )
    changes = [*BASE, f"pipe.features=[{features}]", f"drive.offset_mm=[{offset_mm[0]}, {offset_mm[1]}]"]
    s = load_scenario("paper-gantry", changes, seed)
    truth = simulate(s.pipe, s.robot, s.drive, stream(seed, "drive"))
    with TemporaryDirectory() as place:
        list(sense(truth, s.rig, s.rig, nominal_pipe(s), s.sensing, seed, Path(place)))
        log = open_recording(Path(place))
        found = reconstruct((log[k] for k in range(len(log))), log.rig, log.pipe, s.method)
    return found_of(Path(f"seed {seed}"), found)


def certificate(sizes: list[tuple[float, float, float]]) -> Spool:
    """A certificate that says the truth."""
    open_mm = {f"{name}_u95_mm": 0.02 for name in SIZES}
    defects = [
        CertifiedDefect(name=str(z), distance_mm=z, clock_deg=clock, length_mm=a, width_mm=b, depth_mm=c, **open_mm)
        for (z, clock), (a, b, c) in zip(POCKETS, sizes, strict=True)
    ]
    return Spool(
        name="spool", inner_radius_mm=76.2, inner_radius_u95_mm=0.01, wall_thickness_mm=7.5, defects=tuple(defects)
    )


def main(pairs: int) -> None:
    """Print coverage and false alarms."""
    rng, held, inside = np.random.default_rng(0), {name: [] for name in SIZES}, []
    for seed in range(pairs):
        before = [tuple(rng.uniform((25, 20, 1), (45, 35, 4))) for _ in POCKETS]
        grown = [tuple(np.add(size, rng.uniform((0, 0, 0), (6, 5, 1.5)))) for size in before]
        runs = [scan(sizes, 2 * seed + k, tuple(rng.uniform(-4, 4, 2))) for k, sizes in enumerate((before, grown))]
        rows = matched(*runs).rows
        for row, a, b in zip(rows, before, grown, strict=True):
            for k, name in enumerate(SIZES):
                growth = row.growth[name]
                half = growth.half_width_mm
                held[name].append(half is not None and abs(growth.change_mm - (b[k] - a[k])) <= half)
        inside += [check_of(run, certificate(sizes)).verdict for run, sizes in zip(runs, (before, grown), strict=True)]
    for name in SIZES:
        print(f"{name}: {sum(held[name])} of {len(held[name])} intervals of growth hold the true one (95 % stated)")
    print(f"checks of a sound rig: {inside.count('inside')} of {len(inside)} inside")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20)
