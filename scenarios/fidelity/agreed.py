"""In which scores a cheap fidelity agrees with pictures: the comparisons that are shipped, by their noise."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from scenarios.scenario import Scenario
from sensor_model.points import point_noise

FOLDER = Path(__file__).parent / "agreed"
PICTURE = "picture"


def trusts(scene: Scenario, score: str) -> bool:
    """Whether a score of this scene needs no pictures: it is drawn in them, or its fidelity agreed with them in it."""
    if scene.sensing.fidelity == PICTURE:
        return True
    noise = noise_name(scene)
    return noise is not None and score in comparison(noise)["trusted"].get(scene.sensing.fidelity, [])


def noise_name(scene: Scenario) -> str | None:
    """Under which name the noise of a scene's `points` was compared with pictures; None for noise of its own."""
    names = (file.stem for file in sorted(FOLDER.glob("*.json")))
    return next((name for name in names if scene.sensing.points == point_noise(name)), None)


@cache
def comparison(noise: str) -> dict[str, Any]:
    """What `pipetwin fidelity` wrote as `fidelity.json` for this noise."""
    found: dict[str, Any] = json.loads((FOLDER / f"{noise}.json").read_text())
    return found


def compared_on(scene: Scenario) -> str:
    """Where the trust comes from, in words."""
    if scene.sensing.fidelity == PICTURE:
        return "all scans are in pictures"
    noise = noise_name(scene)
    if noise is None or scene.sensing.fidelity not in comparison(noise)["trusted"]:
        return f"`{scene.sensing.fidelity}` with these settings was never compared with pictures"
    found = comparison(noise)
    seeds, names = found["seeds"], ", ".join(dict.fromkeys(cost["scenario"] for cost in found["costs"]))
    return f"`{scene.sensing.fidelity}` against pictures on {seeds} seeds each of {names} (pipetwin {found['version']})"
