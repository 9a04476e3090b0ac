"""A log followed while it is written: the same bytes as a replay, after a kill too; a page for this machine alone."""

from __future__ import annotations

import filecmp
import json
import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection
from pathlib import Path

import numpy as np
import pytest

from algorithms.method import Method
from scenarios.document import BadInput
from scenarios.field import live
from scenarios.field.live_log import next_due, open_live, read_more
from scenarios.field.live_page import serve
from scenarios.field.replay import replay
from scenarios.field.told import Told
from sensor_model.recording import BadRecording, open_recording


def silent(*_):
    """Nobody watches."""


def in_threads(monkeypatch) -> None:
    """Workers that need not start."""
    monkeypatch.setattr("scenarios.field.live_eyes.ProcessPoolExecutor", lambda n, *_: ThreadPoolExecutor(n))


def grown(source: Path, target: Path, share: float) -> None:
    """Write so much of every table, the last line torn, and the frames it names."""
    for name in ("imu0", "orientation0", "encoders0", "cam0"):
        text = (source / name / "data.csv").read_text()
        (target / name).mkdir(parents=True, exist_ok=True)
        (target / name / "data.csv").write_text(text[: int(share * len(text))])
    (target / "cam0" / "data").mkdir(exist_ok=True)
    for file in (source / "cam0" / "data").iterdir():
        if not (target / "cam0" / "data" / file.name).exists():
            os.link(file, target / "cam0" / "data" / file.name)


def test_frames_come_when_all_tables_have_passed_them_and_are_those_of_the_finished_log(small_log, tmp_path):
    recording = open_recording(small_log)
    for name in ("rig.yaml", "pipe.yaml"):
        shutil.copy(small_log / name, tmp_path / name)
    log = open_live(tmp_path)
    came = []
    for share in (*np.linspace(0, 1, 40), 1.0):
        grown(small_log, tmp_path, share)
        read_more(log)
        while (due := next_due(log, at_end=False)) is not None:
            assert due.frame.stamp_ns <= log.imu.tail.stamp_ns
            came.append(due.frame)
            assert len(log.imu.stamps_ns) < 60  # what is over is let go
    while (due := next_due(log, at_end=True)) is not None:
        came.append(due.frame)
    assert len(came) == len(recording)
    for index, frame in enumerate(came):
        other = recording.frame(index)
        assert frame.index == index
        for part in ("stamp_ns", "q_world_imu_wxyz", "counts", "imu_stamps_ns", "imu"):
            assert np.array_equal(getattr(frame, part), getattr(other, part)), (index, part)


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("100,../../secret.png", "a plain file name"),
        ("100,a.png\n90,b.png", "does not come after 100"),
        ("x,a.png", "'x'"),
    ],
)
def test_a_line_that_cannot_be_is_refused(line, said, small_log, tmp_path):
    shutil.copytree(small_log, tmp_path / "log")
    (tmp_path / "log" / "cam0" / "data.csv").write_text(line + "\n")
    with pytest.raises(BadRecording, match=f"cam0/data.csv:[12]: .*{said}"):
        read_more(open_live(tmp_path / "log"))


def test_a_table_that_is_a_folder_is_refused(small_log, tmp_path):
    shutil.copytree(small_log, tmp_path / "log")
    (tmp_path / "log" / "imu0" / "data.csv").unlink()
    (tmp_path / "log" / "imu0" / "data.csv").mkdir()
    with pytest.raises(BadRecording, match=r"imu0/data\.csv: is no plain file"):
        read_more(open_live(tmp_path / "log"))


def test_an_attitude_without_length_is_refused(small_log, tmp_path):
    shutil.copytree(small_log, tmp_path / "log")
    (tmp_path / "log" / "orientation0" / "data.csv").write_text("# attitude\n1,1,0,0,0\n2,0,0,0,0\n")
    with pytest.raises(BadRecording, match=r"orientation0/data\.csv:3: a quaternion of length 0; 1 is expected"):
        read_more(open_live(tmp_path / "log"))


def test_after_a_kill_it_goes_on_and_ends_as_a_replay(small_log, tmp_path, monkeypatch):
    """The first life ends before it writes its result; one of the frames it left is torn."""
    monkeypatch.setattr("scenarios.field.page.write_page", lambda _, name, file: file.write_text(name))
    log, out, frames = tmp_path / "log", tmp_path / "out", len(open_recording(small_log))
    shutil.copytree(small_log, log)
    with (log / "cam0" / "data.csv").open("a") as table:
        table.write("# end\n")
    replay(log, Told(), Method(), tmp_path / "replay", 1, silent)

    def killed(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(live, "_written", killed)
        with pytest.raises(KeyboardInterrupt):
            live.follow(log, Method(), out, 1, 0, 5.0, silent)
    in_threads(monkeypatch)
    kept = sorted((tmp_path / "out.live" / "slits").glob("*.json"))
    assert len(kept) == frames
    assert not out.exists()
    kept[3].write_text(kept[3].read_text()[:20])
    with pytest.raises(BadInput, match="belongs to another log or method"):
        live.follow(log, Method.model_validate({"map": {"cell_z_mm": 4}}), out, 1, 0, 5.0, silent)
    live.follow(log, Method(), out, 1, 0, 5.0, silent)
    assert json.loads((out / "run.json").read_text())["live"]["looked_at"] == 1
    for name in ("wall_map.npz", "defects.csv", "trajectory.tum"):
        assert filecmp.cmp(out / "reconstruction" / name, tmp_path / "replay" / "reconstruction" / name, shallow=False)
    assert (out / "health.json").read_text() == (tmp_path / "replay" / "health.json").read_text()
    assert not (tmp_path / "out.live").exists()


def test_the_page_answers_on_the_loopback_alone_and_to_its_own_name():
    server = serve(0)
    try:
        host, port = server.http.server_address
        assert host == "127.0.0.1"
        for path, name, status in (
            ("/", f"127.0.0.1:{port}", 200),
            ("/", "evil.example", 404),
            ("/../etc", f"127.0.0.1:{port}", 404),
        ):
            line = HTTPConnection(host, port, timeout=5)
            line.request("GET", path, headers={"Host": name})
            answer = line.getresponse()
            assert answer.status == status
            assert b"passwd" not in answer.read()
            line.close()
    finally:
        server.close()


def test_the_page_of_a_moment_shows_defects_and_map(small_log, tmp_path, monkeypatch):
    pages = []
    in_threads(monkeypatch)
    monkeypatch.setattr(live.Server, "show", lambda _, page: pages.append(page))
    monkeypatch.setattr("scenarios.field.page.write_page", lambda _, name, file: file.write_text(name))
    monkeypatch.setattr(live, "SHOW_EVERY_S", 0.0)
    monkeypatch.setattr(live, "SHOW_SHARE", 1.0)
    result = live.follow(small_log, Method(), tmp_path / "out", 1, 0, 1.0, silent)
    assert "Wall map so far" in pages[-1]
    defect = result.found.defects[0]
    assert f"<td>{defect.distance_mm:.1f}</td>" in pages[-1]
