"""Scans for the sizing campaign: pipes of defects or of bare wall, scanned in `points`, whose wall maps can be kept."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import fields
from functools import lru_cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.calibration.slide import with_jag
from algorithms.calibration.slide_in_scan import learn_slide_from_scan
from algorithms.reconstruct import begin, mapped, see, sized, step
from algorithms.types import Defect, Reconstruction, Trajectory, WallMap
from scenarios.load import load_scenario
from scenarios.matching import match
from scenarios.run import sensed
from scenarios.scenario import Scenario, nominal_pipe
from scenarios.settings_yaml import settings_yaml
from sensor_model.recording import Recording, open_recording
from sensor_model.rig import Rig
from sensor_model.streams import stream
from twin.features.base import TrueSize
from twin.pipe import Pipe
from twin.simulate import simulate

# what draws the slit pixels: the preset, the noise measured in its pictures, and the real sensor's
SENSORS = {
    "preset": [],
    "measured": ["sensing.points=default"],
    "real": ["rig=endoscope-measured", "sensing.points=endoscope"],
}
LEARNED_FRAMES = 60
FIRST_MM, BEYOND_MM = 240.0, 400.0


def scenario_of(seed: int, sensor: str, pipe: dict[str, Any], end_mm: float, changes: list[str]) -> Scenario:
    """A scan of a pipe up to a place, the sensor off centre and tilted at random; the slide corrected where jagged."""
    rng = np.random.default_rng([seed, 11])
    offset, tilt = rng.uniform(-4, 4, 2).round(3).tolist(), rng.uniform(-2, 2, 2).round(3).tolist()
    settings = [
        "sensing.fidelity=points",
        f"pipe.end_mm={end_mm + BEYOND_MM}",
        "drive.stages=[{to_mm: %g}]" % (end_mm - 60),
        f"drive.offset_mm={offset}",
        f"drive.tilt_deg={tilt}",
        *SENSORS[sensor],
        *changes,
    ]
    scenario = load_scenario("paper-gantry", settings, seed)
    whole = Pipe.model_validate({**scenario.pipe.model_dump(), "features": [], **pipe})
    return with_slide(scenario.model_copy(update={"pipe": whole}), (*SENSORS[sensor], *changes))


def with_slide(scenario: Scenario, changes: tuple[str, ...]) -> Scenario:
    """A scenario with these settings whose rig knows its slide, if that is jagged."""
    if scenario.sensing.points.slide_jag_deg == 0:
        return scenario
    return scenario.model_copy(update={"rig": slide_corrected(changes), "true_rig": scenario.rig})


@lru_cache(maxsize=8)
def slide_corrected(changes: tuple[str, ...]) -> Rig:
    """The sensor's rig with its slide's jaggedness as learned from one scan of bare wall, sensed as the others are."""
    settings = ["sensing.fidelity=points", "pipe.features=[]", *changes]
    scenario = load_scenario("paper-gantry", settings, 90_001)
    with recorded(scenario) as recording:
        chosen = np.unique(np.linspace(0, len(recording) - 1, LEARNED_FRAMES).round().astype(int)).tolist()
        found = learn_slide_from_scan([see(recording[i], scenario.rig, scenario.method) for i in chosen], scenario.rig)
    return with_jag(scenario.rig, found.table_rad) if found.helps else scenario.rig


class Looked(NamedTuple):
    """One scan: what was scanned, and what was made of it."""

    scenario: Scenario
    found: Reconstruction

    @property
    def pipe(self) -> Pipe:
        """The true pipe."""
        return self.scenario.pipe

    def pairs(self) -> list[tuple[TrueSize, Defect | None]]:
        """Every true defect's size, with what was measured of it."""
        pairs = dict(match(self.pipe, self.found.defects))
        every = enumerate(self.pipe.features)
        return [
            (f.size(self.pipe.bore_radius_mm), self.found.defects[pairs[i]] if i in pairs else None) for i, f in every
        ]


@contextmanager
def recorded(scenario: Scenario) -> Iterator[Recording]:
    """Drive and sense; the log is gone afterwards."""
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    with tempfile.TemporaryDirectory() as folder:
        sensed(scenario, truth, Path(folder), 1, {}, lambda *_: None)
        yield open_recording(Path(folder))


def wall_map(scenario: Scenario, maps: Path | None) -> tuple[Trajectory, WallMap]:
    """The map of a scan, from the kept ones where it is there."""
    kept = maps / f"{hashlib.sha256(settings_yaml(scenario).encode()).hexdigest()[:24]}.npz" if maps else None
    if kept and kept.is_file():
        with np.load(kept, allow_pickle=False) as held:
            parts = {name: held[name] for name in held.files}
        path = {part.name: parts.pop(f"path_{part.name}") for part in fields(Trajectory)}
        whole = {name: a if name == "count" else a.astype(float) for name, a in parts.items()}
        return Trajectory(**{**path, "reason": tuple(path["reason"].tolist())}), WallMap(**whole)
    with recorded(scenario) as recording:
        state = begin(recording.rig, recording.pipe, scenario.method)
        for frame in recording:
            step(state, frame, see(frame, recording.rig, scenario.method))
    path, wall = mapped(state)
    if kept:
        arrays = {name: a if a.ndim == 1 else a.astype(np.float32) for name, a in vars(wall).items() if a is not None}
        arrays |= {f"path_{name}": np.array(a) for name, a in vars(path).items()}
        kept.parent.mkdir(parents=True, exist_ok=True)
        np.savez(kept, **(arrays | {"count": wall.count.astype(np.int32)}))
    return path, wall


def looked(scenario: Scenario, maps: Path | None) -> Looked:
    """Scan and size."""
    path, wall = wall_map(scenario, maps)
    return Looked(scenario, sized(path, wall, scenario.rig, nominal_pipe(scenario), scenario.method))


def place_of(rng: np.random.Generator, distance_mm: float, clock_deg: float) -> dict[str, float]:
    """Near a place, anywhere between frames and cells."""
    return {
        "distance_mm": round(distance_mm + rng.uniform(-5, 5), 3),
        "clock_deg": round((clock_deg + rng.uniform(-8, 8)) % 360, 3),
    }
