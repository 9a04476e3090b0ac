"""`pipetwin export` looks at what a folder is, and what it writes is opened again by readers that are not ours."""

from __future__ import annotations

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.field.export import RUN_FORMATS, export
from sensor_model.recording import open_recording


def test_an_unknown_format_names_those_that_there_are(small_log):
    with pytest.raises(BadInput, match=r"a run goes to .*mcap.*did you mean rosbag2"):
        export(small_log, "rosbag", None)


def test_a_folder_without_a_recording_is_refused(tmp_path):
    with pytest.raises(BadInput, match="no study is there, and no run"):
        export(tmp_path, "mcap", tmp_path / "out.mcap")


def test_an_export_that_is_there_already_stays(small_log, tmp_path):
    target = tmp_path / "bag"
    target.mkdir()
    with pytest.raises(BadInput, match="is there already"):
        RUN_FORMATS["rosbag2"].write(small_log, target)
    assert list(target.iterdir()) == []


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
