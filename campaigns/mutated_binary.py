"""Mutations of packed files that are packed again with their checksums right, so that what was changed is looked at."""

from __future__ import annotations

import io
import sqlite3
import struct
import zipfile
import zlib
from collections.abc import Callable
from functools import lru_cache

import numpy as np
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from campaigns.mutated_text import VALUES, Rng, pick, raw

SIZES = (0, 1, 2, 63, 64, 65, 255, 2**16, 2**24, 2**31 - 1, 2**31, 2**32 - 1)
NUMBERS = (np.nan, np.inf, -np.inf, 0.0, -1.0, 1e-300, 1e6, 1e12, 1e300, -1e300, 2.0**53, 2.0**63)
BOMB_BYTES = 2**26
KINDS = ("<f8", ">f8", "<f4", "<f2", "<i8", ">i4", "|u1", "|i1", "|b1", "<c16", "<U4", "|S4", "<M8[ns]", "<m8[s]", "|V8", "<f16")
HEADERS = (
    "{'descr': '|O', 'fortran_order': False, 'shape': (3,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (100000000,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (2, 0, 4294967296), }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (1" + ", 1" * 64 + "), }",
    "{'descr': [('pixel', '<f8', (2147483647,))], 'fortran_order': False, 'shape': (1,), }",
    "{'descr': [('pixel', '|O')], 'fortran_order': True, 'shape': (1,), }",
    "{'descr': '<f8', 'fortran_order': 1, 'shape': 3, }",
    "{'descr': '<f8', 'fortran_order': False, 'shape': (True,), }",
    "{'descr': 'zz', 'fortran_order': False, 'shape': (), }",
    "{'descr': '<U2147483647', 'fortran_order': False, 'shape': (0,), }",
    "{'descr': '|V0', 'fortran_order': False, 'shape': (1000000000000,), }",
    "{'descr': '" + "(" * 500 + "', 'fortran_order': False, 'shape': (), }",
    "[" * 900,
    "{" * 300,
    "-" * 5000 + "1",
    "lambda: 0",
    "\x00",
    "{}",
)


@lru_cache(maxsize=1)
def bomb() -> bytes:
    """Little that unpacks to much."""
    return zlib.compress(bytes(BOMB_BYTES), 9)


# ---- pictures


def png(data: bytes, rng: Rng) -> bytes:
    """Header, chunks or packed pixels of a PNG, with its checksums right."""
    chunks = _chunks(data)
    for _ in range(int(rng.integers(1, 3))):
        k = int(rng.integers(0, len(chunks)))
        match int(rng.integers(0, 9)):
            case 0 | 1:
                chunks[0] = (b"IHDR", _new_header(chunks[0][1], rng))
            case 2 | 3:
                chunks = _repacked(chunks, rng)
            case 4:
                chunks.insert(int(rng.integers(0, len(chunks) + 1)), (_chunk_kind(rng), rng.bytes(int(rng.integers(0, 40)))))
            case 5:
                packed = b"name\x00\x00" + bomb()
                chunks.insert(1, (pick((b"zTXt", b"iCCP"), rng), packed) if rng.random() < 0.1 else (b"tRNS", bytes(6)))
            case 6 if len(chunks) > 1:
                del chunks[k]
            case 7:
                chunks.insert(k, chunks[k])
            case 8:
                chunks[k] = (chunks[k][0], raw(chunks[k][1], rng))
    out = data[:8] + b"".join(
        struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body)) for kind, body in chunks
    )
    return out[: int(rng.integers(0, len(out)))] if rng.random() < 0.03 else out


def _chunks(data: bytes) -> list[tuple[bytes, bytes]]:
    found, at = [], 8
    while at + 12 <= len(data):
        size = int.from_bytes(data[at : at + 4], "big")
        found.append((data[at + 4 : at + 8], data[at + 8 : at + 8 + size]))
        at += 12 + size
    return found


def _new_header(header: bytes, rng: Rng) -> bytes:
    """One of size, depth, colour type, packing, filter and interlace."""
    fields = list(struct.unpack(">IIBBBBB", header[:13].ljust(13, b"\x00")))
    k = int(rng.integers(0, 7))
    fields[k] = int(pick(SIZES, rng)) if k < 2 else int(pick((0, 1, 2, 3, 4, 6, 8, 16, 255), rng))
    return struct.pack(">IIBBBBB", *fields)


def _repacked(chunks: list[tuple[bytes, bytes]], rng: Rng) -> list[tuple[bytes, bytes]]:
    """The pixels changed and packed again, or what unpacks to far more."""
    pixels = zlib.decompress(b"".join(body for kind, body in chunks if kind == b"IDAT") or zlib.compress(b"")) \
        if all(kind != b"IDAT" or body for kind, body in chunks) and rng.random() < 0.9 else b""
    new = pick((pixels[: len(pixels) // 2], pixels * 3, raw(pixels, rng), b"", bytes(len(pixels))), rng)
    packed = bomb() if rng.random() < 0.05 else zlib.compress(new, 1)
    at = next((k for k, (kind, _) in enumerate(chunks) if kind == b"IDAT"), len(chunks))
    rest = [chunk for chunk in chunks if chunk[0] != b"IDAT"]
    cut = int(rng.integers(0, len(packed) + 1))
    parts = [(b"IDAT", packed)] if rng.random() < 0.5 else [(b"IDAT", packed[:cut]), (b"IDAT", packed[cut:])]
    return [*rest[:at], *parts, *rest[at:]]


def _chunk_kind(rng: Rng) -> bytes:
    return pick((b"PLTE", b"tRNS", b"gAMA", b"cHRM", b"sBIT", b"eXIf", b"acTL", b"fcTL", b"IEND", b"IHDR", b"ABCD", b"tEXt"), rng)


# ---- arrays


def npy(data: bytes, rng: Rng) -> bytes:
    """Header or values of an .npy."""
    match int(rng.integers(0, 6)):
        case 0:
            version = pick((b"\x01\x00", b"\x02\x00", b"\x03\x00", b"\x09\x00"), rng)
            text = pick(HEADERS, rng).encode()
            size = struct.pack("<H" if version[:1] == b"\x01" else "<I", len(text))
            return data[:6] + version + size + text + data[-64:]
        case 1:
            return raw(data[:128], rng) + data[128:]
        case 2:
            return pick((data[:-1], data + b"\x00", data[: len(data) // 2], data[:128], data[:9], b""), rng)
    return packed_array(changed(np.load(io.BytesIO(data), allow_pickle=False), rng))


def packed_array(values: np.ndarray) -> bytes:
    """An array as the bytes of an .npy."""
    out = io.BytesIO()
    np.save(out, values, allow_pickle=False)
    return out.getvalue()


def changed(values: np.ndarray, rng: Rng) -> np.ndarray:
    """Some values, the kind, the order or the shape of an array, also of one field of its rows."""
    if values.dtype.names:
        out, name = values.copy(), pick(values.dtype.names, rng)
        with np.errstate(all="ignore"):
            new = changed(values[name], rng)
            if new.shape == out[name].shape and new.dtype.kind in "fiu":
                out[name] = new
                return out
            return pick((out[::-1], out[:0], np.repeat(out, 2), out[[name]], out.astype(values.dtype.newbyteorder())), rng)
    flat = values.ravel().copy()
    match int(rng.integers(0, 10)):
        case 0 | 1 | 2 | 3 if flat.size:
            at = rng.integers(0, flat.size, int(pick((1, 1, 1, 5, flat.size), rng)))
            with np.errstate(all="ignore"):
                flat[at] = np.asarray(pick(NUMBERS, rng)).astype(flat.dtype)
            return flat.reshape(values.shape)
        case 4:
            with np.errstate(all="ignore"):
                try:
                    return values.astype(pick(KINDS, rng))
                except (TypeError, ValueError):
                    return values[..., :0]
        case 5 if values.ndim:
            return pick((values[::-1], np.sort(values, axis=0), np.roll(values, 1, axis=0), values[..., ::-1]), rng)
        case 6 if values.ndim:
            return pick((values[:1], values[:0], values[:-1], values[..., :1], np.repeat(values, 2, axis=0)), rng)
        case 7:
            return pick((flat, flat[:1].reshape(()) if flat.size else flat, values[None], values.T, np.asfortranarray(values)), rng)
        case 8:
            with np.errstate(all="ignore"):
                return values * np.asarray(pick((-1, 0, 2, 1e3, 1e6, 1e-9), rng)).astype(values.dtype)
    return np.broadcast_to(np.asarray(pick(NUMBERS, rng)), values.shape).copy()


def npz(data: bytes, rng: Rng) -> bytes:
    """Members of a zip of arrays changed, dropped, doubled, renamed or added; packed again with their checksums."""
    with zipfile.ZipFile(io.BytesIO(data)) as parts:
        members = [(name, parts.read(name)) for name in parts.namelist()]
    k = int(rng.integers(0, len(members)))
    name, body = members[k]
    match int(rng.integers(0, 12)):
        case 0:
            del members[k]
        case 1:
            members.append(members[k])
        case 2:
            members[k] = (pick(("../x.npy", "/etc/x.npy", "x.npy", name.upper(), name + "/", "x" * 300, name[:-4], "é.npy"), rng), body)
        case 3:
            members.append((pick(("../../x.npy", "more.npy", "dir/", "", "\x01"), rng), b"" if rng.random() < 0.5 else body))
        case 4 if rng.random() < 0.2:
            members[k] = (name, packed_array(np.zeros(BOMB_BYTES // 8)))
        case 5:
            members[k] = (name, members[int(rng.integers(0, len(members)))][1])
        case 6:
            members.reverse()
        case _:
            members[k] = (name, npy(body, rng))
    packed = _zipped(members, rng)
    return _with_end_changed(packed, rng) if rng.random() < 0.15 else packed


def _zipped(members: list[tuple[str, bytes]], rng: Rng) -> bytes:
    import warnings

    out, kinds = io.BytesIO(), (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA)
    with zipfile.ZipFile(out, "w") as parts, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of names that stand twice
        link = int(rng.integers(0, len(members))) if members and rng.random() < 0.03 else -1
        for number, (name, body) in enumerate(members):
            info = zipfile.ZipInfo(name)
            info.compress_type = pick(kinds, rng) if rng.random() < 0.2 else zipfile.ZIP_DEFLATED
            if number == link:
                info.external_attr = 0o120777 << 16
            parts.writestr(info, b"../../x" if number == link else body, compresslevel=1)
    return out.getvalue()


def _with_end_changed(data: bytes, rng: Rng) -> bytes:
    """A field of the central directory: sizes, offsets, flags (encrypted), the way of packing."""
    out, at = bytearray(data), data.find(b"PK\x01\x02")
    if at < 0:
        return data
    where, form = pick(((6, "<H"), (8, "<H"), (10, "<H"), (16, "<I"), (20, "<I"), (24, "<I"), (28, "<H"), (42, "<I")), rng)
    struct.pack_into(form, out, at + where, int(pick((0, 1, 8, 99, 255, 2**16 - 1), rng)))
    return bytes(out)


def ply(data: bytes, rng: Rng) -> bytes:
    """Lines of the header, or numbers of the body."""
    head, _, body = data.partition(b"end_header\n")
    lines = head.decode().splitlines()
    k, words = int(rng.integers(1, len(lines))), None
    match int(rng.integers(0, 9)):
        case 0:
            words = lines[k].split(" ")
            words[-1] = pick((*map(str, SIZES), "-1", "1e3", "٣", "²", "x", "", "9" * 5000, *VALUES[:12]), rng)
        case 1:
            words = lines[k].split(" ")
            words[min(1, len(words) - 1)] = pick(("list uchar int", "double", "uchar", "int", "half", "face", "ascii", "vertex"), rng)
        case 2:
            del lines[k]
        case 3:
            lines.insert(k, lines[int(rng.integers(0, len(lines)))])
        case 4:
            lines.insert(k, pick(("comment x", "obj_info x", "element face 5", "element vertex 0", "property double w", "", "x" * 5000), rng))
        case 5:
            lines[1] = pick([f"format {form} 1.0" for form in ("ascii", "binary_big_endian", "binary_little_endian", "x")], rng)
        case 6:
            body = pick((body[:-1], body + b"\x00", body[: len(body) // 2], b"", body * 2), rng)
        case _:
            body = _numbers_changed(body, b"ascii" in head, rng)
    if words is not None:
        lines[k] = " ".join(words)
    return "".join(line + "\n" for line in lines).encode() + b"end_header\n" + body


def _numbers_changed(body: bytes, plain: bool, rng: Rng) -> bytes:
    from campaigns.mutated_text import table

    if plain:
        return table(body, rng)
    return changed(np.frombuffer(body, "<f4"), rng).tobytes()


# ---- bags


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
            new = pick(("", "std_msgs/msg/String", "sensor_msgs/msg/Imu", "x" * 3000, rows[0][0], "sensor_msgs/msg/Image"), rng)
            rows = [(new, *row[1:]) if row[2] == topic else row for row in rows]
        case 1:
            new = pick(("", "/rig", "/imu", "../x", "x" * 3000, *{row[2] for row in rows}), rng)
            rows = [(*row[:2], new, *row[3:]) if row[2] == topic else row for row in rows]
        case 2:
            rows = pick((rows[:k], rows[k:], rows[::-1], rows + rows[-3:], [row for row in rows if row[2] != topic]), rng)
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
    """A record of the file changed inside, its frame of code and length right; dropped, doubled, or with another code."""
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


def sqlite(inside: Callable[[bytes, Rng], bytes]) -> Callable[[bytes, Rng], bytes]:
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


def _edit(base: sqlite3.Connection, name: str, key: str, column: str, row: object, inside: Callable[[bytes, Rng], bytes], rng: Rng) -> None:
    match int(rng.integers(0, 10)):
        case 0:
            base.execute(f'DELETE FROM "{name}" WHERE "{key}" {pick(("=", "<", ">"), rng)} ?', (row,))
        case 1:
            base.execute(f'ALTER TABLE "{name}" RENAME COLUMN "{column}" TO other')
        case 2:
            base.execute(pick((f'DROP TABLE "{name}"', f'ALTER TABLE "{name}" RENAME TO other', f'ALTER TABLE "{name}" ADD COLUMN c'), rng))
        case 3 | 4 | 5:
            value = pick((None, 0, -1, 2**62, 1e300, "", "x" * 9999, b"", b"\x00", "é", *VALUES[:10]), rng)
            base.execute(f'UPDATE "{name}" SET "{column}" = ? WHERE "{key}" = ?', (value, row))
        case _:
            (held,) = base.execute(f'SELECT "{column}" FROM "{name}" WHERE "{key}" = ?', (row,)).fetchone() or (b"",)
            packed = held if isinstance(held, bytes) else str(held).encode()
            new = inside(packed, rng)
            value = new if isinstance(held, bytes) else new.decode("utf-8", "replace")
            base.execute(f'UPDATE "{name}" SET "{column}" = ? WHERE "{key}" = ?', (value, row))
