"""`pipetwin export` looks at what a folder is, and what it writes is opened again by readers that are not ours."""

from __future__ import annotations

import shutil

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.field.export import export
from scenarios.found_run import read_found
from sensor_model.geometry import rotation_from_wxyz, wall_direction
from sensor_model.recording import open_recording


def test_an_unknown_format_names_those_that_there_are(small_log):
    with pytest.raises(BadInput, match=r"a run goes to .*mcap.*did you mean rosbag2"):
        export(small_log, "rosbag", None)


def test_a_folder_without_a_recording_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no study is there, and no run"):
        export(tmp_path, "mcap", tmp_path / "out.mcap")


def test_a_folder_with_something_else_in_it_stays(small_log, tmp_path):
    pytest.importorskip("rosbags", reason="the package rosbags is not installed")
    target = tmp_path / "bag"
    target.mkdir()
    (target / "mine").touch()
    with pytest.raises(BadInput, match="cannot be written: Directory not empty"):
        export(small_log, "rosbag2", target)
    assert [file.name for file in tmp_path.iterdir()] == ["bag"]
    assert [file.name for file in target.iterdir()] == ["mine"]


def test_an_independent_reader_finds_in_the_mcap_what_was_recorded(small_log, tmp_path):
    reader = pytest.importorskip("mcap.reader", reason="the package mcap-ros2-support is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    pytest.importorskip("rosbags")
    (file,) = export(small_log, "mcap", tmp_path / "log.mcap")
    recording = open_recording(small_log)
    with file.open("rb") as stream:
        every = list(reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages())
    by_topic: dict[str, list] = {}
    for _, channel, _, message in every:
        by_topic.setdefault(channel.topic, []).append(message)
    imu = by_topic["/imu0"]
    stamps = [m.header.stamp.sec * 10**9 + m.header.stamp.nanosec for m in imu]
    assert stamps == recording.imu_stamps_ns.tolist()
    rates = np.array([[m.angular_velocity.x, m.angular_velocity.y, m.angular_velocity.z] for m in imu])
    assert np.array_equal(rates, recording.imu[:, :3])
    turned = np.array([m.position for m in by_topic["/encoders0"]])
    assert np.allclose(turned, recording.counts * 2 * np.pi / 16884, atol=1e-12)
    assert len(by_topic["/cam0/slit_pixels"]) == len(recording)
    assert by_topic["/rig"][0].data == (small_log / "rig.yaml").read_text()


def test_what_was_measured_is_in_the_bag_in_metres(found_folder, small_log, tmp_path):
    """Path, wall and defects as Foxglove and RViz draw them, read by a reader that is not ours."""
    reader = pytest.importorskip("mcap.reader", reason="the package mcap-ros2-support is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder")
    shutil.copytree(found_folder, tmp_path / "run")
    shutil.copytree(small_log, tmp_path / "run" / "recording")
    (file,) = export(tmp_path / "run", "mcap", tmp_path / "run.mcap")
    with file.open("rb") as stream:
        every = list(reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()]).iter_decoded_messages())
    by_topic: dict[str, list] = {}
    for _, channel, _, message in every:
        by_topic.setdefault(channel.topic, []).append(message)
    run = read_found(found_folder)
    place = [[m.pose.position.x, m.pose.position.y, m.pose.position.z] for m in by_topic["/pose"]]
    np.testing.assert_allclose(1000 * np.array(place), run.T_pipe_camera[:, :3, 3], atol=1e-9)
    moved = [m.transforms[0].transform.translation.z for m in by_topic["/tf"]]
    np.testing.assert_allclose(moved, np.array(place)[:, 2])
    assert by_topic["/tf"][0].transforms[0].child_frame_id == "cam0"
    (wall,) = by_topic["/wall"]
    assert wall.width == np.isfinite(run.deviation_mm).sum()
    cells = np.frombuffer(bytes(wall.data), dtype="<f4").reshape(-1, 5)
    assert [field.name for field in wall.fields] == ["x", "y", "z", "deviation_mm", "rgb"]
    assert 1000 * np.median(np.hypot(cells[:, 0], cells[:, 1])) == pytest.approx(run.bore_radius_mm, abs=0.2)
    (defects,) = by_topic["/defects"]
    assert len(defects.markers) == len(run.defects) > 0
    box, defect = defects.markers[0], run.defects[0]
    assert (box.scale.x, box.scale.z) == pytest.approx((defect.width_mm / 1000, defect.length_mm / 1000))
    # the box's second side points outward
    q = box.pose.orientation
    outward = rotation_from_wxyz(np.array([q.w, q.x, q.y, q.z]))[:, 1]
    np.testing.assert_allclose(outward, wall_direction(defect.theta_rad), atol=1e-9)
    assert box.pose.position.x == pytest.approx(
        outward[0] * (run.bore_radius_mm + defect.depth_mm / 2) / 1000, abs=1e-6
    )
