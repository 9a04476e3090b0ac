"""Messages of an MCAP file or an SQLite bag as bytes, in the file's order, within bounds: logs come from strangers."""

from __future__ import annotations

import struct
import sys
from collections.abc import Iterator
from io import BufferedIOBase, BytesIO
from pathlib import Path
from typing import Any, NamedTuple

from scenarios.document import BadInput

LARGEST_MESSAGE_BYTES = 64 * 2**20
LARGEST_CHUNK_BYTES = 256 * 2**20
MAGIC = b"\x89MCAP0\r\n"
SCHEMA, CHANNEL, MESSAGE, CHUNK, DATA_END = 3, 4, 5, 6, 15
BEFORE_CONTENT = 22  # channel, sequence number, two times


class Raw(NamedTuple):
    """One message, not yet understood."""

    topic: str
    kind: str
    content: bytes


class _Torn(Exception):
    """A record that ends after the file does."""


def mcap_messages(file: Path, remarks: list[str]) -> Iterator[Raw]:
    """Every CDR message of an MCAP file, in its order; one that ends too early gives what it has, and a remark.

    Raises:
        BadInput: for what is no MCAP, or would unpack beyond bounds.
    """
    channels: dict[int, tuple[str, str]] = {}
    kinds: dict[int, str] = {0: ""}
    with file.open("rb") as stream:
        if stream.read(len(MAGIC)) != MAGIC:
            raise BadInput([f"{file}: got no MCAP: it does not begin with its magic"])
        try:
            for code, record in _records(file, stream):
                inside = _chunk(file, record) if code == CHUNK else [(code, record)]
                for inner, body in inside:
                    if inner == SCHEMA:
                        kinds[_number(body, 0, "<H")] = _text(body, 2)[0]
                    elif inner == CHANNEL:
                        channels[_number(body, 0, "<H")] = _channel(body, kinds)
                    elif inner == MESSAGE and (channel := channels.get(_number(body, 0, "<H"))):
                        yield Raw(*channel, bytes(body[BEFORE_CONTENT:]))
                if code == DATA_END:
                    return
        except (struct.error, UnicodeDecodeError) as error:
            raise BadInput([f"{file}: got a broken record near byte {stream.tell()}: {error}"]) from error
        except _Torn:
            remarks.append(
                f"the bag ends in the middle of a record, after {stream.tell()} bytes; what came before is used"
            )


def _records(file: Path, stream: BufferedIOBase) -> Iterator[tuple[int, memoryview]]:
    """Code and content of every record at one level."""
    while head := stream.read(9):
        if len(head) < 9:
            raise _Torn
        code, size = struct.unpack("<BQ", head)
        if size > LARGEST_CHUNK_BYTES:
            raise BadInput([f"{file}: got a record of {size} bytes; at most {LARGEST_CHUNK_BYTES}"])
        body = stream.read(size)
        if len(body) < size:
            raise _Torn
        yield code, memoryview(body)


def _chunk(file: Path, record: memoryview) -> Iterator[tuple[int, memoryview]]:
    """The records inside a chunk."""
    size = _number(record, 16, "<Q")
    packing, after = _text(record, 28)
    if size > LARGEST_CHUNK_BYTES:
        raise BadInput([f"{file}: got a chunk that unpacks to {size} bytes; at most {LARGEST_CHUNK_BYTES}"])
    packed = record[after + 8 :]
    data = bytes(packed) if packing == "" else unpacked(file, packing, bytes(packed), size)
    if len(data) != size:
        raise BadInput([f"{file}: got a chunk of {len(data)} bytes where {size} were promised"])
    for code, body in _records(file, BytesIO(data)):
        if code == CHUNK:
            raise BadInput([f"{file}: got a chunk inside a chunk"])
        yield code, body


def unpacked(file: Path, packing: str, packed: bytes, size: int) -> bytes:
    """What was packed, but never more than one byte above what it may be.

    Raises:
        BadInput: for what cannot be unpacked.
    """
    try:
        if packing == "zstd":
            return zstd_unpacker()().decompress(packed, size + 1)
        if packing == "lz4":
            from lz4.frame import LZ4FrameDecompressor

            return LZ4FrameDecompressor().decompress(packed, size + 1)
    except ImportError as error:
        raise BadInput([f"{file}: packed by {packing}; pip install 'pipetwin[field]'"]) from error
    except Exception as error:  # each library has errors of its own
        raise BadInput([f"{file}: got a chunk that {packing} cannot unpack: {error}"]) from error
    raise BadInput([f"{file}: packed by {packing[:20]!r}; zstd, lz4 or nothing is expected"])


def zstd_unpacker() -> Any:
    """The class that unpacks zstd, of Python itself or before it was there."""
    if sys.version_info >= (3, 14):
        from compression.zstd import ZstdDecompressor
    else:
        from backports.zstd import ZstdDecompressor
    return ZstdDecompressor


def _channel(body: memoryview, kinds: dict[int, str]) -> tuple[str, str]:
    """Topic and message type of a channel."""
    topic, _ = _text(body, 4)
    return topic, kinds.get(_number(body, 2, "<H"), "")


def _number(body: memoryview, offset: int, form: str) -> int:
    return struct.unpack_from(form, body, offset)[0]


def _text(body: memoryview, offset: int) -> tuple[str, int]:
    """A string, and where it ends."""
    end = offset + 4 + _number(body, offset, "<I")
    if end > len(body):
        raise struct.error(f"a text that ends at byte {end} of a record of {len(body)}")
    return str(body[offset + 4 : end], "utf-8"), end


def sqlite_messages(file: Path) -> Iterator[Raw]:
    """Every message of an SQLite bag, in order of arrival.

    Raises:
        BadInput: for what is no such bag, or a message beyond bounds.
    """
    import sqlite3

    try:
        bag = sqlite3.connect(f"{file.resolve().as_uri()}?mode=ro&immutable=1", uri=True)
    except sqlite3.Error as error:
        raise BadInput([f"{file}: cannot be opened: {error}"]) from error
    try:
        bag.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_MESSAGE_BYTES)
        bag.execute("PRAGMA trusted_schema = OFF")
        tables = bag.execute("SELECT name FROM sqlite_schema WHERE type = 'table'").fetchall()
        if not {("topics",), ("messages",)} <= set(tables):  # a view could be anything, and without end
            raise BadInput([f"{file}: got no ROS 2 bag: it has no tables topics and messages"])
        topics = {number: (name, kind) for number, name, kind in bag.execute("SELECT id, name, type FROM topics")}
        rows = bag.execute("SELECT topic_id, data FROM messages ORDER BY id")
        for number, content in rows:
            topic, kind = topics.get(number, (None, None))
            if not (isinstance(topic, str) and isinstance(kind, str) and isinstance(content, bytes)):
                raise BadInput([f"{file}: got a row that is no message: {str(topic)[:60]!r}"])
            yield Raw(topic, kind, content)
    except (sqlite3.Error, UnicodeDecodeError) as error:
        raise BadInput([f"{file}: got no bag that can be read: {error}"]) from error
    finally:
        bag.close()
