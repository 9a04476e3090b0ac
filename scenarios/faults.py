"""What is wrong in a file, in words that lead to the line: where, what was given, what is allowed."""

from __future__ import annotations

import re
from typing import Any, NamedTuple, get_args

from pydantic import BaseModel, ValidationError

from scenarios.document import Document, Keys, dotted, nearest, shown
from sensor_model.rig import AnySettings

MOST_LINES = 50

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
    data = frozen(data)
    try:
        return kind.model_validate(data, strict=True), []
    except ValidationError as error:
        faults = settings_faults(error.errors(include_url=False), data, kind)  # type: ignore[arg-type]
        return None, [fault._replace(keys=(*at, *fault.keys)) for fault in faults]


def frozen(value: Any) -> Any:
    """Lists as tuples, which is what settings hold and all that strict validation takes."""
    if isinstance(value, dict):
        return {key: frozen(item) for key, item in value.items()}
    return tuple(frozen(item) for item in value) if isinstance(value, list) else value


# ---- pydantic's errors in a person's words


def settings_faults(errors: list[dict], data: Any, root: type[BaseModel]) -> list[Fault]:
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


# ---- faults as lines


def _where(line: str, source: str) -> tuple[int, int, int]:
    """Orders lines as the file has them, and what came by the command line after it."""
    match = re.match(rf"{re.escape(source)}:(\d+):(\d+): ", line)
    return (0, int(match[1]), int(match[2])) if match else (1, 0, 0)


def _line(document: Document, fault: Fault) -> str:
    place = document.place(fault.keys, fault.of_key)
    name = dotted(fault.keys)
    field = "" if place.endswith(f" {name}") else f"{name}: "  # a --set already names it
    return f"{place}: {field}got {fault.got}; {fault.allowed}"
