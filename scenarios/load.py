"""A scenario file (or a name out of the library) as a `Scenario`, with everything that is wrong in it said at once."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from scenarios.agreement import cross_checks, whole_checks
from scenarios.document import BadInput, Document, nearest, read_file, shown, with_part, with_settings
from scenarios.faults import Fault, fault_lines, frozen, settings_faults
from scenarios.field.scan_file import with_scan
from scenarios.scenario import Scenario
from twin.drives import AnyDrive
from twin.features import AnyFeature
from twin.features.base import Feature
from twin.pipe import Pipe

LIBRARY = Path(__file__).parent / "library"
METHODS = Path(__file__).parent / "methods"

FEATURE: TypeAdapter = TypeAdapter(AnyFeature)
DRIVE: TypeAdapter = TypeAdapter(AnyDrive)


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
    data, missing = with_scan(frozen(document.data), document.source)
    lines = document.faults
    faults: list[Fault] = []
    if not isinstance(data, dict):
        raise BadInput(fault_lines(document, [Fault((), shown(data), "a scenario is a mapping of keys to values")]))
    if missing is not None:
        raise BadInput(fault_lines(document, [Fault(("pipe", "scanned", "file"), *missing)]))
    try:
        scenario = Scenario.model_validate(data, strict=True)
    except ValidationError:
        faults = settings_faults(_all_errors(data), data, Scenario)
    faults += cross_checks(*_sound_parts(data))
    if not faults:
        faults += whole_checks(scenario)
    if not faults and not lines:
        return scenario
    raise BadInput(fault_lines(document, faults))


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
