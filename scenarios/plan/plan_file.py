"""A plan file: the scene, the defects that must be found, and the limits that decide go or no-go."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from math import ceil
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from algorithms.trust.exact_bounds import hits_needed
from scenarios.document import BadInput, Document, read_file, shown
from scenarios.faults import Fault, checked, fault_lines
from scenarios.fidelity.agreed import compared_on, trusts
from scenarios.scenario import Scenario
from scenarios.study.plan import recipe_of
from scenarios.study.study import Name, Study, sound_study
from sensor_model.settings import Settings
from twin.features import FAMILIES

Positive = Annotated[float, Field(gt=0)]
Pct = Annotated[float, Field(gt=0, le=100)]
DRAWN_DEPTHS = "depth_pct"
SCORES = {
    "depth_error_pct": "depth_error_mm_max",
    "length_error_mm": "length_error_mm_max",
    "width_error_mm": "width_error_mm_max",
    "distance_error_pct": "distance_error_pct",
    "roll_error_deg": "roll_rms_deg",
    "a90_95_pct": "defects_found",
    "false_calls_per_m": "false_calls",
    "seen_share_pct": "seen_share",
}
"""By limit: the score in which a cheap fidelity must agree with pictures for the limit to be shown there."""
SIZES = ("depth_error_pct", "length_error_mm", "width_error_mm", "a90_95_pct")
"""Limits that every defect of a scan says something of."""
RATES = ("false_calls_per_m", "seen_share_pct")
"""Limits on means, for which the fewest scans with an interval will do."""
FEWEST_SLOT_MM = 20.0


class Limits(Settings):
    """What the job demands; what is left out is reported and decides nothing."""

    a90_95_pct: Pct | None = None
    """Depth, of the wall, from which on 90 % are found with the stated confidence, kind by kind."""
    depth_error_pct: Pct | None = None
    """Of the wall; the stated share of defects is to be sized as well, with the stated confidence."""
    length_error_mm: Positive | None = None
    width_error_mm: Positive | None = None
    seen_share_pct: Pct | None = None
    """Of the wall, at least."""
    distance_error_pct: Positive | None = None
    roll_error_deg: Positive | None = None
    false_calls_per_m: Positive | None = None
    minutes_per_m: Positive | None = None


class PlanFile(Settings):
    """What a plan file may say.

    `base` and `set` state pipe, robot, rig and method, as in a study; `vary` what may differ from scan to scan, drawn
    anew for each. Sizes in `defects` are numbers, or ranges [low, high] from which each defect's are drawn.
    """

    name: Name
    why: Annotated[str, Field(max_length=400)] = ""
    base: Annotated[str, Field(max_length=400)] = "paper-robot"
    set: dict[str, Any] = Field(default={})
    vary: dict[str, Any] = Field(default={}, max_length=50)
    defects: dict[Name, dict[str, Any]] = Field(min_length=1, max_length=10)
    stretch_mm: tuple[float, float]
    """Of the pipe, in which defects are put: it must be scanned whole."""
    per_scan: Annotated[int, Field(ge=1, le=40)] = 3
    speeds_mm_s: Annotated[tuple[Positive, ...], Field(max_length=10)] = ()
    limits: Limits = Limits()
    share: Annotated[float, Field(gt=0.5, lt=1)] = 0.9
    """Of all defects, that a promised tolerance holds for."""
    confidence: Annotated[float, Field(gt=0.5, lt=1)] = 0.95
    scans: Annotated[int, Field(ge=4, le=100_000)] | None = None
    """How many; left out, as many as the confidence needs."""
    confirm: Annotated[int, Field(ge=0, le=1000)] = 0
    """How many scans of other seeds are made in pictures, to see whether the promise holds there."""
    time_limit_min: Positive = 30.0
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0

    @model_validator(mode="after")
    def _stretch_is_one(self) -> PlanFile:
        if self.stretch_mm[1] - self.stretch_mm[0] < self.per_scan * FEWEST_SLOT_MM:
            raise ValueError(f"stretch_mm must reach {self.per_scan} x {FEWEST_SLOT_MM:g} mm from its first end")
        return self


@dataclass(frozen=True)
class Plan:
    """A sound plan: its file, the document it came from, and the scene as a scenario."""

    file: PlanFile
    document: Document
    path: Path
    base: dict[str, Any]
    scene: Scenario


def load_plan(path: Path) -> Plan:
    """Read and check a plan file.

    Raises:
        BadInput: with a line for every fault, limits that contradict each other among them.
    """
    document = read_file(path, kind="plan")
    if not isinstance(document.data, dict):
        raise BadInput([f"{document.source}: got {shown(document.data)}; a plan is a mapping of keys to values"])
    file, faults = checked(PlanFile, document.data)
    if file is not None:
        faults += list(_wrong_defects(file))
    lines = fault_lines(document, faults)
    if lines or file is None:
        raise BadInput(lines)
    study = scene_study(file, path)
    scene = recipe_of(study, "").scenario((), "default", file.seed)
    if faults := list(_contradictions(file, scene)):
        raise BadInput(fault_lines(document, faults))
    return Plan(file, document, path, study.base, scene)


def scene_study(file: PlanFile, path: Path) -> Study:
    """The plan's scene as a study of one run, which checks base and settings as a study does."""
    data = {"name": file.name, "base": file.base, "set": {**SCENE, **file.set}}
    return sound_study(Document(str(path), data, {}, {}), path)


SCENE = {"sensing.fidelity": "points", "sensing.points": "default", "pipe.features": []}
"""What a plan's scans have unless `set` says otherwise."""


def _wrong_defects(file: PlanFile) -> Iterator[Fault]:
    for name, given in file.defects.items():
        keys = ("defects", name)
        if given.get("kind") not in (*FAMILIES,):  # a list or a mapping has no hash
            yield Fault((*keys, "kind"), shown(given.get("kind")), f"must be one of {', '.join(FAMILIES)}")
            continue
        fields = FAMILIES[given["kind"]].model_fields
        for key, value in given.items():
            if key == "depth_mm":
                yield Fault((*keys, key), shown(value), f"state the depth as {DRAWN_DEPTHS}, of the wall")
            elif key not in (*fields, DRAWN_DEPTHS):
                yield Fault((*keys, key), shown(value), f"no such size; a {given['kind']} has {', '.join(fields)}")
            elif isinstance(value, list | tuple) and not _is_range(value):
                yield Fault((*keys, key), shown(value), "must be a number, or a range [low, high]")
        depths = given.get(DRAWN_DEPTHS)
        if not (isinstance(depths, list | tuple) and _is_range(depths) and depths[0] > 0 and depths[1] <= 100):
            yield Fault((*keys, DRAWN_DEPTHS), shown(depths), "must be a range [low, high] in percent of the wall")


def _is_range(value: Any) -> bool:
    numbers = all(isinstance(v, int | float) and not isinstance(v, bool) for v in value)
    return len(value) == 2 and numbers and value[0] < value[1]


def _contradictions(file: PlanFile, scene: Scenario) -> Iterator[Fault]:
    """Limits that no study of this plan could show to be kept."""
    limits = file.limits
    for name, given in file.defects.items():
        low, high = given[DRAWN_DEPTHS]
        if limits.a90_95_pct is not None and not low < limits.a90_95_pct <= high:
            allowed = f"outside the depths {low:g} to {high:g} % of defects.{name}, which could never show it"
            yield Fault(("limits", "a90_95_pct"), f"{limits.a90_95_pct:g}", allowed)
        yield from _unsound(name, given, scene.pipe.wall_mm)
    yield from _untrusted(file, scene)
    speeds = file.speeds_mm_s or (scene_speed(scene),)
    fastest = max((speed for speed in speeds if speed), default=None)
    if limits.minutes_per_m is not None and fastest and 1000 / fastest / 60 > limits.minutes_per_m:
        allowed = f"contradicts the speeds: at {fastest:g} mm/s a metre takes {1000 / fastest / 60:.2g} minutes"
        yield Fault(("limits", "minutes_per_m"), f"{limits.minutes_per_m:g}", allowed)
    if file.speeds_mm_s and scene_speed(scene) is None:
        yield Fault(("speeds_mm_s",), shown(list(file.speeds_mm_s)), "the base's drive has no speed")
    if limits.seen_share_pct is not None:
        strut = 100 * scene.rig.projector.strut_width_deg / 360
        if limits.seen_share_pct > 100 - strut:
            allowed = f"the strut alone hides {strut:.1f} % of the wall; two passes, or less"
            yield Fault(("limits", "seen_share_pct"), f"{limits.seen_share_pct:g}", allowed)


def _unsound(name: str, given: dict[str, Any], wall_mm: float) -> Iterator[Fault]:
    """A defect some of whose drawn sizes could not be: the first fault at the ends of its ranges."""
    ends = [value if isinstance(value, list | tuple) else [value] for value in given.values()]
    for sizes in product(*ends):
        drawn = dict(zip(given, sizes, strict=True))
        depth_mm = wall_mm * drawn.pop(DRAWN_DEPTHS) / 100
        one = {**drawn, "depth_mm": depth_mm, "distance_mm": 0.0, "clock_deg": 0.0}
        _, faults = checked(FAMILIES[given["kind"]], one)
        if faults:
            yield Fault(("defects", name), f"{shown(drawn)} and {depth_mm:.3g} mm deep", faults[0].allowed)
            return


def _untrusted(file: PlanFile, scene: Scenario) -> Iterator[Fault]:
    """Limits on what the scene's fidelity is not to be trusted in, unless pictures can show them."""
    of_all = hits_needed(file.share, file.confidence)
    for limit, score in SCORES.items():
        if getattr(file.limits, limit) is None or trusts(scene, score):
            continue
        needed = 2 if limit in RATES else ceil(of_all / file.per_scan) if limit in SIZES else of_all
        if file.confirm < needed:
            why = f"{score} in `{scene.sensing.fidelity}` does not stand for pictures ({compared_on(scene)})"
            allowed = f"{why}; confirm: {needed} or more shows it in pictures"
            yield Fault(("limits", limit), f"{getattr(file.limits, limit):g}", allowed)


def scene_speed(scene: Scenario) -> float | None:
    """The drive's speed, mm/s, where it has one."""
    return getattr(scene.drive, "speed_mm_s", None)
