"""Mutations of a PNG, packed again with its checksums right, so that what was changed is looked at."""

from __future__ import annotations

import struct
import zlib
from functools import lru_cache

from campaigns.mutated_text import SIZES, Rng, pick, raw

BOMB_BYTES = 2**26


@lru_cache(maxsize=1)
def bomb() -> bytes:
    """Little that unpacks to much."""
    return zlib.compress(bytes(BOMB_BYTES), 9)


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
                chunks.insert(
                    int(rng.integers(0, len(chunks) + 1)), (_chunk_kind(rng), rng.bytes(int(rng.integers(0, 40))))
                )
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
    try:
        pixels = zlib.decompressobj().decompress(b"".join(body for kind, body in chunks if kind == b"IDAT"), 2**16)
    except zlib.error:  # changed already
        pixels = b"\x00" * 99
    new = pick((pixels[: len(pixels) // 2], pixels * 3, raw(pixels, rng), b"", bytes(len(pixels))), rng)
    packed = bomb() if rng.random() < 0.05 else zlib.compress(new, 1)
    at = next((k for k, (kind, _) in enumerate(chunks) if kind == b"IDAT"), len(chunks))
    rest = [chunk for chunk in chunks if chunk[0] != b"IDAT"]
    cut = int(rng.integers(0, len(packed) + 1))
    parts = [(b"IDAT", packed)] if rng.random() < 0.5 else [(b"IDAT", packed[:cut]), (b"IDAT", packed[cut:])]
    return [*rest[:at], *parts, *rest[at:]]


def _chunk_kind(rng: Rng) -> bytes:
    return pick(
        (b"PLTE", b"tRNS", b"gAMA", b"cHRM", b"sBIT", b"eXIf", b"acTL", b"fcTL", b"IEND", b"IHDR", b"ABCD", b"tEXt"),
        rng,
    )
