"""Strangers' logs: every reader gives a result or one clear line; `campaigns/fuzz.py` runs many more of them."""

from __future__ import annotations

import os
import sqlite3
import struct

import pytest

from scenarios.document import BadInput
from scenarios.field.bag_files import open_bag
from scenarios.field.raw_messages import MAGIC, mcap_messages, sqlite_messages
from scenarios.field.read import read_log
from scenarios.field.told import Told


@pytest.fixture(scope="module")
def fuzz(campaign):
    return campaign("fuzz")


def test_what_is_mutated_is_read_or_refused_with_words(fuzz, small_log, tmp_path):
    pytest.importorskip("rosbags", reason="the package rosbags is not installed")
    tally = fuzz.fuzz(small_log, cases=2, seed=5, bad=tmp_path / "bad")
    assert {"recording", "measured", "live", "mcap", "rosbag2", "video", "run", "study folder", "scenario"} <= set(
        tally
    )
    for counts in tally.values():
        assert set(counts.what) <= {"read", "refused"}
    assert sum(counts.what["read"] for counts in tally.values()) > 10  # or it is only ever the first check that speaks


@pytest.mark.parametrize(
    ("said", "listed"),
    [
        ("relative_file_paths is expected", "nothing: [a.db3]"),
        (r"metadata\.yaml:3:\d+: .*got alias \*a", "x: &a [a.db3]\n  relative_file_paths: [*a, *a]"),
        ("nested more than 32 deep", f"relative_file_paths: {'[' * 5000}"),
        ("got '2026-13-45'", "relative_file_paths: [2026-13-45]"),
    ],
)
def test_a_bag_s_metadata_are_plain(said, listed, tmp_path):
    """Aliases would unfold without bounds, and other readers of YAML trip over dates that are none."""
    (tmp_path / "metadata.yaml").write_text(f"rosbag2_bagfile_information:\n  {listed}\n")
    with pytest.raises(BadInput, match=said), open_bag(tmp_path, tmp_path):
        pass


def test_a_pipe_named_as_a_video_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "video.mkv")
    with pytest.raises(BadInput, match=r"video\.mkv: is no plain file"):
        read_log(tmp_path, Told(), tmp_path / "work", lambda *_: None)


def record(code: int, body: bytes) -> bytes:
    return struct.pack("<BQ", code, len(body)) + body


def chunk(size: int, packing: bytes, packed: bytes) -> bytes:
    head = struct.pack("<QQQI", 0, 0, size, 0) + struct.pack("<I", len(packing)) + packing
    return record(6, head + struct.pack("<Q", len(packed)) + packed)


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_a_bomb_is_never_unpacked_further_than_it_promised(packing, tmp_path):
    if packing == "zstd":
        packed = pytest.importorskip("backports.zstd").compress(bytes(200 * 2**20))
    else:
        packed = pytest.importorskip("lz4.frame").compress(bytes(200 * 2**20))
    file = tmp_path / "bomb.mcap"
    file.write_bytes(MAGIC + chunk(1000, packing.encode(), packed))
    with pytest.raises(BadInput, match="got a chunk of 1001 bytes where 1000 were promised"):
        list(mcap_messages(file, []))
    file.write_bytes(MAGIC + chunk(2**40, packing.encode(), packed))
    with pytest.raises(BadInput, match=f"unpacks to {2**40} bytes; at most"):
        list(mcap_messages(file, []))


def test_a_bag_cut_off_in_the_middle_gives_what_it_has(tmp_path):
    file, remarks = tmp_path / "cut.mcap", []
    schema = record(3, struct.pack("<H", 1) + struct.pack("<I", 4) + b"kind" + bytes(8))
    channel = record(4, struct.pack("<HHI", 1, 1, 2) + b"/a" + bytes(8))
    message = record(5, struct.pack("<HIQQ", 1, 0, 0, 0) + b"body")
    file.write_bytes(MAGIC + schema + channel + message + message[:-2])
    assert [(raw.topic, raw.kind, raw.content) for raw in mcap_messages(file, remarks)] == [("/a", "kind", b"body")]
    assert "ends in the middle of a record" in remarks[0]


def test_a_view_without_end_is_no_bag(tmp_path):
    """It would give rows for ever."""
    bag = sqlite3.connect(tmp_path / "bag.db3")
    bag.execute("CREATE TABLE topics (id, name, type)")
    bag.execute(
        "CREATE VIEW messages AS WITH RECURSIVE n(id) AS (SELECT 1 UNION ALL SELECT id + 1 FROM n) "
        "SELECT id, 1 AS topic_id, x'00' AS data FROM n"
    )
    bag.commit()
    bag.close()
    with pytest.raises(BadInput, match="it has no tables topics and messages"):
        list(sqlite_messages(tmp_path / "bag.db3"))
