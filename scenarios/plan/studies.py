"""The studies of a plan: its scans, the same at other speeds and without one cause, and some in pictures."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from scenarios.document import BadInput, put
from scenarios.fidelity.noise import errors_of_picture
from scenarios.load import library
from scenarios.plan.plan_file import SCENE, Plan, scene_speed
from scenarios.plan.scans import rows_of
from scenarios.scenario import Scenario
from scenarios.study.cache import Cache
from scenarios.study.conduct import How
from scenarios.study.plan import Recipe
from scenarios.study.scan import scan
from scenarios.study.study import save_study

MAIN, CONFIRM = "scans", "pictures"
SPEED = "drive.speed_mm_s"
QUIET_IMU = {
    f"sensing.imu.{name}": 0
    for name in (
        "gyroscope_noise_density",
        "gyroscope_random_walk",
        "gyroscope_bias_deg_s",
        "accelerometer_noise_density",
        "accelerometer_random_walk",
        "accelerometer_bias_m_s2",
        "attitude_noise_deg",
        "attitude_drift_deg",
    )
}
CAUSES: dict[str, dict[str, Any]] = {
    "noise of the pictures": {
        "sensing.points.slit_noise_px": [],
        "sensing.points.slit_bias_px": [],
        "sensing.points.pixel_noise_px": 0,
    },
    "the slide's print": {"sensing.points.slide_jag_deg": 0},
    "IMU": QUIET_IMU,
    "wheels' build": {"robot.wheel_diameter_error_pct": [], "robot.wheel_steer_deg": 0, "robot.roller_ripple_mm": 0},
    "calibration": {"true_rig": None, "calibration": None},
    "ovality": {"pipe.ovality_pct": 0},
}
"""What is switched off, one at a time, to see what limits the plan most."""

Say = Callable[[str], None]
Rows = dict[str, list[Any]]
Studies = dict[str, tuple[dict[str, Any], Rows]]
"""By name: what a study changes in the scene, and the rows that its scans differ by."""


def studies_of(plan: Plan, scans: int, few: int) -> Studies:
    """Every study of the plan; those beside the main one make its first few scans again."""
    rows = rows_of(plan, scans, 0)
    first = {path: values[:few] for path, values in rows.items()}
    studies: Studies = {MAIN: ({}, rows)}
    for speed in plan.file.speeds_mm_s:
        if speed != scene_speed(plan.scene):
            studies[f"speed-{speed:g}"] = ({SPEED: speed}, first)
    for cause, changes in causes_of(plan).items():
        studies[study_of(cause)] = (changes, {path: own for path, own in first.items() if path not in changes})
    if plan.file.confirm:
        studies[CONFIRM] = ({"sensing.fidelity": "picture"}, rows_of(plan, plan.file.confirm, 1))
    return studies


def study_of(cause: str) -> str:
    """The name of the study without a cause."""
    return f"without-{cause.replace(' ', '-')}".replace("'", "")


def causes_of(plan: Plan) -> dict[str, dict[str, Any]]:
    """The causes that the scene has, each with what switches it off."""
    present = {}
    for cause, changes in CAUSES.items():
        data = json.loads(json.dumps(plan.base))
        known = {path: value for path, value in changes.items() if _has(data, path)}
        if plan.scene.drive.kind != "robot":
            known = {path: value for path, value in known.items() if not path.startswith("robot.")}
        for path, value in known.items():
            put(data, path.split("."), value, path)
        varied = any(path in plan.file.vary for path in known)
        if known and (varied or data != plan.base):
            present[cause] = known
    return present


def _has(data: Any, path: str) -> bool:
    for name in path.split("."):
        if not isinstance(data, dict) or name not in data:
            return False
        data = data[name]
    return True


def keep_time(plan: Plan, rows: dict[str, Rows], how: How, say: Say) -> None:
    """See by two scans whether the scene can be scanned at all, and how long everything will take.

    Raises:
        BadInput: when it cannot, or all takes longer than the plan's time limit.
    """
    main = rows[MAIN]
    recipe = Recipe(plan.base, tuple(main), {"default": plan.base["method"]}, (), "")
    trials = [recipe.scenario([values[k] for values in main.values()], "default", 0) for k in range(2)]
    try:
        _tried(trials[0])  # which compiles
        cheap_s, frames = _tried(trials[1])
    except (RuntimeError, ValueError) as error:
        raise BadInput([f"{plan.document.place(('base',))}: base: cannot be scanned: {error}"]) from error
    runs = {name: len(own["seed"]) for name, own in rows.items()}
    total_s = (sum(runs.values()) - runs.get(CONFIRM, 0)) * cheap_s
    if CONFIRM in runs:
        total_s += runs[CONFIRM] * (cheap_s + frames * _picture_s(trials[1]))
    total_s /= how.workers
    said = f"{sum(runs.values())} scans in {len(runs)} studies, about {total_s / 60:.1f} min on {how.workers} processes"
    if total_s > 60 * plan.file.time_limit_min:
        parts = ", ".join(f"{name} {count}" for name, count in runs.items())
        cut = "lower confirm, speeds_mm_s, scans or confidence, or raise time_limit_min"
        place = f"{plan.document.place(('time_limit_min',))}: time_limit_min"
        raise BadInput([f"{place}: got {plan.file.time_limit_min:g}; {said} ({parts}); {cut}"])
    say(said)


def _tried(scenario: Scenario) -> tuple[float, int]:
    """Seconds of one scan, and its frames."""
    with TemporaryDirectory() as folder:
        start_s = time.perf_counter()
        figures, _, _ = scan(scenario, Cache(Path(folder), 1e9))
        return time.perf_counter() - start_s, int(figures["frames"])


def _picture_s(scenario: Scenario) -> float:
    """Seconds to draw, expose and decode one picture."""
    seconds = []
    for number in range(2):
        start_s = time.perf_counter()
        errors_of_picture(scenario, np.eye(4), number)
        seconds.append(time.perf_counter() - start_s)
    return seconds[-1]  # the first one compiles


def write_study(plan: Plan, file: Path, changes: dict[str, Any], rows: Rows) -> Path:
    """One of the plan's studies, as a file that `pipetwin study` would take, too."""
    base = plan.file.base
    document = {
        "name": file.stem,
        "base": base if base in library() else str((plan.path.parent / base).resolve()),
        # written out, so that parts of it can be changed
        "set": {**SCENE, **plan.file.set, "sensing.points": plan.base["sensing"]["points"], **changes},
        "factors": rows,
        "design": {"kind": "rows"},
    }
    save_study(document, file)
    return file
