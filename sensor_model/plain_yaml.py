"""YAML as plain data: parsed in C, scalars by YAML 1.2's core schema; no tag makes an object, no alias unfolds."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from yaml.events import Event

DEEPEST = 32

# YAML 1.2's core schema (section 10.3.2)
NULL = re.compile(r"~|null|Null|NULL|")
BOOL = re.compile(r"true|True|TRUE|false|False|FALSE")
INT = re.compile(r"[-+]?[0-9]{1,40}")
FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")


def events(text: str) -> Iterator[Event]:
    """What a YAML text is made of, part by part, each with its place."""
    import yaml

    return yaml.parse(text, Loader=yaml.CSafeLoader)


def scalar(text: str) -> Any:
    """A plain scalar by the core schema; sexagesimals, dates and `yes` stay text."""
    if NULL.fullmatch(text):
        return None
    if BOOL.fullmatch(text):
        return text.lower() == "true"
    if INT.fullmatch(text):
        return int(text)
    return float(text) if FLOAT.fullmatch(text) else text


def plain_data(text: str) -> Any:
    """The one document of a text.

    Raises:
        ValueError: when it is not YAML, or holds what settings have no use for.
    """
    from yaml import MarkedYAMLError, YAMLError
    from yaml.events import StreamEndEvent

    parts = events(text)
    try:
        next(parts)
        if isinstance(next(parts), StreamEndEvent):
            return None
        data = _value(next(parts), parts, 0)
        next(parts)
        if not isinstance(next(parts), StreamEndEvent):
            raise ValueError("a second document; a file holds one")
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        raise ValueError(f"line {mark.line + 1 if mark else 1}: not YAML: {error.problem}") from error
    except (YAMLError, UnicodeEncodeError) as error:
        raise ValueError(f"not YAML: {str(error).splitlines()[0]}") from error
    return data


def _value(event: Any, parts: Iterator[Any], depth: int) -> Any:
    """The value that begins with an event, and all below it."""
    from yaml.events import AliasEvent, MappingEndEvent, MappingStartEvent, ScalarEvent, SequenceEndEvent

    where = f"line {event.start_mark.line + 1}"
    if depth > DEEPEST:
        raise ValueError(f"{where}: nested more than {DEEPEST} deep; no setting lies so deep")
    if isinstance(event, AliasEvent):
        # it has no use in settings, and a few lines of them unfold without bounds
        raise ValueError(f"{where}: aliases (*{event.anchor}) are not taken")
    if event.tag:
        raise ValueError(f"{where}: tags ({event.tag}) are not taken")
    if isinstance(event, ScalarEvent):
        return event.value if event.style else scalar(event.value)
    if not isinstance(event, MappingStartEvent):
        items = []
        while not isinstance(event := next(parts), SequenceEndEvent):
            items.append(_value(event, parts, depth + 1))
        return items
    found: dict[Any, Any] = {}
    while not isinstance(event := next(parts), MappingEndEvent):
        key = _value(event, parts, depth + 1)
        if isinstance(key, dict | list) or key in found:
            raise ValueError(f"line {event.start_mark.line + 1}: key {key} is there twice, or no plain text")
        found[key] = _value(next(parts), parts, depth + 1)
    return found
