"""How much memory a long pipe's map, its sizing and its files take: the most that is resident in each stage."""

from __future__ import annotations

import argparse
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from algorithms.hindsight import straightened
from algorithms.method import Method
from algorithms.reconstruct import sized, trajectory
from algorithms.types import Alignment, FrameResult, RingPoints
from algorithms.wall_map import MapBuilder, add_points, finish_map
from scenarios.artefacts import write_reconstruction
from sensor_model.geometry import transform, wall_direction
from sensor_model.recording import NominalPipe
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

EVERY_MM = 60.0  # 50 defects in 3 m
STRUT_DEG = 37.0
FRAME_MM = 10.0  # of wall that each frame brings
NOISE_MM = 0.1
LOOKS = 3  # points a cell
KINDS = (
    {"kind": "pocket", "length_mm": 30, "width_mm": 20, "depth_mm": 3},
    {"kind": "pit", "diameter_mm": 20, "depth_mm": 4},
)


@contextmanager
def told(name: str) -> Iterator[None]:
    """Print the most that was resident meanwhile, and the processor's time."""
    Path("/proc/self/clear_refs").write_text("5")  # the peak begins anew
    began, before = time.process_time(), resident_mb("VmRSS")
    yield
    took = time.process_time() - began
    print(f"  {name:12s} {resident_mb('VmHWM'):8.0f} MB at most, {before:6.0f} before, {took:7.2f} s", flush=True)


def resident_mb(what: str) -> float:
    """A figure of this process as the kernel has it: `VmRSS`, or its peak `VmHWM`."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return float(next(line for line in lines if line.startswith(what)).split()[1]) / 1024


def walls(length_mm: float, rng: np.random.Generator) -> Iterator[RingPoints]:
    """Points of one frame after the other, in the pipe frame; what repeats is defects and the strut's sector."""
    features = [KINDS[k % 2] | {"distance_mm": 300 + EVERY_MM * k, "clock_deg": 75 + 105 * (k % 3)} for k in range(10)]
    pipe = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, start_mm=-100, end_mm=1200, features=features)
    theta = np.radians(np.arange(STRUT_DEG / 2, 360 - STRUT_DEG / 2, 1.0 / LOOKS))
    for first in np.arange(0, length_mm, FRAME_MM):
        z = first + np.arange(0.5, FRAME_MM)
        around, along = (part.ravel() for part in np.meshgrid(theta, z))
        repeated = 300 - EVERY_MM / 2 + np.mod(along - 300 + EVERY_MM / 2, 10 * EVERY_MM)
        radius = pipe.radius(around, repeated) + rng.normal(0, NOISE_MM, around.size)
        xyz = wall_direction(around) * radius[:, None]
        xyz[:, 2] = along
        light = wall_direction(around) * 0.5 + [0, 0, 0.8]
        n = around.size
        yield RingPoints(xyz, np.zeros(n, np.int64), np.zeros((n, 2)), light, np.full(n, NOISE_MM / 0.5))


def measured(length_m: float, method: Method, folder: Path) -> None:
    """Map, straighten, size and write one pipe."""
    nominal = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
    rig, builder, results = preset_rig(), MapBuilder(method.map), []
    print(f"{length_m:g} m, {resident_mb('VmRSS'):.0f} MB before")
    with told("frames"):
        for k, points in enumerate(walls(1000 * length_m, np.random.default_rng(0))):
            add_points(builder, points, np.ones(points.sigma_mm.size, dtype=bool), Alignment(np.eye(4), np.eye(6)))
            pose = Alignment(transform(np.eye(3), np.array([0, 0, FRAME_MM * k])), np.eye(6), evidence=np.eye(6))
            results.append(FrameResult(k, k * 66_000_000, _NONE, np.zeros(0, bool), pose, 1.0))
    with told("map"):
        wall = finish_map(builder)
    with told("look back"):
        z_mm = FRAME_MM * np.arange(len(results))
        wall = straightened(wall, z_mm, np.column_stack([0.001 * z_mm, 1e-6 * z_mm]), 0.0)
    with told("size"):
        found = sized(trajectory(results), wall, rig, nominal, method)
    with told("write"):
        write_reconstruction(found, folder)
    print(f"  {len(found.defects)} defects")


_NONE = RingPoints(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))


def main() -> None:
    """One length after the other; each in a process of its own shows its own figures only."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("length_m", type=float)
    words.add_argument("--set", nargs="*", default=[], help="settings of the map, as cell_z_mm=0.5")
    asked = words.parse_args()
    changed = dict(one.split("=") for one in asked.set)
    method = Method()
    method = method.model_copy(update={"map": type(method.map).model_validate(method.map.model_dump() | changed)})
    with tempfile.TemporaryDirectory() as folder:
        measured(0.5, method, Path(folder) / "warm")  # compiles
        measured(asked.length_m, method, Path(folder))


if __name__ == "__main__":
    main()
