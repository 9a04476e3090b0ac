"""A study file: a base scenario, what varies in it, which methods measure it, and what is recorded."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, TypedDict

from pydantic import Field

from scenarios.document import BadInput, Document, Keys, dotted, nearest, read_file, shown, with_part, with_values
from scenarios.faults import Fault, checked, fault_lines
from scenarios.load import library, methods, to_scenario
from scenarios.run_folder import whole_file
from scenarios.score import MEANINGS
from scenarios.study.design import DESIGNS, Design, Grid, Rows, point_count
from scenarios.study.factors import DISTRIBUTIONS, MOST_LEVELS, Factor, Levels, Range, same_values
from sensor_model.settings import Settings

MOST_FACTORS = 100
MOST_METHODS = 100
SCENARIO = "scenario"
"""The factor whose values are scenarios: each run's base, in place of the study's."""
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]


class StudyFile(Settings):
    """What a study file may say.

    `set` and `factors` name settings by their paths, as `--set` does, or `scenario`, whose values are bases themselves;
    `methods` states what each changes below `method`, or names a file of method settings; `record` names figures of the
    score, all when left out.
    """

    name: Name
    why: Annotated[str, Field(max_length=400)] = ""
    base: Annotated[str, Field(max_length=400)]
    set: dict[str, Any] = Field(default={})
    factors: dict[str, Any] = Field(default={}, max_length=MOST_FACTORS)
    design: dict[str, Any] = Field(default={"kind": "grid"})
    methods: dict[Name, Any] = Field(default={"default": {}}, min_length=1, max_length=MOST_METHODS)
    record: Annotated[tuple[str, ...], Field(min_length=1)] = tuple(MEANINGS)
    time_limit_s: Annotated[float, Field(gt=0, le=7 * 86_400)] = 3600.0
    memory_limit_mb: Annotated[int, Field(ge=64)] | None = None


class Scene(TypedDict):
    """A scenario that a factor names: with every setting written out, and each method's settings in it."""

    base: dict[str, Any]
    methods: dict[str, dict[str, Any]]


@dataclass(frozen=True)
class Study:
    """A sound study: the base scenario with every setting written out, factors by path, methods by name."""

    name: str
    why: str
    base: dict[str, Any]
    factors: dict[str, Factor]
    design: Design
    methods: dict[str, dict[str, Any]]
    seeds: tuple[int, ...]
    record: tuple[str, ...]
    time_limit_s: float
    memory_limit_mb: int | None
    scenes: dict[str, Scene] = field(default_factory=dict)

    @property
    def planned(self) -> int:
        """How many runs the design asks for."""
        return point_count(self.design, list(self.factors.values())) * len(self.seeds) * len(self.methods)


def load_study(path: Path) -> Study:
    """Read and check a study file, with every value of every factor tried on the base scenario by itself.

    Raises:
        BadInput: with a line for every fault.
    """
    return sound_study(read_file(path, kind="study"), path)


def save_study(document: dict[str, Any], file: Path) -> None:
    """Write a study that was made by other code, as a file that `load_study` reads."""
    from ruamel.yaml import YAML

    with whole_file(file) as work, work.open("w") as text:
        YAML(typ="safe", pure=True).dump(document, text)


def sound_study(document: Document, path: Path) -> Study:
    """The study of a document; `path` says which folder it names other files from.

    Raises:
        BadInput: with a line for every fault.
    """
    if not isinstance(document.data, dict):
        raise BadInput([f"{document.source}: got {shown(document.data)}; a study is a mapping of keys to values"])
    file, faults = checked(StudyFile, document.data)
    factors, more = _factors(document.data.get("factors"))
    design, still_more = _design(document.data.get("design", {"kind": "grid"}))
    faults += [*more, *still_more, *_unknown_figures(document.data.get("record"))]
    if design is not None:
        faults += _unfit(design, factors)
    lines = fault_lines(document, faults)
    if lines or file is None or design is None:
        raise BadInput(lines)
    base = _base(document, file, path, ("base",), file.base)
    methods = _methods(document, file, base, path)
    scenes = _scenes(document, file, path, factors.get(SCENARIO))
    for each in [scene["base"] for scene in scenes.values()] or [base]:
        _try_every_value(document, each, factors)
    seeds = design.seeds or (int(base["seed"]),)
    limits = file.time_limit_s, file.memory_limit_mb
    return Study(file.name, file.why, base, factors, design, methods, seeds, file.record, *limits, scenes)


# ---- factors and design


def factors_of(document: Document, given: dict[str, Any], key: str) -> dict[str, Factor]:
    """The factors that a mapping below a document's key states.

    Raises:
        BadInput: with a line for every fault.
    """
    found, faults = _factors(given, key)
    if lines := fault_lines(document, faults):
        raise BadInput(lines)
    return found


def _factors(given: Any, key: str = "factors") -> tuple[dict[str, Factor], list[Fault]]:
    found: dict[str, Factor] = {}
    faults: list[Fault] = []
    for path, value in given.items() if isinstance(given, dict) else ():
        factor, more = _factor((key, path), value)
        faults += more
        if factor is not None:
            found[path] = factor
    return found, faults


def _factor(keys: Keys, value: Any) -> tuple[Any, list[Fault]]:
    if isinstance(value, list):
        return _listed(keys, value)
    if not isinstance(value, dict):
        return None, [Fault(keys, shown(value), "must be a list, a range {low, high, steps} or a distribution")]
    if "distribution" not in value:
        return checked(Range, value, keys)
    kind = value["distribution"]
    if kind not in list(DISTRIBUTIONS):
        allowed = f"must be one of {', '.join(DISTRIBUTIONS)}{nearest(kind, list(DISTRIBUTIONS))}"
        return None, [Fault((*keys, "distribution"), shown(kind), allowed)]
    return checked(DISTRIBUTIONS[kind], value, keys)


def _listed(keys: Keys, values: list) -> tuple[Levels | None, list[Fault]]:
    if not values:
        return None, [Fault(keys, "an empty list", "a factor needs a value; with none the design is empty")]
    if len(values) > MOST_LEVELS:
        return None, [Fault(keys, f"{len(values)} values", f"at most {MOST_LEVELS}")]
    if (twice := same_values(values)) is not None:
        first, again = twice
        return None, [Fault((*keys, again), shown(values[again]), f"the same value stands already as item {first}")]
    return Levels(tuple(values)), []


def _design(given: Any) -> tuple[Design | None, list[Fault]]:
    if not isinstance(given, dict):
        return None, [Fault(("design",), shown(given), "must be a mapping of keys to values")]
    kind = given.get("kind", "grid")
    if kind not in list(DESIGNS):
        allowed = f"must be one of {', '.join(DESIGNS)}{nearest(kind, list(DESIGNS))}"
        return None, [Fault(("design", "kind"), shown(kind), allowed)]
    return checked(DESIGNS[kind], {**given, "kind": kind}, ("design",))


def _unfit(design: Design, factors: dict[str, Factor]) -> Iterator[Fault]:
    """Where design and factors do not go together."""
    if "seed" in factors and design.seeds is not None:
        yield Fault(("design", "seeds"), f"{len(design.seeds)} seeds", "the seed is a factor already; leave one out")
    if not isinstance(design, Grid):
        if not factors:
            yield Fault(("design",), design.kind, "there are no factors to draw; give some, or kind: grid")
        if not isinstance(design, Rows):
            return
    for path, factor in factors.items():
        if factor.levels() is None:
            design_needs = "rows need lists" if isinstance(design, Rows) else "a grid needs a list"
            allowed = f"{design_needs}, or a range with steps; or give design.kind latin-hypercube or sobol"
            yield Fault(("factors", path), "no levels", allowed)
    lengths = {path: len(factor.levels() or ()) for path, factor in factors.items()}
    if isinstance(design, Rows) and len(set(lengths.values())) > 1:
        said = ", ".join(f"{path} {n}" for path, n in lengths.items())
        yield Fault(("design",), "rows", f"all factors must have as many values; there are: {said}")


def _unknown_figures(given: Any) -> list[Fault]:
    names = given if isinstance(given, list) else []
    return [
        Fault(("record", i), shown(name), f"no such figure of the score{nearest(name, list(MEANINGS))}")
        for i, name in enumerate(names)
        if name not in list(MEANINGS)
    ]


# ---- base and methods


def _base(document: Document, file: StudyFile, path: Path, keys: Keys, base: str) -> dict[str, Any]:
    """A scenario that stands at some place, with `set` laid over it and every setting written out."""
    named = library().get(base) or path.parent / base
    if not named.is_file():
        near = nearest(base, list(library()))
        allowed = f"no such scenario; give a file (from the study's folder), or one of {', '.join(library())}{near}"
        raise BadInput(fault_lines(document, [Fault(keys, shown(base), allowed)]))
    resolved = to_scenario(read_file(named)).model_dump(mode="json")
    changes = [(name, value, _place(document, ("set", name), name)) for name, value in file.set.items()]
    return _resolved(document, resolved, changes, known=False)


def _scenes(document: Document, file: StudyFile, path: Path, factor: Factor | None) -> dict[str, Scene]:
    """Every scenario that the factor names; none where there is no such factor.

    Raises:
        BadInput: for what is no scenario.
    """
    found: dict[str, Scene] = {}
    for i, name in enumerate((factor.levels() or (None,)) if factor is not None else ()):
        keys: Keys = ("factors", SCENARIO, i)
        if not isinstance(factor, Levels) or not isinstance(name, str):
            raise BadInput(fault_lines(document, [Fault(keys, shown(name), "must be a list of scenarios' names")]))
        base = _base(document, file, path, keys, name)
        found[name] = Scene(base=base, methods=_methods(document, file, base, path))
    return found


def _methods(document: Document, file: StudyFile, base: dict, path: Path) -> dict[str, dict[str, Any]]:
    """The settings of every method, written out."""
    found = {name: _method(document, base, path, name, given) for name, given in _plain_items(document, file.methods)}
    names = list(found)
    for i, name in enumerate(names):
        for other in names[:i]:
            if found[name] == found[other]:
                fault = Fault(("methods", name), "no change", f"the same method as {other}; every run would be twice")
                raise BadInput(fault_lines(document, [fault]))
    return found


def _plain_items(document: Document, methods: dict[str, Any]) -> Iterator[tuple[str, Any]]:
    # as the file has them: validation has made tuples of the lists
    yield from document.data.get("methods", methods).items()


def _method(document: Document, base: dict, path: Path, name: str, given: Any) -> dict[str, Any]:
    keys: Keys = ("methods", name)
    if given is None:
        given = {}
    if isinstance(given, str):
        part = read_file(methods().get(given, path.parent / given), kind="method")
        laid = with_part(Document(document.source, base, {}, {}), "method", part)
        return to_scenario(laid).model_dump(mode="json")["method"]
    if isinstance(given, dict):
        below = {f"method.{field}": value for field, value in given.items()}
        changes = [(p, v, _place(document, (*keys, p.removeprefix("method.")), p)) for p, v in below.items()]
    else:
        fault = Fault(keys, shown(given), "must be changes below `method` by their paths, or a file of method settings")
        raise BadInput(fault_lines(document, [fault]))
    return _resolved(document, base, changes)["method"]


def _place(document: Document, keys: Keys, name: str) -> str:
    return f"{document.place(keys)}: {name}"


def _resolved(document: Document, base: dict, changes: list[tuple[str, Any, str]], known: bool = True) -> dict:
    """The base with changes laid over it, checked and written out.

    Raises:
        BadInput: naming the place of the change that does not fit.
    """
    if known and (unknown := [line for path, _, place in changes for line in _unknown_path(base, path, place)]):
        raise BadInput(unknown)
    laid = with_values(Document(document.source, base, {}, {}), changes)
    try:
        return to_scenario(laid).model_dump(mode="json")
    except BadInput as error:
        said = [line for line in error.lines if any(line.startswith(place) for _, _, place in changes)]
        if said or not changes:
            raise BadInput(said or error.lines) from error
        # a fault elsewhere that a change brings about, as a drive that no longer fits into its pipe
        place, value = changes[-1][2], changes[-1][1]
        raise BadInput([f"{place}: with {shown(value)}: {error.lines[0]}"]) from error


def _unknown_path(base: dict, path: str, place: str) -> Iterator[str]:
    """A line when a path leads to no setting of the base; what is none (as `true_rig`) may be filled in."""
    inside: Any = base
    for name in path.split("."):
        if inside is None:
            return
        if isinstance(inside, list) and name.isdigit() and int(name) < len(inside):
            inside = inside[int(name)]
        elif isinstance(inside, dict) and name in inside:
            inside = inside[name]
        else:
            yield f"{place}: no such setting in the base scenario{nearest(path, list(_paths(base)))}"
            return


def _paths(value: Any, keys: Keys = ()) -> Iterator[str]:
    if keys:
        yield dotted(keys)
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from _paths(item, (*keys, key))


def _try_every_value(document: Document, base: dict, factors: dict[str, Factor]) -> None:
    """Lay every level (of a distribution: its middle) over the base by itself, so that a fault names its line.

    Raises:
        BadInput: with a line for every value that does not fit.
    """
    import numpy as np

    lines: list[str] = []
    for path, factor in factors.items():
        if path == SCENARIO:
            continue
        levels = factor.levels()
        tried = levels if levels is not None else tuple(factor.at(np.array([0.5])))
        for i, value in enumerate(tried):
            keys: Keys = ("factors", path, i) if isinstance(factor, Levels) else ("factors", path)
            try:
                _resolved(document, base, [(path, value, _place(document, keys, path))])
            except BadInput as error:
                lines += error.lines
                if "no such setting" in error.lines[0]:
                    break
    if lines:
        raise BadInput(lines)
