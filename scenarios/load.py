"""A scenario file (or a name out of the library) as a `Scenario`, with everything that is wrong in it said at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from io import StringIO
from math import hypot, pi
from pathlib import Path
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel, TypeAdapter, ValidationError
from ruamel.yaml import YAML
from ruamel.yaml.representer import SafeRepresenter

from scenarios.document import (
    BadInput,
    Document,
    Keys,
    dotted,
    nearest,
    parse,
    read_file,
    shown,
    with_part,
    with_settings,
)
from scenarios.field.scan_file import with_scan
from scenarios.scenario import Scenario
from sensor_model.rig import AnySettings
from twin.drives import AnyDrive
from twin.features import AnyFeature
from twin.features.base import HALF_BOX_ARC, HALF_BOX_Z, Feature
from twin.pipe import Pipe
from twin.simulate import check_room

__all__ = [
    "BadInput",
    "checked",
    "cross_checks",
    "fault_lines",
    "library",
    "load_scenario",
    "parse",
    "read_scenario_file",
    "scenario_yaml",
    "to_scenario",
    "whole_checks",
    "with_settings",
]

LIBRARY = Path(__file__).parent / "library"
METHODS = Path(__file__).parent / "methods"
TOLERANCE_MM = 1e-9
MOST_LINES = 50
WHEEL_TOLERANCE = 0.02
WIDEST_PLANAR_SHARE = 0.4  # of half the circumference: a flat floor cannot reach around

FEATURE: TypeAdapter = TypeAdapter(AnyFeature)
DRIVE: TypeAdapter = TypeAdapter(AnyDrive)

WANTED = {  # pydantic's kind of error -> what is allowed, where its own words would not help a person
    "float_type": "must be a number",
    "float_parsing": "must be a number",
    "int_type": "must be a whole number",
    "int_parsing": "must be a whole number",
    "int_from_float": "must be a whole number",
    "bool_type": "must be true or false",
    "string_type": "must be text",
    "tuple_type": "must be a list",
    "list_type": "must be a list",
    "dict_type": "must be a mapping of keys to values",
    "model_type": "must be a mapping of keys to values",
    "model_attributes_type": "must be a mapping of keys to values",
    "missing": "required",
}


class Fault(NamedTuple):
    """One thing that is wrong: where, what was given, and what would do."""

    keys: Keys
    got: str
    allowed: str
    of_key: bool = False


def library() -> dict[str, Path]:
    """The scenarios that come with pipetwin, by name."""
    return {path.stem: path for path in sorted(LIBRARY.glob("*.yaml"))}


def methods() -> dict[str, Path]:
    """The files of method settings that come with pipetwin, by name."""
    return {path.stem: path for path in sorted(METHODS.glob("*.yaml"))}


def method_file(name_or_path: str | Path) -> Path:
    """Where a method's settings are: those that come with pipetwin by name, others by their path."""
    return methods().get(str(name_or_path), Path(name_or_path))


def with_named_method(document: Document) -> Document:
    """The document with the settings of the method that it names, if it does no more than that.

    Raises:
        BadInput: when there is none of that name.
    """
    name = document.data.get("method") if isinstance(document.data, dict) else None
    if not isinstance(name, str):
        return document
    if name not in methods():
        allowed = f"must be settings, or one of {', '.join(methods())}{nearest(name, list(methods()))}"
        raise BadInput(fault_lines(document, [Fault(("method",), shown(name), allowed)]))
    return with_part(document, "method", read_file(methods()[name], kind="method"))


def load_scenario(
    name_or_path: str, changes: Sequence[str] = (), seed: int | None = None, method: Path | None = None
) -> Scenario:
    """Read a scenario, with another method, `path.to.field=value` changes and another seed laid over it, in this order.

    Raises:
        BadInput: with a line for every fault, `file:line:column: field.path: got VALUE; what is allowed`.
    """
    document = with_named_method(read_scenario_file(name_or_path))
    if method is not None:
        document = with_part(document, "method", read_file(method_file(method), kind="method"))
    document = with_settings(document, changes)
    if seed is not None:
        document = with_settings(document, [f"seed={seed}"], flag="--seed")
    return to_scenario(document)


def read_scenario_file(name_or_path: str) -> Document:
    """The document of a library name, or else of a path.

    Raises:
        BadInput: when there is no such scenario, or it is no YAML.
    """
    known = library()
    if name_or_path in known:
        return read_file(known[name_or_path])
    is_file_like = "/" in name_or_path or "." in name_or_path
    if not is_file_like and not Path(name_or_path[:255] or "-").exists():
        names = ", ".join(known)
        near = nearest(name_or_path, list(known))
        raise BadInput([f"{shown(name_or_path)}: no such scenario; give a file, or one of {names}{near}"])
    return read_file(Path(name_or_path))


def to_scenario(document: Document) -> Scenario:
    """Check a document and make the scenario of it.

    Raises:
        BadInput: with a line for every fault.
    """
    document = with_named_method(document)
    data, missing = with_scan(_frozen(document.data), document.source)
    lines = document.faults
    faults: list[Fault] = []
    if not isinstance(data, dict):
        raise BadInput([*lines, _line(document, Fault((), shown(data), "a scenario is a mapping of keys to values"))])
    if missing is not None:
        raise BadInput(fault_lines(document, [Fault(("pipe", "scanned", "file"), *missing)]))
    try:
        scenario = Scenario.model_validate(data, strict=True)
    except ValidationError:
        faults = _faults(_all_errors(data), data, Scenario)
    faults += cross_checks(*_sound_parts(data))
    if not faults:
        faults += whole_checks(scenario)
    if not faults and not lines:
        return scenario
    raise BadInput(fault_lines(document, faults))


def fault_lines(document: Document, faults: list[Fault]) -> list[str]:
    """The faults as lines in the order of the file, with those that reading it found."""
    lines = list(document.faults)
    said = {line.split(": ")[0] for line in lines}  # an alias, say, is not a wrong type as well
    lines += [line for fault in faults if (line := _line(document, fault)).split(": ")[0] not in said]
    lines.sort(key=lambda line: _where(line, document.source))
    if len(lines) > MOST_LINES:
        lines[MOST_LINES:] = [f"{document.source}: and {len(lines) - MOST_LINES} more"]
    return lines


def checked(kind: type[AnySettings], data: Any, at: Keys = ()) -> tuple[AnySettings | None, list[Fault]]:
    """Settings of any kind out of a file's data, or else what is wrong with them; `at` is where they stand in it."""
    data = _frozen(data)
    try:
        return kind.model_validate(data, strict=True), []
    except ValidationError as error:
        faults = _faults(error.errors(include_url=False), data, kind)  # type: ignore[arg-type]
        return None, [fault._replace(keys=(*at, *fault.keys)) for fault in faults]


def scenario_yaml(scenario: Scenario) -> str:
    """The scenario with every setting written out, as YAML that reads back to the same scenario."""
    return settings_yaml(scenario)


def settings_yaml(settings: BaseModel) -> str:
    """Settings of any kind written out, as YAML that reads back to the same."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Representer = _ShortLists
    yaml.default_flow_style, yaml.width = False, 110
    yaml.sort_base_mapping_type_on_output = False  # type: ignore[assignment]  # its None is a default
    text = StringIO()
    yaml.dump(settings.model_dump(mode="json"), text)
    return text.getvalue()


class _ShortLists(SafeRepresenter):
    """Writes a list of plain values on one line, and all else as a block."""

    def represent_list(self, data: list) -> Any:
        plain = not any(isinstance(item, dict | list) for item in data)
        return self.represent_sequence("tag:yaml.org,2002:seq", data, flow_style=plain)


_ShortLists.add_representer(list, _ShortLists.represent_list)


def _frozen(value: Any) -> Any:
    """Lists as tuples, which is what settings hold and all that strict validation takes."""
    if isinstance(value, dict):
        return {key: _frozen(item) for key, item in value.items()}
    return tuple(_frozen(item) for item in value) if isinstance(value, list) else value


# ---- what a feature, the pipe and the drive must agree on


def cross_checks(pipe: Pipe | None, features: dict[int, Feature], drive: Any) -> list[Fault]:
    """Faults that lie between sound parts: features and drive against the pipe (None where a part is unsound)."""
    if pipe is None:
        return []
    faults = [fault for index, feature in features.items() for fault in _feature_faults(pipe, index, feature)]
    return faults + list(_drive_faults(pipe, drive))


def whole_checks(scenario: Scenario) -> list[Fault]:
    """Faults that only a scenario sound in all its parts can show: room for the drive, a figure for every wheel."""
    faults = []
    try:
        check_room(scenario.pipe, scenario.robot, scenario.drive)
    except ValueError as error:
        faults.append(Fault(("drive",), scenario.drive.kind, str(error)))
    faults += _rig_faults(scenario)
    wheels, errors = len(scenario.rig.wheels.diameters_mm), scenario.sensing.encoders.wheel_diameter_error_pct
    if wheels != scenario.robot.leg_count:
        allowed = f"one for each of the robot's {scenario.robot.leg_count} legs"
        faults.append(Fault(("rig", "wheels", "diameters_mm"), f"{wheels} values", allowed))
    if len(errors) != scenario.robot.leg_count:
        allowed = f"one for each of the robot's {scenario.robot.leg_count} legs"
        keys: Keys = ("sensing", "encoders", "wheel_diameter_error_pct")
        faults.append(Fault(keys, f"{len(errors)} values", allowed))
    return faults


def _rig_faults(scenario: Scenario) -> Iterator[Fault]:
    """What two rigs and a robot must agree on: the true one differs in calibration, not in kind."""
    rig, true = scenario.rig, scenario.true_rig or scenario.rig
    turned = 2 * scenario.robot.wheel_radius_mm
    for i, diameter in enumerate(rig.wheels.diameters_mm):
        if abs(diameter / turned - 1) > WHEEL_TOLERANCE:
            allowed = f"the robot's wheels measure {turned:g} mm; small errors go into sensing.encoders"
            yield Fault(("rig", "wheels", "diameters_mm", i), f"{diameter:g}", allowed)
    if true.wheels != rig.wheels:
        allowed = "as in rig; what wheels really roll goes into sensing.encoders.wheel_diameter_error_pct"
        yield Fault(("true_rig", "wheels"), "other wheels", allowed)
    size, expected = ((r.camera.width_px, r.camera.height_px) for r in (true, rig))
    if size != expected:
        yield Fault(("true_rig", "camera"), f"{size} px", f"a picture of {expected} px, as in rig")
    if [s.name for s in true.projector.slits] != [s.name for s in rig.projector.slits]:
        yield Fault(("true_rig", "projector", "slits"), "other colours", "the same colour pairs as in rig")


def _feature_faults(pipe: Pipe, index: int, feature: Feature) -> Iterator[Fault]:
    keys: Keys = ("pipe", "features", index)
    half_z, half_arc = (float(half) for half in feature.row()[[HALF_BOX_Z, HALF_BOX_ARC]])
    widest = pi * pipe.bore_radius_mm * (WIDEST_PLANAR_SHARE if getattr(feature, "floor", "") == "planar" else 1.0)
    if half_arc > widest:
        allowed = f"would be {2 * half_arc:.4g} mm wide; at most {2 * widest:.4g} mm go around this bore"
        yield Fault(keys, feature.kind, allowed)  # type: ignore[attr-defined]
        return
    deepest = feature.size(pipe.bore_radius_mm).depth_mm
    if not feature.inward and deepest > pipe.wall_mm + TOLERANCE_MM:
        at = "" if deepest == feature.depth_mm else f" ({deepest:.4g} mm where it is deepest)"
        allowed = f"must be at most the wall, {pipe.wall_mm:g} mm{at}"
        yield Fault((*keys, "depth_mm"), f"{feature.depth_mm:g}", allowed)
    low, high = feature.distance_mm - half_z, feature.distance_mm + half_z
    if low < pipe.start_mm - TOLERANCE_MM or high > pipe.end_mm + TOLERANCE_MM:
        where = f"the {feature.kind} would reach from {low:g} to {high:g} mm"  # type: ignore[attr-defined]
        allowed = f"{where}, and the pipe from {pipe.start_mm:g} to {pipe.end_mm:g} mm"
        yield Fault((*keys, "distance_mm"), f"{feature.distance_mm:g}", allowed)


def _drive_faults(pipe: Pipe, drive: Any) -> Iterator[Fault]:
    named = {"start_mm", "end_mm"} & set(getattr(type(drive), "model_fields", ()))
    places: dict[Keys, Any] = {(name,): getattr(drive, name) for name in sorted(named)}
    places |= {("stages", i, "to_mm"): stage.to_mm for i, stage in enumerate(getattr(drive, "stages", ()))}
    for keys, place in places.items():
        if not pipe.start_mm <= place <= pipe.end_mm:
            allowed = f"must lie in the pipe, from {pipe.start_mm:g} to {pipe.end_mm:g} mm"
            yield Fault(("drive", *keys), f"{place:g}", allowed)
    offset = getattr(drive, "offset_mm", (0.0, 0.0))
    if hypot(*offset) >= pipe.bore_radius_mm:
        yield Fault(("drive", "offset_mm"), shown(offset), f"must lie within the bore, {pipe.bore_radius_mm:g} mm")


def _sound_parts(data: dict) -> tuple[Pipe | None, dict[int, Feature], Any]:
    """Pipe, features and drive as far as each is sound by itself, so that one fault does not hide another."""
    given = data.get("pipe")
    if not isinstance(given, dict):
        return None, {}, None
    listed = given.get("features", ())
    features = {i: _or_none(FEATURE, item) for i, item in enumerate(listed if isinstance(listed, tuple) else ())}
    known = {key: value for key, value in given.items() if key in Pipe.model_fields}
    pipe = _or_none(TypeAdapter(Pipe), {**known, "features": ()})
    return pipe, {i: item for i, item in features.items() if item is not None}, _or_none(DRIVE, data.get("drive"))


def _or_none(adapter: TypeAdapter, data: Any) -> Any:
    try:
        return adapter.validate_python(data, strict=True)
    except ValidationError:
        return None


# ---- pydantic's errors in words that lead to the line


def _all_errors(data: dict) -> list[dict]:
    """All errors; a broken `rig` stops the validator that lays `true_rig` over it, so the two are checked in turn."""
    errors = _errors_of({key: item for key, item in data.items() if key != "true_rig"})
    if "true_rig" in data:
        rig = {} if any(error["loc"][:1] == ("rig",) for error in errors) else data.get("rig", {})
        errors += [error for error in _errors_of({**data, "rig": rig}) if error["loc"][:1] == ("true_rig",)]
    return errors


def _errors_of(data: dict) -> list[dict]:
    try:
        Scenario.model_validate(data, strict=True)
    except ValidationError as error:
        return error.errors(include_url=False)  # type: ignore[return-value]
    return []


def _faults(errors: list[dict], data: Any, root: type[BaseModel]) -> list[Fault]:
    """The errors as faults; a required key that is only misspelt is not said to be missing as well."""
    located = [(*_located(error["loc"], data, root), error) for error in errors]
    misspelt = set()
    for keys, model, error in located:
        if error["type"] == "extra_forbidden" and model is not None:
            misspelt.add((*keys[:-1], nearest(keys[-1], list(model.model_fields))))
    kept = [
        (keys, model, error)
        for keys, model, error in located
        if error["type"] != "missing" or (*keys[:-1], f"; did you mean {keys[-1]}") not in misspelt
    ]
    return [_fault(keys, model, error, root) for keys, model, error in kept]


def _located(loc: tuple, data: Any, root: type[BaseModel]) -> tuple[Keys, type[BaseModel] | None]:
    """The keys of an error as the file has them, and the settings class that the last of them belongs to.

    Pydantic puts the kind of a union's member into the path; the file has no such level.
    """
    keys: Keys = ()
    models: list[type[BaseModel]] = [root]
    owner: type[BaseModel] | None = root
    for part in loc:
        kind = data.get("kind") if isinstance(data, dict) else None
        if part == kind and len(models) > 1:
            models = [model for model in models if model.model_fields["kind"].default == kind]
            continue
        keys = (*keys, part)
        if isinstance(part, str):
            owner = models[0] if len(models) == 1 else None
            field = owner.model_fields.get(part) if owner else None
            models = _models_in(field.annotation) if field else []
        inside = isinstance(data, dict) or (isinstance(data, tuple) and isinstance(part, int) and part < len(data))
        data = (data.get(part) if isinstance(data, dict) else data[part]) if inside else None
    return keys, owner


def _models_in(annotation: Any) -> list[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return [annotation]
    return [model for part in get_args(annotation) for model in _models_in(part)]


def _fault(keys: Keys, model: type[BaseModel] | None, error: dict, root: type[BaseModel]) -> Fault:
    """One pydantic error in a person's words."""
    kind, value, context = error["type"], error.get("input"), error.get("ctx", {})
    if kind == "extra_forbidden":
        names = list(model.model_fields) if model else []
        known = f"known here: {', '.join(names)}" if names else "no such key is known here"
        return Fault(keys, "an unknown key", known + nearest(keys[-1], names), of_key=True)
    if kind == "missing":
        return Fault(keys, "nothing", WANTED[kind])
    if kind in ("union_tag_invalid", "union_tag_not_found"):
        kinds = _quoted(context.get("expected_tags", "")) or _kinds(keys, root)
        got = shown(context["tag"]) if "tag" in context else "nothing"
        allowed = f"must be one of {', '.join(kinds)}{nearest(context.get('tag'), kinds)}"
        return Fault((*keys, "kind"), got, allowed)
    if kind == "literal_error":
        choices = _quoted(context["expected"])
        return Fault(keys, shown(value), f"must be one of {context['expected']}{nearest(value, choices)}")
    if kind == "value_error":
        return Fault(keys, shown(value), str(context["error"]))
    allowed = WANTED.get(kind) or _in_our_words(error["msg"])
    if str(keys[-1] if keys else "").endswith("clock_deg") and kind in ("float_type", "float_parsing"):
        allowed = "must be degrees, or a clock position from 1:00 to 12:59"
    return Fault(keys, shown(value), allowed[:1].lower() + allowed[1:])


def _in_our_words(message: str) -> str:
    for theirs, ours in (("Input should", "must"), ("String should", "must"), ("Tuple should", "the list must")):
        message = message.replace(theirs, ours)
    return message


def _quoted(text: str) -> list[str]:
    return re.findall(r"'([^']*)'", text)


def _kinds(keys: Keys, root: type[BaseModel]) -> list[str]:
    """The kinds that a union knows, for an error that does not list them."""
    owner: list[type[BaseModel]] = [root]
    for part in keys:
        if isinstance(part, str) and len(owner) == 1 and part in owner[0].model_fields:
            owner = _models_in(owner[0].model_fields[part].annotation)
    return [model.model_fields["kind"].default for model in owner]


def _where(line: str, source: str) -> tuple[int, int, int]:
    """Orders lines as the file has them, and what came by the command line after it."""
    match = re.match(rf"{re.escape(source)}:(\d+):(\d+): ", line)
    return (0, int(match[1]), int(match[2])) if match else (1, 0, 0)


def _line(document: Document, fault: Fault) -> str:
    place = document.place(fault.keys, fault.of_key)
    name = dotted(fault.keys)
    field = "" if place.endswith(f" {name}") else f"{name}: "  # a --set already names it
    return f"{place}: {field}got {fault.got}; {fault.allowed}"
