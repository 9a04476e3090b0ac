"""The quick reader of PNG gives what OpenCV gives, for every filter of a row; what it does not know it leaves alone."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from sensor_model.png import SIGNATURE, read_rgb

HEIGHT, WIDTH = 12, 7


def chunk(name: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + name + body + struct.pack(">I", zlib.crc32(name + body))


def png(rows: bytes, depth: int = 8, colour: int = 2, interlaced: int = 0, between: bytes = b"") -> bytes:
    """A picture of rows as they come, each with its filter's number before it."""
    header = struct.pack(">IIBBBBB", WIDTH, HEIGHT, depth, colour, 0, 0, interlaced)
    packed = zlib.compress(rows)
    parts = b"".join(chunk(b"IDAT", part) for part in (packed[:20], packed[20:]))
    return SIGNATURE + chunk(b"IHDR", header) + between + parts + chunk(b"IEND", b"")


def rows(filters: list[int], channels: int = 3) -> bytes:
    rng = np.random.default_rng(1)
    return b"".join(bytes([kind]) + rng.bytes(channels * WIDTH) for kind in filters)


def general(data: bytes) -> np.ndarray | None:
    return cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_COLOR_RGB)


@pytest.mark.parametrize("filters", [[kind] * HEIGHT for kind in range(5)] + [[4, 3, 2, 1, 0, 2] * 2])
def test_every_filter_is_undone_as_the_general_reader_does(filters):
    data = png(rows(filters))
    assert np.array_equal(read_rgb(data), general(data))


@pytest.mark.parametrize(
    "data",
    [
        png(rows([0] * HEIGHT, 1), colour=0),
        png(rows([0] * HEIGHT, 4), colour=6),
        png(rows([0] * HEIGHT, 6), depth=16),
        png(rows([0] * HEIGHT), between=chunk(b"eXIf", b"MM\0*")),  # which may turn the picture
    ],
)
def test_another_kind_is_left_to_the_general_reader(data):
    assert read_rgb(data) is None
    assert general(data) is not None


@pytest.mark.parametrize(
    "data",
    [
        b"",
        png(rows([0] * HEIGHT))[:-30],
        png(rows([0] * HEIGHT)).replace(b"IDAT", b"IDAU", 1),
        png(rows([5] * HEIGHT)),
        png(rows([0] * (HEIGHT - 1))),
        png(rows([0] * HEIGHT) + bytes(10**6)),  # more than was promised
        bytes(byte ^ (k == 60) for k, byte in enumerate(png(rows([1] * HEIGHT)))),
    ],
)
def test_a_faulty_file_gives_nothing(data):
    assert read_rgb(data) is None
