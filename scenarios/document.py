"""A YAML file as plain data in which every value still knows its place: file, line, column."""

from __future__ import annotations

import copy
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from yaml.error import MarkedYAMLError, YAMLError
from yaml.events import (
    AliasEvent,
    DocumentEndEvent,
    Event,
    MappingEndEvent,
    MappingStartEvent,
    ScalarEvent,
    SequenceEndEvent,
    StreamEndEvent,
)
from yaml.reader import ReaderError

from sensor_model.plain_yaml import DEEPEST, events, scalar

LARGEST_FILE_BYTES = 4_000_000  # ten thousand features, every setting written out
LONGEST_SHOWN = 60

Keys = tuple[str | int, ...]


class BadInput(Exception):
    """What a person gave cannot be used; one clear line for each fault."""

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__("\n".join(lines))
        self.lines = list(lines)


@dataclass(frozen=True)
class Document:
    """Plain data (mappings, lists, scalars), and where each value and each key stands in its source."""

    source: str
    data: Any
    value_places: dict[Keys, str]
    key_places: dict[Keys, str]
    faults: tuple[str, ...] = ()

    def place(self, keys: Keys, of_key: bool = False) -> str:
        """Where a value (or its key) stands; for one that is not there, the nearest mapping or list around it."""
        if of_key and keys in self.key_places:
            return self.key_places[keys]
        while keys and keys not in self.value_places:
            keys = keys[:-1]
        return self.value_places.get(keys, self.source)


def shown(value: Any) -> str:
    """A value as one short piece of a line."""
    text = _flow(value)
    return text if len(text) <= LONGEST_SHOWN else text[: LONGEST_SHOWN - 3] + "..."


def _flow(value: Any) -> str:
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(item)}" for key, item in list(value.items())[:20]) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_flow(item) for item in value[:20]) + "]"
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "nothing"}[value]
    return repr(value) if isinstance(value, str | int | float) else str(value)


def nearest(name: Any, names: Sequence[str]) -> str:
    """`; did you mean NAME`, or nothing when no name is near."""
    near = get_close_matches(str(name), names, n=1, cutoff=0.6)
    return f"; did you mean {near[0]}" if near else ""


def read_file(path: Path, called: str | None = None, kind: str = "scenario") -> Document:
    """Read a YAML file; duplicate keys, aliases and tags come back as the document's faults.

    Raises:
        BadInput: when nothing can be made of it at all.
    """
    source = called or str(path)
    try:
        if path.is_dir():
            raise BadInput([f"{source}: got a folder; give a {kind} file (.yaml)"])
        if not path.is_file():
            why = "got something that is no plain file" if path.exists() else "no such file"
            names = [other.name for other in path.parent.iterdir()] if path.parent.is_dir() else []
            raise BadInput([f"{source}: {why}; give a {kind} file (.yaml){nearest(path.name, names)}"])
        with path.open("rb") as file:
            raw = file.read(LARGEST_FILE_BYTES + 1)
    except (OSError, ValueError) as error:
        raise BadInput([f"{source}: cannot be read: {getattr(error, 'strerror', None) or error}"]) from error
    if len(raw) > LARGEST_FILE_BYTES:
        raise BadInput([f"{source}: got more than {LARGEST_FILE_BYTES / 1e6:g} MB; a {kind} is smaller"])
    return parse(_decoded(raw, source), source)


def _decoded(raw: bytes, source: str) -> str:
    try:
        return raw.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = raw[: error.start]
        line, column = before.count(b"\n") + 1, error.start - (before.rfind(b"\n") + 1) + 1
        byte = raw[error.start]
        raise BadInput([f"{source}:{line}:{column}: got byte 0x{byte:02x}; the file must be UTF-8 text"]) from error


def parse(text: str, source: str, fixed_place: str | None = None) -> Document:
    """YAML 1.2 text as a document; `fixed_place` stands for line and column where there are none.

    Raises:
        BadInput: when it is not YAML, is empty, or is nested too deeply.
    """
    reader = _Reader(events(text), source, fixed_place)
    try:
        data = reader.document()
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        because = "; ".join(part for part in (error.problem, error.context) if part)
        raise BadInput([f"{reader.place_of(mark)}: not YAML: {because}"]) from error
    except (ReaderError, UnicodeEncodeError) as error:
        before = _before(text, error)
        line, column = before.count("\n") + 1, len(before) - (before.rfind("\n") + 1) + 1
        place = fixed_place or f"{source}:{line}:{column}"
        got = f"U+{ord(text[len(before)]):04X}"
        raise BadInput([f"{place}: got character {got}; it may not stand in YAML"]) from error
    except YAMLError as error:
        raise BadInput([f"{fixed_place or source}: not YAML: {str(error).splitlines()[0]}"]) from error
    return Document(source, data, reader.value_places, reader.key_places, tuple(reader.faults))


def _before(text: str, error: ReaderError | UnicodeEncodeError) -> str:
    """What stands before the character that may not; the parser counts bytes."""
    if isinstance(error, UnicodeEncodeError):
        return text[: error.start]
    return text.encode()[: error.position].decode(errors="ignore")


class _Reader:
    """Builds the data from the parser's events: no object is ever made from a tag, no alias is ever expanded."""

    def __init__(self, events: Iterator[Event], source: str, fixed_place: str | None) -> None:
        self.events, self.source, self.fixed_place = events, source, fixed_place
        self.value_places: dict[Keys, str] = {}
        self.key_places: dict[Keys, str] = {}
        self.faults: list[str] = []

    def place_of(self, mark: Any) -> str:
        if self.fixed_place:
            return self.fixed_place
        return f"{self.source}:{mark.line + 1}:{mark.column + 1}" if mark else self.source

    def document(self) -> Any:
        """The data of the one document that there may be."""
        next(self.events)
        event = next(self.events)
        if isinstance(event, StreamEndEvent):
            raise BadInput([f"{self.place_of(event.start_mark)}: the file is empty"])
        data = self.value(next(self.events), ())
        while isinstance(event := next(self.events), DocumentEndEvent):
            pass
        if not isinstance(event, StreamEndEvent):
            self.faults.append(f"{self.place_of(event.start_mark)}: got a second document; a file holds one")
        return data

    def value(self, event: Event, keys: Keys) -> Any:
        """The value that begins with an event, and all below it."""
        place = self.place_of(event.start_mark)
        self.value_places[keys] = place
        if len(keys) > DEEPEST:
            raise BadInput([f"{place}: nested more than {DEEPEST} deep; no setting lies so deep"])
        if isinstance(event, AliasEvent):
            self.faults.append(f"{place}: {dotted(keys)}: got alias *{event.anchor}; write the value out")
            return None
        if tag := getattr(event, "tag", None):
            self.faults.append(f"{place}: {dotted(keys)}: got tag {tag}; tags are not understood here")
        if isinstance(event, ScalarEvent):
            return event.value if event.style else scalar(event.value)
        if isinstance(event, MappingStartEvent):
            return self.mapping(keys)
        items: list = []
        while not isinstance(event := next(self.events), SequenceEndEvent):
            items.append(self.value(event, (*keys, len(items))))
        return items

    def mapping(self, keys: Keys) -> dict[str, Any]:
        """The rest of a mapping; of a key that stands twice the first is kept and the second a fault."""
        found: dict[str, Any] = {}
        while not isinstance(event := next(self.events), MappingEndEvent):
            place = self.place_of(event.start_mark)
            if not isinstance(event, ScalarEvent):
                self.faults.append(f"{place}: {dotted(keys)}: got a key that is no plain text")
                self.value(event, (*keys, ""))
                self.value(next(self.events), (*keys, ""))
                continue
            below = (*keys, event.value)
            if event.value in found:
                first = self.key_places[below].removeprefix(f"{self.source}:")
                self.faults.append(f"{place}: {dotted(below)}: got the key a second time; it stands already at {first}")
                self.value(next(self.events), (*keys, "", event.value))
                continue
            self.key_places[below] = place
            found[event.value] = None
            found[event.value] = self.value(next(self.events), below)
        return found


def dotted(keys: Keys) -> str:
    """The path of a field as messages and `--set` write it."""
    return ".".join(str(key) for key in keys) or "the file"


def with_settings(document: Document, changes: Sequence[str], flag: str = "--set") -> Document:
    """The document with `path.to.field=value` laid over it; values are YAML, list items are counted from 0.

    Raises:
        BadInput: naming every change that is not understood.
    """
    values: list[tuple[str, Any, str]] = []
    faults: list[str] = []
    for change in changes:
        path, equals, text = change.partition("=")
        place = f"{flag} {path}".strip()
        if not equals or not path or "" in path.split("."):
            faults.append(f"{flag} {change}: give it as path.to.field=value")
            continue
        try:
            new = parse(text, place, fixed_place=place) if text.strip() else Document(place, None, {}, {})
        except BadInput as error:
            faults += error.lines
            continue
        faults += new.faults
        values.append((path, new.data, place))
    try:
        document = with_values(document, values)
    except BadInput as error:
        faults += error.lines
    if faults:
        raise BadInput(faults)
    return document


def with_values(document: Document, values: Sequence[tuple[str, Any, str]]) -> Document:
    """The document with values laid over it, each given as its path, itself, and the place that messages name.

    Raises:
        BadInput: naming every path that cannot be followed.
    """
    data, faults = copy.deepcopy(document.data), []
    places, key_places = dict(document.value_places), dict(document.key_places)
    for path, value, place in values:
        try:
            keys = put(data, path.split("."), copy.deepcopy(value), place)
        except BadInput as error:
            faults += error.lines
            continue
        for length in range(len(keys)):
            places.setdefault(keys[: length + 1], place)
        for table in (places, key_places):
            for old in [old for old in table if old[: len(keys)] == keys]:
                del table[old]
        below = [(*keys, *rest) for rest in _keys_below(value)]
        places |= dict.fromkeys(below, place)
        key_places |= dict.fromkeys(below, place)
    if faults:
        raise BadInput(faults)
    return Document(document.source, data, places, key_places, document.faults)


def with_part(document: Document, key: str, part: Document) -> Document:
    """The document with another one as the value of a key; its values keep their own places."""
    laid = with_values(document, [(key, part.data, part.source)])
    values, keys = (
        {**old, **{(key, *below): place for below, place in new.items()}}
        for old, new in ((laid.value_places, part.value_places), (laid.key_places, part.key_places))
    )
    return Document(document.source, laid.data, values, keys, (*document.faults, *part.faults))


def _keys_below(value: Any) -> Iterator[Keys]:
    """The keys of a value itself, and of all within it."""
    yield ()
    if isinstance(value, dict | list):
        for key, item in value.items() if isinstance(value, dict) else enumerate(value):
            yield from ((key, *rest) for rest in _keys_below(item))


def put(data: Any, names: list[str], value: Any, place: str) -> Keys:
    """Set one value in nested data, in place, and return the keys that lead to it."""
    keys: Keys = ()
    for name in names:
        last = len(keys) == len(names) - 1
        if isinstance(data, list):
            if not name.isdigit() or int(name) >= len(data):
                known = f"items 0 to {len(data) - 1}" if data else "no items"
                raise BadInput([f"{place}: got item {name}; {dotted(keys)} has {known}"])
            key: str | int = int(name)
        elif isinstance(data, dict):
            if name.isdigit() and name not in data:
                raise BadInput([f"{place}: got item {name}; {dotted(keys)} is not written out as a list there"])
            key = name
        else:
            raise BadInput([f"{place}: {dotted(keys)} is the value {shown(data)}; nothing lies below it"])
        keys = (*keys, key)
        if last:
            data[key] = value
        elif isinstance(data, dict) and data.get(name) is None:
            data[name] = {}
        data = data[key]
    return keys
