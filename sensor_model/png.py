"""PNG as cameras write it, 8-bit RGB, in less than half of a general reader's time; any other is left to that one."""

from __future__ import annotations

import struct
import zlib

import numpy as np
from jaxtyping import UInt8
from numba import njit

SIGNATURE = b"\x89PNG\r\n\x1a\n"
IHDR = struct.Struct(">IIBBBBB")
RGB_8_BIT = (8, 2, 0, 0, 0)  # depth, colour type, and the only compression, filters and order of rows


def read_rgb(data: bytes) -> UInt8[np.ndarray, "height width 3"] | None:
    """The picture in a file's bytes; None for another kind of PNG, and for one with a fault.

    What the header states is believed: look at it before.
    """
    from isal import isal_zlib

    chunks = _chunks(data)
    if chunks is None:
        return None
    header, packed = chunks
    width, height, *kind = IHDR.unpack(header)
    row = 1 + 3 * width
    if tuple(kind) != RGB_8_BIT:
        return None
    unpacker = isal_zlib.decompressobj()
    try:
        rows = unpacker.decompress(packed, max_length=height * row)
    except isal_zlib.IsalError:  # type: ignore[misc]  # the stub says that it is an instance
        return None
    if len(rows) != height * row or not unpacker.eof:
        return None
    picture = np.empty((height, width, 3), dtype=np.uint8)
    known = _unfilter(np.frombuffer(rows, dtype=np.uint8).reshape(height, row), picture)
    return picture if known else None


def _chunks(data: bytes) -> tuple[bytes, bytes] | None:
    """Header and packed rows of a PNG that holds nothing else, each chunk whole."""
    header, packed, at = b"", [], len(SIGNATURE)
    if not data.startswith(SIGNATURE):
        return None
    while data[at + 4 : at + 8] != b"IEND":
        size, name = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        end = at + 8 + size
        if zlib.crc32(memoryview(data)[at + 4 : end]) != int.from_bytes(data[end : end + 4], "big"):
            return None
        if name == b"IDAT" and header:
            packed.append(memoryview(data)[at + 8 : end])
        elif name == b"IHDR" and not header and size == IHDR.size:
            header = data[at + 8 : end]
        else:
            return None
        at = end + 4
    return (header, b"".join(packed)) if header else None


@njit(cache=True, nogil=True, error_model="numpy")
def _unfilter(rows, picture):
    """Undo each row's filter, which its first byte names; whether all names are known."""
    height, width = picture.shape[:2]
    above = np.zeros(3 * width, dtype=np.uint8)
    for y in range(height):
        kind, row, out = rows[y, 0], rows[y, 1:], picture[y].reshape(-1)
        if kind == 0:
            out[:] = row
        elif kind == 1:
            out[:3] = row[:3]
            for k in range(3, row.size):
                out[k] = row[k] + out[k - 3]
        elif kind == 2:
            for k in range(row.size):
                out[k] = row[k] + above[k]
        elif kind == 3:
            for k in range(row.size):
                out[k] = row[k] + ((np.int32(above[k]) + (out[k - 3] if k >= 3 else 0)) >> 1)
        elif kind == 4:
            for c in range(3):
                left, corner = np.int32(0), np.int32(0)
                for k in range(c, row.size, 3):
                    up = np.int32(above[k])
                    left = (row[k] + _paeth(left, up, corner)) & 255
                    out[k], corner = left, up
        else:
            return False
        above = out
    return True


@njit(cache=True, nogil=True, inline="always")
def _paeth(left, up, corner):
    """Of three neighbours the nearest to left + up - corner."""
    by_left, by_up = abs(up - corner), abs(left - corner)
    by_corner = abs(left + up - 2 * corner)
    if by_left <= by_up and by_left <= by_corner:
        return left
    return up if by_up <= by_corner else corner
