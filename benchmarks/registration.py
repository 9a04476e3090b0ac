"""How fast the cylinder fits are, and how near the Cramer-Rao bound, beside peers: ratios from one run on one core."""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np

from algorithms.registration import REGISTRATIONS
from algorithms.registration.cylinder_pose import start_of
from algorithms.registration.ray_fit import TERMS, normal_equations, pack
from algorithms.types import Wall
from scenarios.bench.errors import FAILED_DEG, FAILED_MM, pose_error
from scenarios.bench.frame_bench import frame_errors, odometry, two_frames
from scenarios.bench.frames import CASES, LIMIT_CASES, ROBUST_CASES, FrameCase, TrueFrame
from scenarios.bench.statistics import rows
from sensor_model.recording import NominalPipe

OURS = ("cylinder-map", "cylinder")
TIMED = ("clean", "defect-10", "defect-30", "hard", "points-40000", "points-200000")
LIMIT_MS = {"clean": 0.5, "defect-10": 0.5, "defect-30": 1.1, "hard": 1.1, "points-40000": 1.0, "points-200000": 4.5}
PEERS = Path(__file__).parent / "peers"
RECIPE_SAMPLES, RECIPE_POINTS = 100, 10


class Timing(NamedTuple):
    """Smallest and median of the calls, ms."""

    least: float
    median: float


def one_core() -> None:
    """Stay on one core: the last that we may use."""
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def interleaved(calls: dict[str, Callable[[], object]], rounds: int) -> dict[str, Timing]:
    """Time several calls in turn, so that what else the machine does hits all alike."""
    for call in calls.values():
        call()
    taken: dict[str, list[float]] = {name: [] for name in calls}
    for _ in range(rounds):
        for name, call in calls.items():
            start = time.perf_counter()
            call()
            taken[name].append(1000 * (time.perf_counter() - start))
    return {name: Timing(min(ms), float(np.median(ms))) for name, ms in taken.items()}


def fused_pass(frame: TrueFrame) -> Callable[[], object]:
    """One pass over the points that makes residuals, weights and normal equations: the unit of the tables."""
    points, sums = frame.points, np.empty(TERMS)
    start = start_of(points.xyz_mm, odometry(frame.T_pipe_camera).T_pipe_camera, 76.2)
    packed, _ = pack(points.xyz_mm, points.direction, points.sigma_mm, 0, points.sigma_mm.size, 1)
    residual = np.empty(packed.shape[1])
    return lambda: normal_equations(packed, start, 4.0, sums, residual)


def aligner(name: str, case: FrameCase, frame: TrueFrame) -> Callable[[], object]:
    """One call of a registered method."""
    method = REGISTRATIONS[name]
    wall = Wall(NominalPipe(inner_radius_mm=case.told_radius_mm, wall_thickness_mm=7.5))
    prior, settings = odometry(frame.T_pipe_camera), method.settings()
    return lambda: method.align(frame.points, wall, prior, settings)


def speeds(rounds: int) -> None:
    """Time a frame of several sizes and kinds, as multiples of one fused pass over its own points."""
    print("\nms a frame on one core: least (median), and in fused passes over the same points")
    print(f"  {'case':15s} {'points':>7s} {'pass':>8s}" + "".join(f"{name:>32s}" for name in OURS) + "   asked")
    for name in TIMED:
        case = CASES[name]
        frames = [two_frames(case, seed)[1] for seed in range(5)]
        calls: dict[str, Callable[[], object]] = {"pass": fused_pass(frames[0])}
        for k, frame in enumerate(frames):
            calls |= {f"{ours} {k}": aligner(ours, case, frame) for ours in OURS}
        taken = interleaved(calls, rounds)
        cells = ""
        for ours in OURS:
            least, median = (float(np.median([taken[f"{ours} {k}"][i] for k in range(5)])) for i in range(2))
            cells += f"{least:10.3f} ({median:6.3f}) {least / taken['pass'].least:7.1f} x  "
        print(f"  {name:15s} {case.points:7d} {taken['pass'].least:8.4f} {cells} {LIMIT_MS[name]:5.1f}", flush=True)


def scipy_recipe(frame: TrueFrame, told_mm: float) -> Callable[[], object]:
    """The paper's recipe in plain scipy: RANSAC over least-squares cylinders, then a fit to the inliers (Eq. 10)."""
    from scipy.optimize import least_squares

    xyz = frame.points.xyz_mm
    rng = np.random.default_rng(0)
    start = np.array([0.0, 0.0, 0.0, 0.0, told_mm])
    threshold = 3 * float(np.median(frame.points.sigma_mm)) * 0.45

    def distance(p: np.ndarray, cloud: np.ndarray) -> np.ndarray:
        axis = np.array([p[2], p[3], 1.0]) / np.sqrt(1 + p[2] ** 2 + p[3] ** 2)
        return np.linalg.norm(np.cross(cloud - [p[0], p[1], 0.0], axis), axis=1) - p[4]

    def fit() -> np.ndarray:
        best, most = start, -1
        for _ in range(RECIPE_SAMPLES):
            sample = xyz[rng.integers(len(xyz), size=RECIPE_POINTS)]
            p = least_squares(distance, start, args=(sample,), max_nfev=10).x
            inside = int(np.sum(np.abs(distance(p, xyz)) < threshold))
            if inside > most:
                best, most = p, inside
        return least_squares(distance, best, args=(xyz[np.abs(distance(best, xyz)) < threshold],)).x

    return fit


class Peer(NamedTuple):
    """A library's cylinder fit, as a small C++ program: where its headers may be, and what it is linked with."""

    headers: str
    libraries: tuple[str, ...]
    package: str
    refines: tuple[bool, ...]


PROGRAMS = {
    "pcl": Peer(
        "pcl-*/pcl",
        tuple(f"-lpcl_{part}" for part in ("sample_consensus", "features", "search", "kdtree", "common")),
        "libpcl-dev",
        (False, True),
    ),
    "cgal": Peer("CGAL", ("-lgmp", "-lmpfr"), "libcgal-dev", (False,)),
}


def peer_program(name: str, folder: Path) -> Path | None:
    """A peer's fit, compiled for the processor that its library was; None where this machine lacks it or a compiler."""
    peer, roots = PROGRAMS[name], (Path("/usr/include"), Path("/usr/local/include"))
    headers = sorted(found for root in roots for found in root.glob(peer.headers))
    if not headers or shutil.which("g++") is None:
        print(f"  no {name} here (Debian: {peer.package} and g++)")
        return None
    program = folder / name
    words = ["-O3", "-std=c++17", "-I", str(headers[-1].parent), "-I", "/usr/include/eigen3"]
    made = subprocess.run(
        ["g++", *words, str(PEERS / f"{name}_cylinder.cpp"), "-o", str(program), *peer.libraries],
        capture_output=True,
        text=True,
    )
    if made.returncode:
        print(f"  {name} is here but its peer does not compile: {made.stderr.strip().splitlines()[-1]}")
        return None
    return program


def peer_rows(program: Path, case: FrameCase, frames: list[TrueFrame], refine: bool) -> np.ndarray:
    """A peer on some frames: ms, point, axis, radius."""
    told = [str(case.told_radius_mm), str(3 * case.noise_mm), str(int(refine))]
    clouds = b"".join(np.int64(len(f.points.xyz_mm)).tobytes() + f.points.xyz_mm.tobytes() for f in frames)
    done = subprocess.run([str(program), *told], input=clouds, capture_output=True)
    if done.returncode:
        print(f"  {program.name}'s program ended with {done.returncode}")
        return np.zeros((len(frames), 8))
    return np.array([[float(v) for v in line.split()] for line in done.stdout.decode().splitlines()])


def peer_failures(values: np.ndarray, frames: list[TrueFrame]) -> tuple[int, float]:
    """How many of a peer's fits are off by more than 1 degree or 1 mm, and their median error of the centre."""
    bad, centers = 0, []
    for row, frame in zip(values, frames, strict=True):
        point, axis = row[1:4], row[4:7]
        T = frame.T_pipe_camera
        if not np.linalg.norm(axis) > 0:
            bad += 1
            continue
        axis = axis / np.linalg.norm(axis) * np.sign(axis @ T[2, :3])
        found = np.eye(4)
        found[:3, :3] = np.stack([*_across(axis), axis])
        found[:2, 3] = -found[:2, :3] @ point
        off = pose_error(found, T)
        bad += off.axis_deg > FAILED_DEG or off.center_mm > FAILED_MM
        centers.append(off.center_mm)
    return bad, float(np.median(centers)) if centers else float("nan")


def _across(axis: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    x = np.cross([0.0, 1.0, 0.0], axis)
    x /= np.linalg.norm(x)
    return x, np.cross(axis, x)


def open3d_icp(frame: TrueFrame, before: TrueFrame) -> Callable[[], np.ndarray]:
    """Open3D's point-to-plane ICP of a frame against the one before, whose true pose it is given."""
    from open3d.geometry import KDTreeSearchParamKNN, PointCloud
    from open3d.pipelines.registration import TransformationEstimationPointToPlane, registration_icp
    from open3d.utility import Vector3dVector

    prior = odometry(frame.T_pipe_camera).T_pipe_camera

    def fit() -> np.ndarray:
        source, target = PointCloud(), PointCloud()
        source.points = Vector3dVector(frame.points.xyz_mm)
        target.points = Vector3dVector(before.points.xyz_mm)
        target.transform(before.T_pipe_camera)
        target.estimate_normals(KDTreeSearchParamKNN(200))  # so many that they lie on several rings
        found = registration_icp(source, target, 15.0, prior, TransformationEstimationPointToPlane())
        return np.asarray(found.transformation)

    return fit


def open3d_row(name: str, frames_each: int) -> None:
    """One line for Open3D, where this machine has it."""
    try:
        import open3d  # noqa: F401
    except ImportError:
        return print("  no open3d here (pip install open3d)")
    case, taken, errors = CASES[name], [], []
    for seed in range(frames_each):
        before, frame = two_frames(case, seed)
        fit = open3d_icp(frame, before)
        start = time.perf_counter()
        found = fit()
        taken.append(1000 * (time.perf_counter() - start))
        errors.append(pose_error(found, frame.T_pipe_camera))
    bad = sum(e.axis_deg > FAILED_DEG or e.center_mm > FAILED_MM for e in errors)
    center = float(np.median([e.center_mm for e in errors]))
    line(name, "open3d icp", float(np.median(taken)), bad, frames_each, center)
    return None


def peers(frames_each: int) -> None:
    """Ours beside the cylinder fits of PCL and CGAL, Open3D's ICP and the paper's recipe, on the same frames."""
    print("\npeers on the same frames: median ms, failures, median error of the centre")
    with tempfile.TemporaryDirectory() as folder:
        programs = {name: peer_program(name, Path(folder)) for name in PROGRAMS}
        for name in ("clean", "defect-30", "hard", "outliers-45", "outliers-45-patch"):
            case = CASES[name]
            frames = [two_frames(case, seed)[1] for seed in range(frames_each)]
            for ours in OURS:
                errors = list(frame_errors({name: case}, {ours: REGISTRATIONS[ours].settings()}, frames_each, 1))
                row = rows(errors, "frame")[0]
                line(name, ours, row.ms_median, row.failures, frames_each, row.center_median_mm.median)
            for peer, program in programs.items():
                for refine in PROGRAMS[peer].refines if program is not None else ():
                    values = peer_rows(program, case, frames, refine)
                    bad, center = peer_failures(values, frames)
                    words = f"{peer}, refined" if refine else peer
                    line(name, words, float(np.median(values[:, 0])), bad, frames_each, center)
            if name in ("clean", "defect-30"):
                open3d_row(name, min(frames_each, 10))
                ms = interleaved({"recipe": scipy_recipe(frames[0], case.told_radius_mm)}, 3)["recipe"].median
                print(f"  {name:18s} {'plain scipy recipe':24s} {ms:10.2f} ms")


def line(case: str, method: str, ms: float, bad: int, frames: int, center: float) -> None:
    """One line of the peers' table."""
    print(f"  {case:18s} {method:24s} {ms:10.2f} ms  {bad:4d} of {frames} failed  {center:8.4f} mm", flush=True)


def bounds(frames_each: int) -> None:
    """RMS errors over the Cramer-Rao bound, and failures."""
    print(f"\nRMS over the Cramer-Rao bound ({frames_each} frames each), failures, worst centre")
    settings = {ours: REGISTRATIONS[ours].settings() for ours in OURS}
    for name in [*LIMIT_CASES, *ROBUST_CASES]:
        frames = frames_each if CASES[name].points < 100_000 else max(frames_each // 4, 100)
        errors = list(frame_errors({name: CASES[name]}, settings, frames, 1))
        for row in rows(errors, "frame"):
            ratios = (row.crb_ratio_axis, row.crb_ratio_center, row.crb_ratio_radius)
            shown = "  ".join(f"{r:6.2f}" for r in ratios if r is not None)
            worst = max((e.center_mm for e in errors if e.method == row.method and e.verdict != "failed"), default=0)
            print(f"  {name:22s} {row.method:14s} {shown}  {row.failures:3d} of {frames}  {worst:8.3f} mm", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200, help="frames of each case for the bounds and failures")
    parser.add_argument("--rounds", type=int, default=100, help="rounds of the clock")
    parser.add_argument("--only", choices=("speed", "bounds", "peers"), help="one part alone")
    asked = parser.parse_args()
    one_core()
    model = next(row for row in Path("/proc/cpuinfo").read_text().splitlines() if row.startswith("model name"))
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "scipy"))
    print(f"{os.cpu_count()} x {model.split(': ')[1]}; Python {platform.python_version()}, {libraries}")
    parts = {
        "speed": lambda: speeds(asked.rounds),
        "bounds": lambda: bounds(asked.frames),
        "peers": lambda: peers(min(asked.frames, 100)),
    }
    for name, part in parts.items():
        if asked.only in (None, name):
            part()
    sys.stdout.flush()


if __name__ == "__main__":
    main()
