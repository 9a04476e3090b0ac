"""A tuning file: what may be changed, the scans it is tuned on, and others that the search never sees."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from scenarios.document import BadInput, Document, nearest, read_file, shown
from scenarios.faults import Fault, checked, fault_lines
from scenarios.study.code import code_version
from scenarios.study.factors import Factor, Levels, Range
from scenarios.study.plan import planned_runs, recipe_of
from scenarios.study.study import Name, Study, sound_study
from sensor_model.settings import Settings

OBJECTIVES = {
    "depth_error_mm": "largest depth error of a scan, mean",
    "misses_and_false_calls": "missed defects and false calls of a scan, mean",
    "ms_per_frame": "processor time of a frame from slits to map, mean (measured: not the same twice)",
}
COMMON = ("name", "why", "base", "set", "time_limit_s", "memory_limit_mb")
POINTS = {"sensing.fidelity": "points"}


class Confirm(Settings):
    """How the winner is tried once more on hold-out scans, in pictures."""

    fidelity: Literal["picture", "raycast", "points"] = "picture"
    scans: Annotated[int, Field(ge=0, le=10_000)] = 2


class TuneFile(Settings):
    """What a tuning file may say; `tuning`, `hold_out` and `stress` have `factors` and `design` as a study has.

    The search sees `tuning` alone; `hold_out` is more of the same kind, `stress` what lies beyond both.
    """

    name: Name
    why: Annotated[str, Field(max_length=400)] = ""
    base: Annotated[str, Field(max_length=400)]
    set: dict[str, Any] = Field(default={})
    tuning: dict[str, Any]
    hold_out: dict[str, Any]
    stress: dict[str, Any] | None = None
    search: dict[str, Any] = Field(min_length=1, max_length=100)
    objectives: Annotated[tuple[str, ...], Field(min_length=1, max_length=3)] = tuple(OBJECTIVES)[:2]
    trials: Annotated[int, Field(ge=1, le=100_000)] = 50
    batch: Annotated[int, Field(ge=1, le=1000)] = 4
    sampler: Literal["tpe", "nsga2", "random"] = "tpe"
    seed: Annotated[int, Field(ge=0, lt=2**31)] = 0
    first_look: Annotated[float, Field(gt=0, le=1)] = 0.34
    confirm: dict[str, Any] = Field(default={})
    time_limit_s: Annotated[float, Field(gt=0, le=7 * 86_400)] = 3600.0
    memory_limit_mb: Annotated[int, Field(ge=64)] | None = None


@dataclass(frozen=True)
class Tuning:
    """A sound tuning: settings, both sets of scans, and what may be changed."""

    file: TuneFile
    tuning: Study
    hold_out: Study
    stress: Study | None
    search: dict[str, Factor]
    confirm: Confirm


def load_tuning(path: Path) -> Tuning:
    """Read and check a tuning file.

    Raises:
        BadInput: with a line for every fault.
    """
    document = read_file(path, kind="tuning")
    if not isinstance(document.data, dict):
        raise BadInput([f"{document.source}: got {shown(document.data)}; a tuning is a mapping of keys to values"])
    file, faults = checked(TuneFile, document.data)
    confirm, more = checked(Confirm, document.data.get("confirm", {}), ("confirm",))
    faults += [*more, *_unknown_objectives(document.data.get("objectives"))]
    if lines := fault_lines(document, faults):
        raise BadInput(lines)
    assert file is not None  # noqa: S101  it has no fault
    assert confirm is not None  # noqa: S101  nor has this
    tuning, hold_out = (sound_study(_part(document, name), path) for name in ("tuning", "hold_out"))
    stress = None if file.stress is None else sound_study(_part(document, "stress"), path)
    search = sound_study(_searched(document), path).factors
    _apart(document, "hold_out", tuning, hold_out)
    if stress is not None:
        _apart(document, "stress", tuning, stress)
    return Tuning(file, tuning, hold_out, stress, search, confirm)


def _unknown_objectives(given: Any) -> list[Fault]:
    names = given if isinstance(given, list) else []
    return [
        Fault(
            ("objectives", i), shown(name), f"must be one of {', '.join(OBJECTIVES)}{nearest(name, list(OBJECTIVES))}"
        )
        for i, name in enumerate(names)
        if name not in list(OBJECTIVES)
    ]


def _part(document: Document, section: str) -> Document:
    """One section as a study of its own, whose values still know their places in the file."""
    inside = document.data[section]
    common = {key: document.data[key] for key in COMMON if key in document.data}
    data = {**common, **inside, "set": {**common.get("set", {}), **POINTS}}
    values, keys = (
        {key: place for key, place in places.items() if key[:1] != (section,)}
        | {key[1:]: place for key, place in places.items() if key[:1] == (section,)}
        for places in (document.value_places, document.key_places)
    )
    return Document(document.source, data, values, keys, document.faults)


def _searched(document: Document) -> Document:
    """What may be changed, checked as the factors of a design that draws between their ends."""
    common = {key: document.data[key] for key in COMMON if key in document.data}
    search = document.data["search"]
    for name, value in search.items():
        if isinstance(value, dict) and "distribution" in value:
            fault = Fault(("search", name), "a distribution", "a search takes a list, or a range {low, high}")
            raise BadInput(fault_lines(document, [fault]))
    design = {"kind": "latin-hypercube", "points": 1}
    values = {("factors", *key[1:]) if key[:1] == ("search",) else key: p for key, p in document.value_places.items()}
    keys = {("factors", *key[1:]) if key[:1] == ("search",) else key: p for key, p in document.key_places.items()}
    return Document(document.source, {**common, "factors": search, "design": design}, values, keys, document.faults)


def _apart(document: Document, name: str, tuning: Study, judging: Study) -> None:
    """Refuse a part to judge by that has been seen.

    Raises:
        BadInput: saying how many scans stand in both.
    """
    keys = [{run.key for run in planned_runs(s, recipe_of(s, code_version()))} for s in (tuning, judging)]
    if both := keys[0] & keys[1]:
        allowed = "these are tuned on too; take other seeds or other values"
        raise BadInput(fault_lines(document, [Fault((name,), f"{len(both)} of {len(keys[1])} scans", allowed)]))


def is_number_range(factor: Factor) -> bool:
    """Whether a searched setting is a range of numbers, and not a choice."""
    return isinstance(factor, Range) and factor.steps is None


def choices(factor: Factor) -> tuple[Any, ...]:
    """What may be chosen for a setting that is no range of numbers."""
    return factor.values if isinstance(factor, Levels) else factor.levels() or ()
