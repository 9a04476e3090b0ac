"""Mutations of .npy, .npz and PLY files, packed again with their checksums right."""

from __future__ import annotations

import io
import struct
import warnings
import zipfile

import numpy as np

from campaigns.mutated_text import NUMBERS, SIZES, VALUES, Rng, pick, raw, table

LARGE_BYTES = 2**26
KINDS = (
    "<f8",
    ">f8",
    "<f4",
    "<f2",
    "<i8",
    ">i4",
    "|u1",
    "|i1",
    "|b1",
    "<c16",
    "<U4",
    "|S4",
    "<M8[ns]",
    "<m8[s]",
    "|V8",
    "<f16",
)
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
            return pick(
                (out[::-1], out[:0], np.repeat(out, 2), out[[name]], out.astype(values.dtype.newbyteorder())), rng
            )
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
            return pick(
                (flat, flat[:1].reshape(()) if flat.size else flat, values[None], values.T, np.asfortranarray(values)),
                rng,
            )
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
            members[k] = (
                pick(("../x.npy", "/etc/x.npy", "x.npy", name.upper(), name + "/", "x" * 300, name[:-4], "é.npy"), rng),
                body,
            )
        case 3:
            members.append(
                (pick(("../../x.npy", "more.npy", "dir/", "", "\x01"), rng), b"" if rng.random() < 0.5 else body)
            )
        case 4 if rng.random() < 0.2:
            members[k] = (name, packed_array(np.zeros(LARGE_BYTES // 8)))
        case 5:
            members[k] = (name, members[int(rng.integers(0, len(members)))][1])
        case 6:
            members.reverse()
        case _:
            members[k] = (name, npy(body, rng))
    packed = _zipped(members, rng)
    return _with_end_changed(packed, rng) if rng.random() < 0.15 else packed


def _zipped(members: list[tuple[str, bytes]], rng: Rng) -> bytes:
    out, kinds = (
        io.BytesIO(),
        (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA),
    )
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
    where, form = pick(
        ((6, "<H"), (8, "<H"), (10, "<H"), (16, "<I"), (20, "<I"), (24, "<I"), (28, "<H"), (42, "<I")), rng
    )
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
            words[min(1, len(words) - 1)] = pick(
                ("list uchar int", "double", "uchar", "int", "half", "face", "ascii", "vertex"), rng
            )
        case 2:
            del lines[k]
        case 3:
            lines.insert(k, lines[int(rng.integers(0, len(lines)))])
        case 4:
            lines.insert(
                k,
                pick(
                    (
                        "comment x",
                        "obj_info x",
                        "element face 5",
                        "element vertex 0",
                        "property double w",
                        "",
                        "x" * 5000,
                    ),
                    rng,
                ),
            )
        case 5:
            lines[1] = pick(
                [f"format {form} 1.0" for form in ("ascii", "binary_big_endian", "binary_little_endian", "x")], rng
            )
        case 6:
            body = pick((body[:-1], body + b"\x00", body[: len(body) // 2], b"", body * 2), rng)
        case _:
            body = _numbers_changed(body, b"ascii" in head, rng)
    if words is not None:
        lines[k] = " ".join(words)
    return "".join(line + "\n" for line in lines).encode() + b"end_header\n" + body


def _numbers_changed(body: bytes, plain: bool, rng: Rng) -> bytes:
    if plain:
        return table(body, rng)
    return changed(np.frombuffer(body, "<f4"), rng).tobytes()
