"""Mutations that keep a text what it is: bytes, tables, YAML and JSON, a place changed at a time."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from copy import deepcopy
from functools import lru_cache
from typing import Any

import numpy as np

from sensor_model.plain_yaml import plain_data

Rng = np.random.Generator
Mutation = Callable[[bytes, Rng], bytes]
BYTES = (
    b"\x00",
    b"\xff" * 8,
    b"-1",
    b"1e999",
    b"nan",
    b"\n",
    b"\r",
    b",",
    b"9" * 30,
    b"#",
    b"../",
    b'"',
    b"\xef\xbb\xbf",
)
CELLS = "|nan|inf|-inf|NaN|-1|0|-0.0|1e308|-1e308|1e-320|1e999|9223372036854775807|9223372036854775808|007|0x10"
CELLS += "|1_000|٣|²|1,5|1;5| 1 |+1|abc|true|hit|../../etc/passwd|\x00|\x85|\u2028|'|\"|#|=1+1|-|NA|25:61:99|-1:00:00"
CELLS += "|::|1e15|12:60"
VALUES = (*CELLS.split("|"), "9" * 40, "9" * 5000, "x" * 5000, "1" + "0" * 400 + ".5")
PLAIN = (
    None,
    True,
    False,
    0,
    -1,
    1,
    0.0,
    -0.0,
    1e-320,
    1e308,
    -1e308,
    2**63,
    10**39,
    -(10**30),
    "",
    [],
    {},
    [[]],
    [None],
)
SHORT = ".inf|-.inf|.nan|Infinity|NaN|1e999|*a|&a 1|&a [*a]|!!python/object/apply:os.system [x]|!!binary aGk=|~|yes"
SHORT += '|!!float 1|2026-01-01|2026-13-45|0o17|0x1F|1_000|1:30|<<|{<<: *a}|? [1, 2]|- - -|\'|"\\ud800"|"\\x00"|\t|---'
SHORT += (
    "|---|%YAML 9|{? {a: 1} : 2}|{a: 1, a: 2}|null|[1,]|{1: 2}|{true: 1}|!a b|!!set {a}|!!omap [a: 1]|!!timestamp 2026"
)
SHORT += "|!!int abc|&a"
RAW = (*SHORT.split("|"), "[" * 40 + "]" * 40, "[" * 3000 + "]" * 3000, "9" * 5000, "{a: " * 400 + "1" + "}" * 400)


SIZES = (0, 1, 2, 63, 64, 65, 255, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e6, 1e12, 1e300, -1e300, 2.0**53, 2.0**63)


class Raw(str):
    """Written into YAML or JSON as it stands."""

    __slots__ = ()


def pick(options: Any, rng: Rng) -> Any:
    """One of a sequence."""
    return options[int(rng.integers(0, len(options)))]


def raw(data: bytes, rng: Rng) -> bytes:
    """Some bytes changed, cut out, doubled, swapped or replaced by what often breaks a reader."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        at = int(rng.integers(0, max(len(out), 1)))
        length = int(min(rng.geometric(0.05), len(out) - at)) if out else 0
        match int(rng.integers(0, 6)):
            case 0 if out:
                out[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                out[at : at + length] = bytes(rng.integers(0, 256, length, dtype=np.uint8))
            case 4:
                out[at:at] = pick(BYTES, rng)
            case 5 if rng.random() < 0.3:
                del out[at:]
    return bytes(out)


def table(data: bytes, rng: Rng) -> bytes:
    """Cells, rows, columns or line endings of a CSV (or of words between spaces) changed."""
    lines = data.decode().splitlines()
    mark = "," if "," in lines[-1] else " "
    rows = [line.split(mark) for line in lines]
    for _ in range(int(rng.integers(1, 3))):
        k = int(rng.integers(0, len(rows)))
        match int(rng.integers(0, 13)):
            case 0 | 1 | 2:
                rows[k][int(rng.integers(0, len(rows[k])))] = pick(VALUES, rng)
            case 3 | 4 | 5:
                c = int(rng.integers(0, len(rows[k])))
                rows[k][c] = scaled(rows[k][c], rng)
            case 6:
                other = int(rng.integers(0, len(rows)))
                rows[k], rows[other] = rows[other], rows[k]
            case 7:
                rows.insert(int(rng.integers(0, len(rows) + 1)), list(rows[k]))
            case 8:
                del rows[k : k + int(rng.geometric(0.3))]
            case 9:
                rows[1:] = sorted(rows[1:], reverse=bool(rng.integers(0, 2)))
            case 10:
                rows = _columns_changed(rows, rng)
            case 11:
                rows[k] = pick(([], [""], ["#"], rows[k][:-1], [*rows[k], "0"], rows[k] * 40), rng)
            case 12:
                c, value = int(rng.integers(0, len(rows[k]) or 1)), pick(VALUES, rng)
                rows = [[*row[:c], value, *row[c + 1 :]] if n and c < len(row) else row for n, row in enumerate(rows)]
        rows = [row or [""] for row in rows] or [[""]]
    return _ended("".join(mark.join(row) + "\n" for row in rows), rng)


def scaled(cell: str, rng: Rng) -> str:
    """A number that is another one, near or far; other text as it is."""
    try:
        value = float(cell)
    except ValueError:
        return cell
    new = value * float(pick((-1, 0, 0.5, 1.0001, 2, 10, 1e3, 1e6, 1e9, 1e-6, 1e-9, 1e200), rng)) + int(
        rng.integers(-1, 2)
    )
    whole = "." not in cell and "e" not in cell and math.isfinite(new)
    return str(int(new)) if whole else repr(new)


def _columns_changed(rows: list[list[str]], rng: Rng) -> list[list[str]]:
    """One column dropped, doubled, put elsewhere or renamed, in all rows."""
    width = len(rows[0])
    one, other = int(rng.integers(0, width)), int(rng.integers(0, width))
    orders = (
        [c for c in range(width) if c != one],
        [*range(width), one],
        [other if c == one else one if c == other else c for c in range(width)],
        [other if c == one else c for c in range(width)],
    )
    order = pick(orders, rng)
    return [[row[c] for c in order] if len(row) == width else row for row in rows]


def _ended(text: str, rng: Rng) -> bytes:
    """As bytes: mostly as it is; else with other line ends, a BOM, another encoding, or NUL bytes."""
    forms = (
        text.replace("\n", "\r\n").encode(),
        text.replace("\n", "\r").encode(),
        b"\xef\xbb\xbf" + text.encode(),
        text.encode("utf-16"),
        text.encode("latin-1", "replace") + b"\xe9\n",
        text.encode() + b"\x00" * 100,
        text.rstrip("\n").encode(),
        text.encode() + b"\n" * 5000,
        text.replace(",", ";").encode(),
        text.replace(",", "\t").encode(),
    )
    return pick(forms, rng) if rng.random() < 0.1 else text.encode()


# ---- YAML and JSON


@lru_cache(maxsize=32)
def _held(data: bytes) -> Any:
    return plain_data(data.decode())


def nested(data: bytes, rng: Rng) -> bytes:
    """Values of a YAML or JSON file changed at their paths, keys dropped, doubled, renamed or added."""
    root = {"": deepcopy(_held(data))}
    for _ in range(int(rng.integers(1, 3))):
        _change(root, rng)
    head = "a: &a 1\n" if rng.random() < 0.02 else ""
    return _ended(head + written(root[""]) + "\n", rng)


def _change(root: dict, rng: Rng) -> None:
    """Walk down to one place, and change what is there."""
    places = list(_places(root))
    held, key = pick(places, rng)
    value = held[key]
    match int(rng.integers(0, 10)):
        case 0 | 1:
            held[key] = deepcopy(pick(PLAIN, rng))
        case 2:
            held[key] = Raw(pick(RAW, rng))
        case 3:
            held[key] = pick(VALUES, rng)
        case 4:
            other, name = pick(places, rng)
            held[key] = deepcopy(other[name])
        case 5 if isinstance(held, dict) and len(held) > 1:
            other = (Raw(repr(key) + " "), "unknown", "", 3, Raw("? []"), Raw("<<"), Raw("[1]"), str(key).upper())
            held[pick(other, rng)] = value
        case 5 | 6 if len(held) > 1:
            del held[key]
        case 7 if isinstance(value, list):
            held[key] = deepcopy(pick((value[::-1], value * 2, value[:-1], value[:1], value * 300, [value]), rng))
        case 8 if isinstance(value, str):
            held[key] = pick(
                (value.upper(), value + " ", value * 2000, value[::-1], value[:-1], f"{value}\n", [value]), rng
            )
        case _ if isinstance(value, int | float) and not isinstance(value, bool):
            text = scaled(str(value), rng)
            held[key] = Raw(text) if text[-1].isdigit() else Raw("." + text.lstrip("-"))


def _places(held: Any) -> Any:
    for key in list(held) if isinstance(held, dict) else range(len(held)):
        yield held, key
        if isinstance(held[key], dict | list):
            yield from _places(held[key])


def written(value: Any) -> str:
    """Flow form, which is YAML and mostly JSON too; raw pieces as they stand."""
    if isinstance(value, Raw):
        return value
    if isinstance(value, dict):
        return "{" + ", ".join(f"{written(key)}: {written(item)}" for key, item in value.items()) + "}"
    if isinstance(value, list):
        return "[" + ", ".join(map(written, value)) + "]"
    return json.dumps(value, default=str)
