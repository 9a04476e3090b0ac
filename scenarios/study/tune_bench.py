"""Scans made for a search: every setting on every scan by worker processes, and the objectives of each."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import closing
from dataclasses import asdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from scenarios.document import put
from scenarios.score import MEANINGS
from scenarios.study.code import code_version
from scenarios.study.conduct import LOG
from scenarios.study.engine import Processes
from scenarios.study.ledger import Job, LedgerFailed, Outcome, full_disk
from scenarios.study.plain import canonical
from scenarios.study.plan import Recipe, planned_runs, recipe_of
from scenarios.study.scan import MS_PER_FRAME
from scenarios.study.study import SCENARIO, Study
from scenarios.study.tune_file import Tuning

RECORD = (*MEANINGS, MS_PER_FRAME)
SLOWEST_MS = 1e6  # what a scan that fails is taken for

Row = dict[str, float | int | None]
Values = tuple[Any, ...]


class Scores(NamedTuple):
    """A method's figures on every scan, one row a scan, and the mean of each objective."""

    each: Float[np.ndarray, "scans objectives"]
    mean: tuple[float, ...]


class Bench:
    """Makes the scans of a setting with worker processes; equal stages come out of the cache."""

    def __init__(self, tuning: Tuning, folder: Path, workers: int, make: str) -> None:
        self.tuning, self.folder, self.workers, self.make = tuning, folder, workers, make
        self.engines: dict[str, Processes] = {}

    def close(self) -> None:
        """End all workers."""
        for engine in self.engines.values():
            engine.close()

    def scores(self, study: Study, settings: list[dict[str, Any]], part: slice) -> list[Scores]:
        """Scores of several settings on some of a study's scans, all made side by side."""
        scans = list(planned_runs(study, recipe_of(study, "")))[part]
        paths = (*study.factors, *self.tuning.search)
        recipe = Recipe(study.base, paths, study.methods, RECORD, code_version(), study.scenes)
        jobs = [
            Job(f"{i}-{k}", k, scan.method, scan.seed, [*scan.values, *values_of(self.tuning, setting)])
            for k, scan in enumerate(scans)
            for i, setting in enumerate(settings)
        ]
        found = dict(self._outcomes(recipe, jobs))
        depths = [_depths_mm(study, scan.values) for scan in scans]
        return [self._scores([found[f"{i}-{k}"] for k in range(len(scans))], depths) for i in range(len(settings))]

    def _outcomes(self, recipe: Recipe, jobs: list[Job]) -> Iterator[tuple[str, Row | None]]:
        with closing(self._engine(recipe).events(jobs)) as events:  # type: ignore[type-var]  # it is a generator
            for event in events:
                if not isinstance(event, Outcome):
                    continue
                if event.cause == "disk":
                    raise LedgerFailed(f"{event.error}; {full_disk(self.folder)}")
                figures = event.figures
                yield event.key, None if figures is None else dict(zip(RECORD, figures, strict=True))

    def _engine(self, recipe: Recipe) -> Processes:
        """The engine of a recipe, whose workers wait for the next batch; those of another recipe are let go."""
        name = canonical(asdict(recipe))
        if name not in self.engines:
            self.close()
            file = self.tuning.file
            setup = {"make": self.make, "recipe": asdict(recipe), "memory_limit_mb": file.memory_limit_mb}
            self.engines = {name: Processes(setup, self.workers, file.time_limit_s, self.folder / LOG, keep=True)}
        return self.engines[name]

    def _scores(self, rows: list[Row | None], depths: list[list[float]]) -> Scores:
        names, both = self.tuning.file.objectives, list(zip(rows, depths, strict=True))
        each = np.array([[_objective(name, row, depths_mm) for name in names] for row, depths_mm in both])
        return Scores(each, tuple(float(mean) for mean in each.mean(axis=0)))


def _depths_mm(study: Study, values: Values) -> list[float]:
    """Depths of the features that a scan meets: its own values laid over the scenario that it starts from."""
    told = dict(zip(study.factors, values, strict=True))
    base = study.scenes[told[SCENARIO]]["base"] if SCENARIO in told else study.base
    scene = {"pipe": json.loads(json.dumps(base["pipe"]))}
    for path, value in told.items():
        if path.startswith("pipe."):
            put(scene, path.split("."), value, path)
    return [float(feature["depth_mm"]) for feature in scene["pipe"]["features"]]


def _objective(name: str, row: Row | None, depths_mm: list[float]) -> float:
    """One objective of one scan; a scan that fails, or finds nothing, has every error there is."""
    if name == "depth_error_mm":
        error = row["depth_error_mm_max"] if row is not None else None
        return max(depths_mm, default=1.0) if error is None else float(error)
    if name == "misses_and_false_calls":
        if row is None:
            return float(len(depths_mm) + 1)
        return float((row["defects_true"] or 0) - (row["defects_found"] or 0) + (row["false_calls"] or 0))
    return SLOWEST_MS if row is None else float(row[MS_PER_FRAME] or 0.0)


def values_of(tuning: Tuning, setting: dict[str, Any]) -> Values:
    """What a setting puts at the searched paths, in their order; what it does not say stays the base's."""
    return tuple(setting[path] if path in setting else setting_at(tuning.tuning.base, path) for path in tuning.search)


def setting_at(data: Any, path: str) -> Any:
    """The value at a path of plain data."""
    for name in path.split("."):
        data = data[int(name)] if isinstance(data, list) else data[name]
    return data
