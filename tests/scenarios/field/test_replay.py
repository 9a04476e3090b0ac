"""A log replayed, whatever it came as: the same reconstruction to the byte, without truth, and its health beside it."""

from __future__ import annotations

import filecmp
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from algorithms.method import Method
from scenarios.document import BadInput
from scenarios.field import ros
from scenarios.field.export import export
from scenarios.field.replay import replay
from scenarios.field.told import Told
from scenarios.run import run
from sensor_model.recording import open_recording


def silent(*_):
    """Nobody watches."""


def replayed(log: Path, out: Path, told: Told = Told()):  # noqa: B008  a tuple
    return replay(log, told, None, out, 1, silent)


def same(one: Path, other: Path) -> bool:
    """Whether two folders hold the same files to the byte."""
    names = sorted(path.relative_to(one) for path in one.rglob("*") if path.is_file())
    there = sorted(path.relative_to(other) for path in other.rglob("*") if path.is_file())
    return names == there and all(filecmp.cmp(one / name, other / name, shallow=False) for name in names)


@pytest.fixture
def without_page(monkeypatch):
    """Its pictures take longer than all the rest."""
    monkeypatch.setattr("scenarios.field.page.write_page", lambda _, name, file: file.write_text(name))


@pytest.fixture(scope="module")
def first(small_log, tmp_path_factory) -> Path:
    """The replay that all others are held against."""
    out = tmp_path_factory.mktemp("first") / "replay"
    replayed(small_log, out)
    return out


@pytest.mark.usefixtures("without_page")
def test_a_run_without_its_truth_replays_to_the_same_bytes(scenario, tmp_path):
    run(scenario, tmp_path / "run", 1, silent)
    shutil.rmtree(tmp_path / "run" / "truth")
    replayed(tmp_path / "run", tmp_path / "replay")
    assert same(tmp_path / "run" / "reconstruction", tmp_path / "replay" / "reconstruction")
    assert not list((tmp_path / "replay").rglob("score.json"))


@pytest.mark.usefixtures("without_page")
@pytest.mark.parametrize("to", ["mcap", "rosbag2"])
def test_a_bag_replays_to_the_same_bytes(to, small_log, first, tmp_path):
    pytest.importorskip("rosbags", reason="the package rosbags is not installed")
    (bag,) = export(small_log, to, tmp_path / f"log.{to}")
    replayed(bag, tmp_path / "replay")
    assert same(first / "reconstruction", tmp_path / "replay" / "reconstruction")


@pytest.mark.usefixtures("without_page")
@pytest.mark.parametrize("mode", ["FILE", "MESSAGE"])
def test_a_packed_bag_replays_to_the_same_bytes(mode, small_log, first, tmp_path):
    pytest.importorskip("rosbags", reason="the package rosbags is not installed")
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer

    (plain,) = export(small_log, "rosbag2", tmp_path / "plain")
    packed = Writer(tmp_path / "packed", version=8, storage_plugin=StoragePlugin.SQLITE3)
    packed.set_compression(CompressionMode[mode], CompressionFormat.ZSTD)
    with Reader(plain) as bag, packed:
        known = {c.id: packed.add_connection(c.topic, c.msgtype, typestore=ros.types()) for c in bag.connections}
        for connection, stamp, content in bag.messages():
            packed.write(known[connection.id], stamp, content)
    replayed(tmp_path / "packed", tmp_path / "replay")
    assert same(first / "reconstruction", tmp_path / "replay" / "reconstruction")
    about = tmp_path / "packed" / "metadata.yaml"
    about.write_text(about.read_text().replace("zstd", "brotli"))
    with pytest.raises(BadInput, match=r"got 'brotli'; zstd is expected|got 'packed\.db3\.brotli'"):
        replayed(tmp_path / "packed", tmp_path / "again")


@pytest.mark.usefixtures("without_page")
def test_a_video_is_opened_by_others_and_replays_to_the_same_bytes(picture_log, tmp_path):
    import cv2

    (folder,) = export(picture_log, "video", tmp_path / "video")
    recording, video = open_recording(picture_log), cv2.VideoCapture(str(folder / "video.mkv"))
    for index in range(len(recording)):
        more, picture = video.read()
        assert more
        assert np.array_equal(picture[:, :, ::-1], recording[index].picture)
    assert not video.read()[0]
    replayed(picture_log, tmp_path / "one")
    replayed(folder, tmp_path / "two")
    assert same(tmp_path / "one" / "reconstruction", tmp_path / "two" / "reconstruction")


def test_the_page_begins_with_the_health_and_has_no_truth(first):
    page = (first / "report.html").read_text()
    assert page.index("Health of the log") < page.index("Defects as measured")
    assert "true outline" not in page
    health = json.loads((first / "health.json").read_text())
    assert health["verdict"] == "good"
    assert health["figures"]["imu0_rate_hz"] == 100
    assert {"clock", "camera", "IMU", "encoders", "rings"} == {one["part"] for one in health["findings"]}


@pytest.mark.usefixtures("without_page")
def test_another_rig_may_be_told(small_log, tmp_path):
    rig = open_recording(small_log).rig
    smaller = rig.model_copy(update={"wheels": {"diameters_mm": (37.0,) * 3, "counts_per_turn": 16884}})
    result = replayed(small_log, tmp_path / "replay", Told(rig=smaller))
    z = result.found.trajectory.T_pipe_camera[:, 2, 3]
    assert z[-1] - z[0] == pytest.approx(120 * 37 / 38, rel=0.003)


@pytest.mark.usefixtures("without_page")
def test_the_bag_of_another_robot_needs_rig_pipe_and_topics(foreign_bag, picture_log, tmp_path):
    with pytest.raises(BadInput, match="does not say by which rig"):
        replayed(foreign_bag, tmp_path / "replay")
    recording = open_recording(picture_log)
    told = Told(recording.rig, recording.pipe)
    with pytest.raises(BadInput, match="imu: got /imu/a, /imu/b; say which by --topics"):
        replayed(foreign_bag, tmp_path / "replay", told)
    (tmp_path / "topics.yaml").write_text("imu: /imu/b\nwheels: [left, right, top]\n")
    result = replayed(foreign_bag, tmp_path / "replay", told._replace(topics=tmp_path / "topics.yaml"))
    assert np.array_equal(result.recording.counts, recording.counts)
    assert np.array_equal(result.recording[2].picture, recording[2].picture)
    assert np.allclose(result.recording.imu, recording.imu, rtol=1e-8)
    assert any("no attitude in the log" in one.says for one in result.health.findings)
    assert result.found.trajectory.registered.all()
    z = result.found.trajectory.T_pipe_camera[:, 2, 3]
    counts = recording.frame(len(recording) - 1).counts - recording.frame(0).counts
    assert z[-1] - z[0] == pytest.approx(counts.mean() * np.pi * 38 / 16884, abs=0.05)


def test_what_cannot_be_read_says_so(small_log, tmp_path):
    with pytest.raises(BadInput, match="no such log"):
        replayed(tmp_path / "nowhere", tmp_path / "out")
    (tmp_path / "notes.txt").write_text("no log")
    with pytest.raises(BadInput, match="got no log that is known"):
        replayed(tmp_path / "notes.txt", tmp_path / "out")
    shutil.copytree(small_log, tmp_path / "log")
    lines = (tmp_path / "log" / "imu0" / "data.csv").read_text().splitlines()
    lines[5] = lines[5].replace(",", ",x", 1)
    (tmp_path / "log" / "imu0" / "data.csv").write_text("\n".join(lines))
    with pytest.raises(BadInput, match=r"log/imu0/data\.csv:6: could not convert"):
        replayed(tmp_path / "log", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("without_page")
def test_no_file_outside_the_log_is_followed(small_log, tmp_path):
    shutil.copytree(small_log, tmp_path / "log")
    frame = next((tmp_path / "log" / "cam0" / "data").iterdir())
    frame.rename(tmp_path / "elsewhere.npy")
    frame.symlink_to(tmp_path / "elsewhere.npy")
    with pytest.raises(BadInput, match="a symbolic link"):
        replayed(tmp_path / "log", tmp_path / "out")


@pytest.mark.usefixtures("without_page")
def test_a_method_that_was_tuned_is_used(small_log, tmp_path):
    method = Method.model_validate({"map": {"cell_z_mm": 4}})
    result = replay(small_log, Told(), method, tmp_path / "replay", 1, silent)
    assert result.found.wall.cell_z_mm == 4
    assert "cell_z_mm: 4" in (tmp_path / "replay" / "method.yaml").read_text()
