"""What strangers give `calibrate` and `decode`: every fault in one line that names the file."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from scipy.io import savemat
from typer.testing import CliRunner

from scenarios.calibration.imu import read_log, read_poses
from scenarios.calibration.pictures import read_picture
from scenarios.cli import app
from scenarios.document import BadInput

ROW = "21:14:49, {ns}, 0,0,0, 0,0,1, 0,0,0, 1,0,0,{z}"


def _log(tmp_path, *rows):
    file = tmp_path / "log.csv"
    file.write_text("\n".join(["header", *rows]) + "\n")
    return file


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        (["21:14:49, 1, 0, 0"], "got 4 columns"),
        ([ROW.format(ns=1, z=0), ROW.format(ns=2, z="nan")], "log.csv:3: got 1, 0, 0, nan"),
        ([ROW.format(ns=5, z=0), ROW.format(ns=4, z=0)], "stamps must rise"),
        ([ROW.format(ns=1, z=0).replace("21:14", "x")], "numbers are expected"),
        ([ROW.format(ns=1, z=0)], "2 or more"),
    ],
)
def test_a_log_s_fault_is_named_by_line(tmp_path, rows, said):
    with pytest.raises(BadInput) as fault:
        read_log(_log(tmp_path, *rows))
    assert said in fault.value.lines[0]


def test_a_log_may_pass_midnight_and_be_a_recording_s_own(tmp_path):
    late = ROW.format(ns=1, z=0).replace("21:14:49", "23:59:59")
    assert read_log(_log(tmp_path, late, ROW.format(ns=1, z=0).replace("21:14:49", "00:00:00"))).shape == (2, 4)
    ours = tmp_path / "data.csv"
    ours.write_text("#timestamp [ns],w,x,y,z\n1,1,0,0,0\n2,1,0,0,0\n")
    assert read_log(ours).shape == (2, 4)


def test_poses_that_are_none_are_refused(tmp_path):
    for name, text, said in [
        ("p.mat", "not a mat", "no MATLAB file"),
        ("p.csv", "rx,ry,rz\n1,2,x\n", "rows of rx, ry, rz"),
        ("q.csv", "rx,ry,rz\n1,2,nan\n", "pose 1 is not finite"),
    ]:
        (tmp_path / name).write_text(text)
        with pytest.raises(BadInput) as fault:
            read_poses(tmp_path / name)
        assert said in fault.value.lines[0]


def test_a_file_that_ends_its_reader_with_the_process_is_refused(tmp_path):
    """One flipped bit in the tag of the values, on which scipy's compiled reader has no mercy."""
    savemat(tmp_path / "poses.mat", {"rvecs": np.arange(24.0).reshape(8, 3) / 10})
    assert read_poses(tmp_path / "poses.mat")[1] == pytest.approx([0.3, 0.4, 0.5])
    data = bytearray((tmp_path / "poses.mat").read_bytes())
    data[185] = 1
    (tmp_path / "poses.mat").write_bytes(data)
    with pytest.raises(BadInput, match=r"poses\.mat: is no MATLAB file that can be read"):
        read_poses(tmp_path / "poses.mat")


def test_pictures_that_are_none_are_refused(tmp_path):
    text = tmp_path / "text.png"
    text.write_text("hello")
    small = tmp_path / "small.png"
    Image.fromarray(np.zeros((8, 8, 3), np.uint8)).save(small)
    for file, said in [(text, "no picture"), (small, "8 x 8 px"), (tmp_path / "none.png", "no such file")]:
        with pytest.raises(BadInput) as fault:
            read_picture(file)
        assert str(file) in fault.value.lines[0]
        assert said in fault.value.lines[0]


def test_decoding_what_shows_no_pipe_says_so(tmp_path):
    black, odd = tmp_path / "black.png", tmp_path / "odd.png"
    Image.fromarray(np.zeros((1232, 1664, 3), np.uint8)).save(black)
    Image.fromarray(np.zeros((480, 640, 3), np.uint8)).save(odd)
    for words, said in [
        (["decode", str(black)], "slit points"),
        (["decode", str(odd)], "640 x 480 px"),
        (["calibrate", "projector", str(tmp_path), "--camera", "endoscope", "--out", "r.yaml"], "0 pairs"),
        (["calibrate", "pipe", str(black), "--rig", "endoscope", "--out", "r.yaml"], "slit points"),
    ]:
        result = CliRunner().invoke(app, words)
        assert isinstance(result.exception, BadInput), result.output
        assert said in result.exception.lines[0]
