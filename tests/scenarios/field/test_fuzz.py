"""Strangers' logs: every reader gives a result or one clear line; `campaigns/fuzz.py` runs many more of them."""

from __future__ import annotations

import sqlite3
import struct

import pytest

from scenarios.document import BadInput
from scenarios.field.raw_messages import MAGIC, mcap_messages, sqlite_messages


@pytest.fixture(scope="module")
def fuzz(campaign):
    return campaign("fuzz")


def test_mutated_logs_are_read_or_refused_with_words(fuzz, small_log):
    pytest.importorskip("rosbags", reason="the package rosbags is not installed")
    tally = fuzz.fuzz(small_log, None, cases=12, seed=5)
    assert set(tally) == {
        "recording",
        "live",
        "mcap",
        "rosbag2",
        "picture",
        "scan.npz",
        "scan.ply",
        "scenario",
        "spool",
    }
    for counts in tally.values():
        assert set(counts) <= {"read", "refused"}


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
