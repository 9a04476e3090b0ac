"""How well defects of many kinds are sized: errors, misses and how often the stated intervals hold the truth."""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import chi2

from algorithms.reconstruct import mapped, see, sized
from algorithms.sizing.disposition import at_least
from algorithms.types import Defect, Trajectory, WallMap
from scenarios.load import load_scenario
from scenarios.matching import match
from scenarios.run import fold, sensed
from scenarios.scenario import Scenario, nominal_pipe
from sensor_model.recording import open_recording
from sensor_model.streams import stream
from twin.features.base import TrueSize
from twin.simulate import simulate

WALL_MM = 7.5
# not where the strut hides them, nor where the wheels of the robot would fall into them
CLOCKS_DEG = {"gantry": (75.0, 180.0, 285.0), "robot": (120.0, 240.0)}
ROW_MM = 130.0
FIRST_MM = 240.0
ROWS = 8
K95 = 1.96
Draw = Callable[[np.random.Generator], dict[str, Any]]


def pocket(length_mm: float, width_mm: float, loss_pct: float) -> Draw:
    """A pocket of about this size, at any place between the cells."""
    return lambda rng: {
        "kind": "pocket",
        "length_mm": length_mm + rng.uniform(-1, 1),
        "width_mm": width_mm + rng.uniform(-1, 1),
        "depth_mm": loss_pct / 100 * WALL_MM,
    }


def pit(diameter_mm: float, loss_pct: float, shape: str) -> Draw:
    """A round pit."""
    return lambda _: {
        "kind": "pit",
        "diameter_mm": diameter_mm,
        "depth_mm": loss_pct / 100 * WALL_MM,
        "shape": shape,
    }


def scratch(width_mm: float, depth_mm: float, heading_deg: float) -> Draw:
    """A straight scratch 60 mm long."""
    return lambda _: {
        "kind": "scratch",
        "path_length_mm": 60,
        "width_mm": width_mm,
        "depth_mm": depth_mm,
        "heading_deg": heading_deg,
    }


KINDS: dict[str, Draw] = {
    **{f"pocket 70x35, {loss} %": pocket(70, 35, loss) for loss in (100, 75, 50, 25, 20, 10)},
    **{f"pocket 25x25, {loss} %": pocket(25, 25, loss) for loss in (100, 50, 20)},
    **{f"pocket 12x12, {loss} %": pocket(12, 12, loss) for loss in (100, 50, 20)},
    "pit 20 spherical, 50 %": pit(20, 50, "spherical"),
    "pit 20 conical, 50 %": pit(20, 50, "conical"),
    "pit 10 spherical, 50 %": pit(10, 50, "spherical"),
    "pit 10 spherical, 20 %": pit(10, 20, "spherical"),
    "scratch 3 wide, 1.5 deep, axial": scratch(3, 1.5, 0),
    "scratch 3 wide, 1.5 deep, 35 deg": scratch(3, 1.5, 35),
    "scratch 3 wide, 1.5 deep, around": scratch(3, 1.5, 90),
    "scratch 1 wide, 1 deep, axial": scratch(1, 1, 0),
}


class Sized(NamedTuple):
    """One true defect and what was made of it, if anything."""

    kind: str
    true: TrueSize
    found: Defect | None


def sheet(seed: int, kinds: list[str], drive: str, changes: list[str]) -> tuple[Scenario, list[str]]:
    """A pipe with two or three defects in each of several rows, kinds in turn; and the kind of each defect."""
    rng = np.random.default_rng([seed, 7])
    clocks = CLOCKS_DEG[drive]
    order = [kinds[k % len(kinds)] for k in rng.permutation(ROWS * len(clocks))]
    features = []
    for k, name in enumerate(order):
        row, column = divmod(k, len(clocks))
        place = {
            "distance_mm": round(FIRST_MM + ROW_MM * row + rng.uniform(-5, 5), 3),
            "clock_deg": round(clocks[column] + rng.uniform(-8, 8), 3),
        }
        features.append({**KINDS[name](rng), **place})
    end = FIRST_MM + ROW_MM * ROWS
    driven = "drive.stages=[{to_mm: %g}]" % (end - 20) if drive == "gantry" else f"drive.end_mm={end - 20}"
    settings = ["sensing.fidelity=points", f"pipe.end_mm={end + 400}", driven, *changes]
    scenario = load_scenario(f"paper-{drive}", settings, seed)
    pipe = type(scenario.pipe).model_validate({**scenario.pipe.model_dump(), "features": features})
    return scenario.model_copy(update={"pipe": pipe}), order


def scan(scenario: Scenario) -> tuple[Trajectory, WallMap]:
    """Drive, sense and map."""
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    with tempfile.TemporaryDirectory() as folder:
        sensed(scenario, truth, Path(folder), 1, {}, lambda *_: None)
        recording = open_recording(Path(folder))
        slits = (see(recording[i], recording.rig, scenario.method) for i in range(len(recording)))
        state, _ = fold(scenario, truth, recording, slits)
    return mapped(state)


def judged(scenario: Scenario, order: list[str], path: Trajectory, wall: WallMap) -> Iterator[Sized | Defect]:
    """Every true defect with what was found of it, and every false call."""
    found = sized(path, wall, scenario.rig, nominal_pipe(scenario), scenario.method)
    pairs = dict(match(scenario.pipe, found.defects))
    for i, feature in enumerate(scenario.pipe.features):
        defect = found.defects[pairs[i]] if i in pairs else None
        yield Sized(order[i], feature.size(scenario.pipe.bore_radius_mm), defect)
    yield from (defect for j, defect in enumerate(found.defects) if j not in pairs.values())


def clean(seed: int, drive: str, changes: list[str]) -> tuple[float, int]:
    """Metres of bare wall that were seen, and what was called on them."""
    scenario, _ = sheet(seed, list(KINDS), drive, changes)
    bare = type(scenario.pipe).model_validate({**scenario.pipe.model_dump(), "features": []})
    scenario = scenario.model_copy(update={"pipe": bare})
    path, wall = scan(scenario)
    scanned = wall.z_mm[wall.scanned()]
    found = sized(path, wall, scenario.rig, nominal_pipe(scenario), scenario.method)
    return float(np.ptp(scanned)) / 1000, len(found.defects)


def table(every: list[Sized | Defect]) -> str:
    """A line a kind: n, misses, and of length, width and depth the median and worst error and the coverage."""
    said = [one for one in every if isinstance(one, Sized)]
    lines = [
        f"{'kind':34s} {'n':>3} miss  length: med worst cov%   width: med worst cov%   depth: bias worst cov%  10% WT"
    ]
    for name in [*dict.fromkeys(one.kind for one in said), "all"]:
        ours = [one for one in said if name in (one.kind, "all")]
        found = [one for one in ours if one.found is not None]
        got = [one for one in found if one.found.floor_seen]
        least = [one.true.depth_mm >= at_least(one.found.depth_mm, one.found.depth_std_mm) for one in found]
        line = f"{name:34s} {len(ours):3d} {len(ours) - len(found):4d}"
        if got:
            measured = np.array([[g.found.length_mm, g.found.width_mm, g.found.depth_mm] for g in got])
            std = np.array([[g.found.length_std_mm, g.found.width_std_mm, g.found.depth_std_mm] for g in got])
            error = measured - np.array([list(g.true) for g in got])
            held = 100 * np.mean(np.abs(error) <= K95 * std, axis=0)
            worst, middle = np.abs(error).max(axis=0), np.median(error, axis=0)
            for k in range(3):
                line += f"   {middle[k]:+8.3f} {worst[k]:7.3f} {held[k]:4.0f}"
            line += f"  {100 * np.mean(np.abs(error[:, 2]) <= 0.1 * WALL_MM):5.0f}"
        if len(got) < len(found):
            held = sum(ok for ok, one in zip(least, found, strict=True) if not one.found.floor_seen)
            line += f"   floor not seen: {len(found) - len(got)}, at least held {held}"
        lines.append(line)
    lines.append(f"false calls: {sum(isinstance(one, Defect) for one in every)}")
    return "\n".join(lines)


def main() -> None:
    """Scan sheets of defects and print the table."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--drive", choices=("gantry", "robot"), default="gantry")
    words.add_argument("--sheets", type=int, default=4, help="pipes of 24 defects each, 16 with the robot")
    words.add_argument("--clean", action="store_true", help="scan bare wall instead, about 1.3 m a sheet")
    words.add_argument("--only", default="", help="kinds that hold this word")
    words.add_argument("--set", nargs="*", default=[], help="settings, as in `pipetwin run --set`")
    asked = words.parse_args()
    if asked.clean:
        passes = [clean(seed, asked.drive, asked.set) for seed in range(asked.sheets)]
        metres, calls = (sum(part) for part in zip(*passes, strict=True))
        # Poisson, exact, one-sided 95 %
        most = chi2.ppf(0.95, 2 * (calls + 1)) / 2 / metres
        print(f"{metres:.1f} m of bare wall, {calls} false calls; at most {most:.4f} a metre (95 %)")
        return
    kinds = [name for name in KINDS if asked.only in name]
    every: list[Sized | Defect] = []
    for seed in range(asked.sheets):
        scenario, order = sheet(seed, kinds, asked.drive, asked.set)
        every += judged(scenario, order, *scan(scenario))
    print(table(every))


if __name__ == "__main__":
    main()
