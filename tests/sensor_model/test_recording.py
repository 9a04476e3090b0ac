"""The recording is read back as it was written, and says file, line and value when it cannot be read."""

from __future__ import annotations

import io
import os

import numpy as np
import pytest
from pydantic import ValidationError

from scenarios.load import load_scenario
from scenarios.scenario import nominal_pipe
from sensor_model.recording import (
    MAX_FILE_BYTES,
    OWN_HEADER,
    SLIT_PIXEL,
    BadRecording,
    NominalPipe,
    _read_slit_pixels,
    open_recording,
    read_frame,
)
from sensor_model.rig import Rig, load_settings, preset_rig
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    changes = ["sensing.fidelity=points", "drive.stages=[{to_mm: 30}]", "pipe.features=[]"]
    scenario = load_scenario("paper-gantry", changes)
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(0, "drive"))
    folder = tmp_path_factory.mktemp("log")
    frames = list(sense(truth, scenario.rig, scenario.rig, nominal_pipe(scenario), scenario.sensing, 0, folder))
    return folder, truth, frames


def test_frames_and_logs_come_back(log):
    folder, truth, frames = log
    recording = open_recording(folder)
    assert len(recording) == frames[-1] == int(truth.time_s[-1] * 15) + 1
    assert np.allclose(np.diff(recording.frame_stamps_ns) / 1e9, 1 / 15, atol=1e-8)
    frame = recording[3]
    assert frame.slit_pixels is not None
    assert set(frame.slit_pixels.slit) == set(range(8))
    travelled = frame.counts / 16884 * np.pi * 38
    true = truth.pose_at(np.array([frame.stamp_ns / 1e9]))[0, 2, 3]
    assert np.allclose(travelled, true, atol=0.02)
    assert np.linalg.norm(frame.q_world_imu_wxyz) == pytest.approx(1)
    with pytest.raises(IndexError, match=f"of {len(recording)}"):
        recording[len(recording)]


def test_the_rig_survives_its_file(log):
    assert load_settings(Rig, log[0] / "rig.yaml") == preset_rig()


def _spoiled(log, tmp_path, file, change):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(log[0], copy)
    path = copy / file
    path.write_text(change(path.read_text()))
    return copy


def _line3(text, new):
    lines = text.splitlines()
    lines[2] = new(lines[2])
    return "\n".join(lines) + "\n"


@pytest.mark.parametrize(
    ("file", "new", "said"),
    [
        ("imu0/data.csv", lambda line: line.replace(line.split(",")[2], "x", 1), r"data\.csv:3: .*'x'"),
        ("imu0/data.csv", lambda line: line + ",5", r"data\.csv:3: .*6 finite numbers"),
        (
            "orientation0/data.csv",
            lambda line: "-1" + line[line.index(",") :],
            r"data\.csv:3: '-1'; a stamp in ns",
        ),
        ("encoders0/data.csv", lambda line: line.rsplit(",", 1)[0] + ",nan", r"data\.csv:3: .*3 finite numbers"),
        ("cam0/data.csv", lambda line: line.split(",")[0] + ",../../x.png", r"data\.csv:3: .*plain file name"),
    ],
)
def test_a_spoiled_line_is_named(log, tmp_path, file, new, said):
    copy = _spoiled(log, tmp_path, file, lambda text: _line3(text, new))
    with pytest.raises(BadRecording, match=said):
        open_recording(copy)


def test_what_is_missing_is_named(log, tmp_path):
    import shutil

    for part in ("rig.yaml", "pipe.yaml", "imu0/data.csv", "cam0/data.csv"):
        copy = tmp_path / part.replace("/", "_")
        shutil.copytree(log[0], copy)
        (copy / part).unlink()
        with pytest.raises(BadRecording, match=part.rsplit("/", maxsplit=1)[-1].replace(".", r"\.")):
            open_recording(copy)


def test_a_picture_of_the_wrong_size_is_refused(log, tmp_path):
    import shutil

    import cv2

    copy = tmp_path / "copy"
    shutil.copytree(log[0], copy)
    stamp = (copy / "cam0" / "data.csv").read_text().splitlines()[1].split(",")[0]
    (copy / "cam0" / "data.csv").write_text(f"#timestamp [ns],filename\n{stamp},{stamp}.png\n")
    cv2.imwrite(str(copy / "cam0" / "data" / f"{stamp}.png"), np.zeros((10, 20, 3), np.uint8))
    with pytest.raises(BadRecording, match=r"\(10, 20\).*\(1232, 1664\)"):
        open_recording(copy)[0]
    (copy / "cam0" / "data" / f"{stamp}.png").write_bytes(b"not a picture")
    with pytest.raises(BadRecording, match="not a picture"):
        open_recording(copy)[0]


@pytest.mark.parametrize("kind", ["rgb", "gray", "rgba", "16 bit"])
def test_every_kind_of_png_is_read_as_a_general_reader_reads_it(kind, log, tmp_path):
    import cv2

    file, rig = tmp_path / "0.png", open_recording(log[0]).rig
    rgb = np.random.default_rng(0).integers(0, 256, (rig.camera.height_px, rig.camera.width_px, 3), dtype=np.uint8)
    pictures = {
        "rgb": rgb,
        "gray": rgb[..., 0],
        "rgba": np.dstack([rgb, rgb[..., 0]]),
        "16 bit": rgb.astype("u2") * 257,
    }
    cv2.imwrite(str(file), pictures[kind])
    np.testing.assert_array_equal(read_frame(file, rig), cv2.imread(str(file), cv2.IMREAD_COLOR_RGB))
    coded = bytearray(file.read_bytes())
    coded[len(coded) // 2] ^= 1
    file.write_bytes(coded)
    with pytest.raises(BadRecording, match=r"0\.png: not a picture that can be read"):
        read_frame(file, rig)


def test_a_picture_that_promises_gigabytes_is_refused_before_room_is_made(log, tmp_path):
    import cv2

    file, rig = tmp_path / "0.png", open_recording(log[0]).rig
    coded = cv2.imencode(".png", np.zeros((rig.camera.height_px, rig.camera.width_px, 3), np.uint8))[1].tobytes()
    file.write_bytes(coded)
    assert read_frame(file, rig).shape == (rig.camera.height_px, rig.camera.width_px, 3)
    at = coded.index(b"IDAT")
    file.write_bytes(coded[: at - 4] + (3_000_000_000).to_bytes(4, "big") + coded[at:])
    with pytest.raises(BadRecording, match="3000000000 bytes promised"):
        read_frame(file, rig)


def _log_with(log, tmp_path, change):
    import shutil

    copy = tmp_path / "copy"
    shutil.copytree(log[0], copy)
    file = sorted((copy / "cam0" / "data").iterdir())[0]
    made = change(np.load(file))
    if isinstance(made, bytes):
        file.write_bytes(made)
    else:
        np.save(file, made)
    return open_recording(copy)


def _set(name, value):
    def change(rows):
        rows[name] = value(rows[name])
        return rows

    return change


def _promising(count):
    """A frame whose header promises more rows than there are."""
    file = io.BytesIO()
    rows = np.lib.format.header_data_from_array_1_0(np.zeros(1, dtype=SLIT_PIXEL))
    np.lib.format.write_array_header_1_0(file, {**rows, "shape": (count,)})
    return file.getvalue()


NARROW = [("pixel", "<f4", (2,)), ("slit", "<i8"), ("sigma_px", "<f8")]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (_set("slit", lambda slit: slit + 100_000), "slits from 100000 to 100007; the rig has 0 to 7"),
        (_set("slit", lambda slit: -1 - slit), "slits from -8 to -1"),
        (_set("pixel", lambda pixel: pixel * np.nan), "finite"),
        (_set("sigma_px", np.zeros_like), "positive"),
        (_set("sigma_px", lambda sigma: sigma * 1e300), "at most 1e[+]06"),
        (lambda rows: np.stack([rows, rows]), r"shape \(2, \d+\)"),
        (lambda rows: rows.astype(NARROW), "<f4"),
        (lambda rows: np.array([{}]), "of object"),  # noqa: ARG005
        (lambda rows: _promising(123_456_789), "123456789 rows of 32 bytes promised, 0 bytes held"),  # noqa: ARG005
        (lambda rows: _promising(10**15), "10+ rows of 32 bytes promised, 0 bytes held"),  # noqa: ARG005
        (lambda rows: _promising(-1), "-1 rows"),  # noqa: ARG005
        (lambda rows: b"PK\x03\x04 not rows", "not a frame of slit pixels"),  # noqa: ARG005
        (lambda rows: b"", "not a frame of slit pixels"),  # noqa: ARG005
        (lambda rows: b"\x93NUMPY\x01\x00\x88\x13" + b"-" * 5000, "not a frame of slit pixels"),  # noqa: ARG005
        (lambda rows: b"\x93NUMPY\x01\x00\xff\xff{", "not a frame of slit pixels"),  # noqa: ARG005
        (lambda rows: bytes(MAX_FILE_BYTES + 1), f"{MAX_FILE_BYTES + 1} bytes; at most {MAX_FILE_BYTES}"),  # noqa: ARG005
    ],
)
def test_a_spoiled_frame_is_refused_before_it_is_used(log, tmp_path, change, said):
    with pytest.raises(BadRecording, match=said) as refused:
        _log_with(log, tmp_path, change)[0]
    assert str(refused.value).count(".npy") == 1  # the file is named once


@pytest.mark.parametrize("count", [0, 1, 9999, 10000])
def test_any_number_of_rows_is_read_back(tmp_path, count):
    rows = np.zeros(count, dtype=SLIT_PIXEL)
    rows["sigma_px"], rows["slit"], rows["pixel"][:, 0] = 0.25, np.arange(count) % 8, np.arange(count)
    np.save(tmp_path / "frame.npy", rows)
    assert OWN_HEADER.match((tmp_path / "frame.npy").read_bytes())
    pixels = _read_slit_pixels(tmp_path / "frame.npy", 8)
    assert np.array_equal(pixels.pixel, rows["pixel"])
    assert np.array_equal(pixels.slit, rows["slit"])
    assert np.array_equal(pixels.sigma_px, rows["sigma_px"])


def test_a_log_that_ends_early_is_refused(log, tmp_path):
    copy = _spoiled(log, tmp_path, "encoders0/data.csv", lambda text: "\n".join(text.splitlines()[:20]) + "\n")
    with pytest.raises(BadRecording, match=r"encoders0/data\.csv goes from 0 to 180000000 ns; it says nothing of \d+"):
        open_recording(copy)


def test_a_quaternion_without_length_is_refused(log, tmp_path):
    copy = _spoiled(
        log, tmp_path, "orientation0/data.csv", lambda text: _line3(text, lambda line: line.split(",")[0] + ",0,0,0,0")
    )
    with pytest.raises(BadRecording, match="a quaternion of length 0"):
        open_recording(copy)


def test_aliases_are_refused(log, tmp_path):
    copy = _spoiled(log, tmp_path, "pipe.yaml", lambda _: "inner_radius_mm: &a 70\nwall_thickness_mm: *a\n")
    with pytest.raises(BadRecording, match="aliases"):
        open_recording(copy)


@pytest.mark.parametrize(
    ("file", "old", "new", "said"),
    [
        ("pipe.yaml", "launch_mm: 0.0", "launch_mm: 1.0e+39", "launch_mm"),
        ("rig.yaml", "q_camera_imu_wxyz: [0.7", "q_camera_imu_wxyz: [7.7", "a quaternion of length"),
        ("rig.yaml", "axis: [0.0, 0.0, 1.0]", "axis: [0.0, 0.0, -1.0]", "axis must point ahead"),
        ("rig.yaml", "fx_px: 588.673", "fx_px: 5.0e+300", "fx_px"),
    ],
)
def test_numbers_that_no_rig_and_no_pipe_has_are_refused(file, old, new, said, log, tmp_path):
    """Squared, they are no numbers any more, and a fit that divides by them ends without a word."""
    copy = _spoiled(log, tmp_path, file, lambda text: text.replace(old, new))
    with pytest.raises(BadRecording, match=said):
        open_recording(copy)


def test_a_pipe_in_place_of_settings_is_not_waited_for(log, tmp_path):
    copy = _spoiled(log, tmp_path, "pipe.yaml", str)
    (copy / "pipe.yaml").unlink()
    os.mkfifo(copy / "pipe.yaml")
    with pytest.raises(BadRecording, match="no plain file"):
        open_recording(copy)


@pytest.mark.parametrize("text", ["[" * 5000, "- " * 5000])
def test_settings_nested_without_end_are_refused_at_once(text, log, tmp_path):
    """A YAML parser's time grows with the square of the depth, and then it runs out of stack."""
    copy = _spoiled(log, tmp_path, "pipe.yaml", lambda _: text)
    with pytest.raises(BadRecording, match="deep"):
        open_recording(copy)


def test_a_list_of_joints_out_of_order_is_refused():
    with pytest.raises(ValidationError, match=r"joint 1, at 500 mm, comes after the one at 700 mm; must ascend"):
        NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, joints_mm=(700, 500))
