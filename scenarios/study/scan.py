"""One run of a study: the chain from the drive to the score, each stage out of the cache when it is there."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.reconstruct import mapped, see, sized
from algorithms.types import Reconstruction, Trajectory, WallMap
from scenarios.matching import match
from scenarios.run import fold, sensed
from scenarios.scenario import Scenario, nominal_pipe, nominal_rig
from scenarios.score import FrameTally, score
from scenarios.study.cache import Cache, default_folder, default_limit_bytes, entry_key
from scenarios.study.code import code_version
from scenarios.study.plan import Recipe
from sensor_model.recording import Recording, SlitPixels, open_recording
from sensor_model.streams import stream
from twin.simulate import simulate
from twin.truth import ARRAYS, Truth

SIZES = ("length_mm", "width_mm", "depth_mm")
MS_PER_FRAME = "ms_per_frame"
TALLIED = ("radius_mm", "radius_wall_mm", "center_mm", "center_wall_mm", "normal")

Figures = list[float | int | None]
Sizes = list[list[float]]
"""Of each true defect that was scanned: length, width and depth, mm, and, unless missed, the measured ones."""


def maker(recipe: dict[str, Any]) -> Callable[[dict[str, Any]], tuple[Figures, Sizes]]:
    """What makes the runs of a study from the jobs that a worker gets."""
    import cv2

    cv2.setNumThreads(1)
    known = Recipe(**{**recipe, "paths": tuple(recipe["paths"]), "record": tuple(recipe["record"])})
    cache = Cache(default_folder(), default_limit_bytes())

    def make(job: dict[str, Any]) -> tuple[Figures, Sizes]:
        scenario = known.scenario(job["values"], job["method"], job["seed"])
        every, sizes, ms = scan(scenario, cache)
        return [ms if name == MS_PER_FRAME else every[name] for name in known.record], sizes

    return make


def scan(scenario: Scenario, cache: Cache) -> tuple[dict[str, Any], Sizes, float]:
    """The score of one scenario, its true defects' sizes, and the processor time of a frame from slits to map, ms.

    The time is that of when the map was made, be it now or by an earlier run.
    """
    keys = stage_keys(scenario)
    truth = _truth(scenario, cache, keys["drive"])
    parts = cache.arrays("map", keys["map"], lambda: _measured(scenario, truth, cache, keys))
    path, wall, tally = _unpacked(parts, scenario, truth)
    found = sized(path, wall, nominal_rig(scenario), nominal_pipe(scenario), scenario.method)
    return asdict(score(found, truth, tally)), _sizes(found, truth), float(parts["ms_per_frame"][0])


def stage_keys(scenario: Scenario) -> dict[str, str]:
    """What each stage depends on: its own settings, the stage before, and the code of its rooms."""
    method, world, every = scenario.method, code_version("world"), code_version("all")
    drive = entry_key("drive", world, scenario.pipe, scenario.robot, scenario.drive, scenario.seed)
    rigs = scenario.true_rig or scenario.rig, nominal_rig(scenario), nominal_pipe(scenario)
    recording = entry_key("recording", drive, *rigs, scenario.sensing, scenario.seed)
    slits = entry_key("slits", recording, every, method.decode)
    below = method.model_dump(mode="json", exclude={"decode", "sizing"})
    return {"drive": drive, "recording": recording, "slits": slits, "map": entry_key("map", slits, below)}


def _truth(scenario: Scenario, cache: Cache, key: str) -> Truth:
    def make() -> dict[str, np.ndarray]:
        truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
        return {name: getattr(truth, name) for name in ARRAYS}

    arrays: dict[str, Any] = cache.arrays("drive", key, make)
    return Truth(pipe=scenario.pipe, **arrays)


def _measured(scenario: Scenario, truth: Truth, cache: Cache, keys: dict[str, str]) -> dict[str, np.ndarray]:
    """Trajectory, map and tally, as arrays."""

    def make(folder: Path) -> None:
        sensed(scenario, truth, folder, 1, {}, _quiet)

    with cache.entry("recording", keys["recording"], make) as folder:
        recording = open_recording(folder)
        start_s = time.process_time()
        state, tally = fold(scenario, truth, recording, _slit_pixels(scenario, recording, cache, keys["slits"]))
        took_s = time.process_time() - start_s
    path, wall = mapped(state)
    parts = {f"path_{field.name}": np.asarray(getattr(path, field.name)) for field in fields(Trajectory)}
    parts |= {
        f"wall_{field.name}": part for field in fields(WallMap) if (part := getattr(wall, field.name)) is not None
    }
    parts |= {f"tally_{name}": np.array(getattr(tally, name)) for name in TALLIED}
    parts |= {MS_PER_FRAME: np.array([1000 * took_s / max(len(path.stamp_ns), 1)])}
    return {**parts, "tally_points": np.array([tally.points, tally.wrong])}


def _slit_pixels(scenario: Scenario, recording: Recording, cache: Cache, key: str) -> Iterator[SlitPixels]:
    """The slit pixels of every frame; decoding pictures is dear and kept, in `points` they came with the recording."""

    def read() -> Iterator[SlitPixels]:
        return (see(recording[i], recording.rig, scenario.method) for i in range(len(recording)))

    if scenario.sensing.fidelity == "points":
        return read()
    parts = cache.arrays("slits", key, lambda: _packed(list(read())))
    ends = np.cumsum(parts["count"])
    cuts = (np.split(parts[name], ends[:-1]) for name in ("pixel", "slit", "sigma_px"))
    return (SlitPixels(*one) for one in zip(*cuts, strict=True))


def _packed(frames: list[SlitPixels]) -> dict[str, np.ndarray]:
    parts = {name: np.concatenate([getattr(f, name) for f in frames]) for name in ("pixel", "slit", "sigma_px")}
    return {**parts, "count": np.array([f.slit.size for f in frames])}


def _unpacked(parts: dict[str, np.ndarray], scenario: Scenario, truth: Truth) -> tuple[Trajectory, WallMap, FrameTally]:
    def of(prefix: str) -> dict[str, np.ndarray]:
        return {name.removeprefix(prefix): part for name, part in parts.items() if name.startswith(prefix)}

    path = of("path_")
    reason = tuple(str(word) for word in path.pop("reason"))
    tally = of("tally_")
    points, wrong = (int(n) for n in tally.pop("points"))
    rows = {name: list(part) for name, part in tally.items()}
    rig = scenario.true_rig or scenario.rig
    return (
        Trajectory(**path, reason=reason),
        WallMap(**of("wall_")),
        FrameTally(truth.pipe, rig, points, wrong, **rows, optics=scenario.sensing.optics),
    )


def _sizes(found: Reconstruction, truth: Truth) -> Sizes:
    """Sizes of every true defect within what was scanned; what was not measured (an edge not seen) is left out."""
    pipe, every = truth.pipe, []
    pairs = dict(match(pipe, found.defects))
    z_mm = found.wall.z_mm[found.wall.scanned()]
    for i, feature in enumerate(pipe.features):
        sizes = [float(size) for size in feature.size(pipe.bore_radius_mm)]
        if i in pairs:
            sizes += [float(getattr(found.defects[pairs[i]], name)) for name in SIZES]
            every += [sizes] if all(map(math.isfinite, sizes)) else []
        elif z_mm.size and z_mm[0] <= feature.distance_mm <= z_mm[-1]:
            every.append(sizes)
    return every


def _quiet(stage: str, done: int, total: int) -> None:
    """Nobody watches a single run of a study."""
