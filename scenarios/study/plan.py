"""A study as the list of its runs: each a point of the factors' space, a method and a seed, known by its key."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import sha256
from typing import Any

from scenarios.document import BadInput, Document, put, shown
from scenarios.load import to_scenario
from scenarios.scenario import Scenario
from scenarios.study.design import points
from scenarios.study.ledger import PlannedRun
from scenarios.study.plain import canonical
from scenarios.study.study import SCENARIO, Scene, Study

KEY_DIGITS = 32
WITHOUT_EFFECT = {"name", "why"}
SEED = "seed"


@dataclass(frozen=True)
class Recipe:
    """All that a worker needs to make any run of a study, as plain data."""

    base: dict[str, Any]
    paths: tuple[str, ...]
    methods: dict[str, dict[str, Any]]
    record: tuple[str, ...]
    code: str
    scenes: dict[str, Scene] = field(default_factory=dict)

    @cached_property
    def _texts(self) -> dict[tuple[str, str], str]:
        scenes = {"": Scene(base=self.base, methods=self.methods), **self.scenes}
        return {
            (name, method): json.dumps({**scene["base"], "method": settings})
            for name, scene in scenes.items()
            for method, settings in scene["methods"].items()
        }

    def scenario(self, values: tuple[Any, ...] | list[Any], method: str, seed: int) -> Scenario:
        """The scenario of one run: the base (or the scenario it names), the method, and the factors' values over both.

        Raises:
            BadInput: when the values do not fit together.
        """
        told = dict(zip(self.paths, values, strict=True))
        data = json.loads(self._texts[told.pop(SCENARIO, ""), method])
        data["seed"] = seed
        for path, value in told.items():
            put(data, path.split("."), value, path)
        return to_scenario(Document("these values", data, {}, {}))


def recipe_of(study: Study, code: str) -> Recipe:
    """What workers need of a study."""
    return Recipe(study.base, tuple(study.factors), study.methods, study.record, code, study.scenes)


def planned_runs(study: Study, recipe: Recipe) -> Iterator[PlannedRun]:
    """Every run of the design: point by point, seed by seed, method by method; a seed that is a factor is the only."""
    for number, values in enumerate(points(study.design, list(study.factors.values()))):
        texts = {method: _scenario_text(recipe, values, method, study.seeds[0]) for method in study.methods}
        own = [seed for path, seed in zip(study.factors, values, strict=True) if path == SEED]
        for seed in own or study.seeds:
            for method, (text, fault) in texts.items():
                yield PlannedRun(_key(text, seed, recipe.code), number, method, seed, values, fault)


def _scenario_text(recipe: Recipe, values: tuple[Any, ...], method: str, seed: int) -> tuple[str, str]:
    """The resolved scenario without its seed, as text that is the same for the same scenario; or else its fault."""
    try:
        resolved = recipe.scenario(values, method, seed).model_dump(mode="json", exclude=WITHOUT_EFFECT | {"seed"})
    except BadInput as error:
        return canonical([recipe.base, recipe.methods[method], dict(zip(recipe.paths, values, strict=True))]), (
            error.lines[0].removeprefix("these values: ")
        )
    return canonical(resolved), ""


def _key(scenario: str, seed: int, code: str) -> str:
    return sha256(f"{code}\n{seed}\n{scenario}".encode()).hexdigest()[:KEY_DIGITS]


def identity(study: Study, code: str) -> dict[str, Any]:
    """What a ledger was begun with: change any of it, and its rows would no longer belong together."""
    return {
        "base": study.base,
        "paths": list(study.factors),  # their order is the order of a row's values
        "factors": json.loads(canonical(study.factors)),
        "design": study.design.model_dump(mode="json", exclude={"seeds"}),
        "seeds": list(study.seeds),
        "methods": study.methods,
        "record": list(study.record),
        "code": code,
        **({"scenes": study.scenes} if study.scenes else {}),
    }


def differences(was: Any, now: Any, path: str = "") -> Iterator[str]:
    """Where two plain values differ, in words."""
    if isinstance(was, dict) and isinstance(now, dict):
        for key in [*was, *(key for key in now if key not in was)]:
            below = f"{path}.{key}" if path else key
            if key not in now:
                yield f"{below} is gone"
            elif key not in was:
                yield f"{below} is new"
            else:
                yield from differences(was[key], now[key], below)
    elif was != now:
        yield f"{path} was {shown(was)} and is {shown(now)}"
