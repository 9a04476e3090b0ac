"""Mutations of MCAP and SQLite files by other libraries than ours, which keep lengths and checksums right."""

from __future__ import annotations

import io
import sqlite3
import struct
from functools import lru_cache

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from campaigns.mutated_text import NUMBERS, SIZES, VALUES, Mutation, Rng, pick, raw


def cdr(data: bytes, rng: Rng) -> bytes:
    """Counts or numbers of one packed message."""
    out = bytearray(data)
    if len(out) < 16 or rng.random() < 0.15:
        return raw(data, rng)
    form, values = pick((("<d", NUMBERS), ("<I", SIZES)), rng)
    size = struct.calcsize(form)
    at = 4 + size * int(rng.integers(0, (len(out) - 4) // size))
    struct.pack_into(form, out, min(at, len(out) - size), pick(values, rng))
    return bytes(out)


@lru_cache(maxsize=4)
def _messages(data: bytes) -> list[tuple[str, str, str, bytes, int, bytes]]:
    held = make_reader(io.BytesIO(data)).iter_messages()
    return [(s.name, s.encoding, c.topic, s.data, m.log_time, m.data) for s, c, m in held if s]


def mcap(data: bytes, rng: Rng) -> bytes:
    """Messages, topics or kinds changed and written anew by another library, with its checksums."""
    rows = list(_messages(data))
    k = int(rng.integers(0, len(rows)))
    kind, encoding, topic, schema, stamp, content = rows[k]
    match int(rng.integers(0, 8)):
        case 0:
            new = pick(
                ("", "std_msgs/msg/String", "sensor_msgs/msg/Imu", "x" * 3000, rows[0][0], "sensor_msgs/msg/Image"), rng
            )
            rows = [(new, *row[1:]) if row[2] == topic else row for row in rows]
        case 1:
            new = pick(("", "/rig", "/imu", "../x", "x" * 3000, *{row[2] for row in rows}), rng)
            rows = [(*row[:2], new, *row[3:]) if row[2] == topic else row for row in rows]
        case 2:
            rows = pick(
                (rows[:k], rows[k:], rows[::-1], rows + rows[-3:], [row for row in rows if row[2] != topic]), rng
            )
        case _:
            alike = [n for n, row in enumerate(rows) if row[2] == pick(("/rig", "/pipe", topic, topic), rng)] or [k]
            for n in rng.choice(alike, int(pick((1, 1, len(alike)), rng))):
                rows[n] = (*rows[n][:5], cdr(rows[n][5], rng))
    out = io.BytesIO()
    writer = Writer(out, compression=pick(list(CompressionType), rng), use_chunking=bool(rng.random() < 0.8))
    writer.start()
    channels: dict[tuple[str, str], int] = {}
    for kind, encoding, topic, schema, stamp, content in rows:
        if (kind, topic) not in channels:
            number = writer.register_schema(kind, encoding, schema)
            channels[kind, topic] = writer.register_channel(topic, "cdr", number)
        writer.add_message(channels[kind, topic], stamp, content, stamp)
    writer.finish()
    packed = out.getvalue()
    return _record_changed(packed, rng) if rng.random() < 0.25 else packed


def _record_changed(data: bytes, rng: Rng) -> bytes:
    """A record of the file changed inside, its frame right; dropped, doubled, or with another code."""
    records, at = [], 8
    while at + 9 <= len(data) - 8:
        size = int.from_bytes(data[at + 1 : at + 9], "little")
        records.append((data[at], data[at + 9 : at + 9 + size]))
        at += 9 + size
    k = int(rng.integers(0, len(records)))
    code, body = records[k]
    match int(rng.integers(0, 4)):
        case 0:
            del records[k]
        case 1:
            records.insert(k, records[k])
        case 2:
            records[k] = (int(rng.integers(0, 17)), body)
        case 3:
            records[k] = (code, raw(body[:64], rng) + body[64:])
    return data[:8] + b"".join(bytes([c]) + struct.pack("<Q", len(b)) + b for c, b in records) + data[-8:]


def sqlite(inside: Mutation) -> Mutation:
    """Rows of an SQLite file changed by SQLite itself; packed cells by what is given."""

    def mutated(data: bytes, rng: Rng) -> bytes:
        base = sqlite3.connect(":memory:")
        base.deserialize(data)
        tables = [name for (name,) in base.execute("SELECT name FROM sqlite_schema WHERE type = 'table'")]
        name = pick([name for name in tables if not name.startswith("sqlite_")], rng)
        columns = [row[1] for row in base.execute(f'PRAGMA table_info("{name}")')]
        rows = [key for (key,) in base.execute(f'SELECT "{columns[0]}" FROM "{name}"')]
        column = pick(columns, rng)
        try:
            with base:
                _edit(base, name, columns[0], column, pick(rows, rng) if rows else 0, inside, rng)
        except sqlite3.Error:
            pass  # it keeps its own rules; the file stays sound
        out = base.serialize()
        base.close()
        return raw(out[:200], rng) + out[200:] if rng.random() < 0.05 else out

    return mutated


def _edit(
    base: sqlite3.Connection,
    name: str,
    key: str,
    column: str,
    row: object,
    inside: Mutation,
    rng: Rng,
) -> None:
    match int(rng.integers(0, 10)):
        case 0:
            base.execute(f'DELETE FROM "{name}" WHERE "{key}" {pick(("=", "<", ">"), rng)} ?', (row,))
        case 1:
            base.execute(f'ALTER TABLE "{name}" RENAME COLUMN "{column}" TO other')
        case 2:
            base.execute(
                pick(
                    (
                        f'DROP TABLE "{name}"',
                        f'ALTER TABLE "{name}" RENAME TO other',
                        f'ALTER TABLE "{name}" ADD COLUMN c',
                    ),
                    rng,
                )
            )
        case 3 | 4 | 5:
            value = pick((None, 0, -1, 2**62, 1e300, "", "x" * 9999, b"", b"\x00", "é", *VALUES[:10]), rng)
            base.execute(f'UPDATE "{name}" SET "{column}" = ? WHERE "{key}" = ?', (value, row))
        case _:
            (held,) = base.execute(f'SELECT "{column}" FROM "{name}" WHERE "{key}" = ?', (row,)).fetchone() or (b"",)
            packed = held if isinstance(held, bytes) else str(held).encode()
            new = inside(packed, rng)
            value = new if isinstance(held, bytes) else new.decode("utf-8", "replace")
            base.execute(f'UPDATE "{name}" SET "{column}" = ? WHERE "{key}" = ?', (value, row))
