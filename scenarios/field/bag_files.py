"""The files of a bag and how they are packed: whole files or each message, by zstd, unpacked within bounds."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from tempfile import TemporaryDirectory
from typing import NamedTuple

from scenarios.document import BadInput, read_file
from scenarios.field.raw_messages import (
    LARGEST_MESSAGE_BYTES,
    Raw,
    mcap_messages,
    sqlite_messages,
    unpacked,
    zstd_unpacker,
)

METADATA = "metadata.yaml"
SUFFIXES = (".mcap", ".db3")
PACKED = ".zstd"
MODES = (
    "",
    "NONE",
    "STORAGE",
    "FILE",
    "MESSAGE",
)  # of the first three MCAP says itself what is packed
LARGEST_BAG_BYTES = 64 * 2**30
PIECE_BYTES = 2**22


class Bag(NamedTuple):
    """Files that can be read, in their order, and whether each message in them is packed."""

    files: list[Path]
    messages_packed: bool


def is_bag(log: Path) -> bool:
    """Whether it is a bag's folder, or one file of a bag."""
    return (log / METADATA).is_file() if log.is_dir() else log.suffix in SUFFIXES


@contextmanager
def open_bag(log: Path, beside: Path) -> Iterator[Bag]:
    """A bag's files, unpacked into a folder that is gone afterwards where they are packed as a whole.

    Raises:
        BadInput: for a file elsewhere, one that is missing, or one that cannot be unpacked.
    """
    if not log.is_dir():
        yield Bag([log], False)
        return
    names, mode = _told(log / METADATA)
    whole = mode == "FILE"
    with TemporaryDirectory(dir=beside, prefix=".unpacked-") as folder:
        files = [_inside(log, name, SUFFIXES + tuple(s + PACKED for s in SUFFIXES) * whole) for name in names]
        if whole:
            files = [_unpack(file, Path(folder)) if file.suffix == PACKED else file for file in files]
        yield Bag(files, mode == "MESSAGE")


def bag_messages(bag: Bag, remarks: list[str]) -> Iterator[Raw]:
    """The messages of all files of a bag."""
    for file in bag.files:
        for raw in mcap_messages(file, remarks) if file.suffix == ".mcap" else sqlite_messages(file):
            yield raw if not bag.messages_packed else _plain(file, raw)


def _plain(file: Path, raw: Raw) -> Raw:
    content = unpacked(file, "zstd", raw.content, LARGEST_MESSAGE_BYTES)
    if len(content) > LARGEST_MESSAGE_BYTES:
        raise BadInput([f"{file}: {raw.topic[:60]}: a message unpacks to more than {LARGEST_MESSAGE_BYTES} bytes"])
    return raw._replace(content=content)


def _told(file: Path) -> tuple[list[str], str]:
    """Names of the files, and how they are packed."""
    document = read_file(file, kind="bag's metadata")
    if document.faults:
        raise BadInput(document.faults)
    about = document.data.get("rosbag2_bagfile_information") if isinstance(document.data, dict) else None
    given = about.get("relative_file_paths") if isinstance(about, dict) else None
    if not (isinstance(about, dict) and isinstance(given, list)):
        raise BadInput([f"{file}: got no bag's metadata: rosbag2_bagfile_information.relative_file_paths is expected"])
    names = [str(name) for name in given]
    mode, form = (str(about.get(f"compression_{what}") or "") for what in ("mode", "format"))
    if mode.upper() not in MODES:
        raise BadInput([f"{file}: compression_mode: got {mode[:40]!r}; one of {', '.join(MODES[1:])} is expected"])
    if mode.upper() in MODES[3:] and form != "zstd":
        raise BadInput([f"{file}: compression_format: got {form[:40]!r}; zstd is expected"])
    return names, mode.upper()


def _inside(log: Path, name: str, suffixes: tuple[str, ...]) -> Path:
    file = log / name
    if PurePath(name).name != name or file.is_symlink() or not name.endswith(suffixes):
        allowed = f"a plain name ({', '.join(suffixes)}) is expected"
        raise BadInput([f"{log / METADATA}: relative_file_paths: got {name[:80]!r}; {allowed}"])
    if not file.is_file():
        raise BadInput([f"{file}: missing, named in {log / METADATA}"])
    return file


def _unpack(file: Path, folder: Path) -> Path:
    """One packed file as a plain one, piece by piece."""
    target, written = folder / file.stem, 0
    try:
        unpacker = zstd_unpacker()()
    except ImportError as error:
        raise BadInput([f"{file}: packed by zstd; pip install 'pipetwin[field]'"]) from error
    with file.open("rb") as packed, target.open("wb") as plain:
        while not unpacker.eof:
            more = packed.read(PIECE_BYTES) if unpacker.needs_input else b""
            if unpacker.needs_input and not more:
                raise BadInput([f"{file}: ends in the middle of its packing"])
            try:
                piece = unpacker.decompress(more, PIECE_BYTES)
            except Exception as error:  # the library has an error of its own
                raise BadInput([f"{file}: cannot be unpacked by zstd: {error}"]) from error
            written += len(piece)
            if written > LARGEST_BAG_BYTES:
                raise BadInput([f"{file}: unpacks to more than {LARGEST_BAG_BYTES} bytes"])
            plain.write(piece)
    return target
