"""The camera's clock: latency, jitter, lost frames and the strobe, and encoders that miss edges."""

from __future__ import annotations

import numpy as np
import pytest

from sensor_model.encoders import with_missed_counts
from sensor_model.raycast import draw
from sensor_model.recording import NominalPipe, open_recording
from sensor_model.rig import preset_rig
from sensor_model.sense import Sensing, sense
from sensor_model.stamps import Timing, stamps_and_exposures_s
from twin.drives.gantry import GantryDrive, drive
from twin.features.pocket import Pocket
from twin.pipe import Pipe
from twin.robot import Robot

EDGE = Pocket(distance_mm=120, clock_deg="4:00", length_mm=30, width_mm=35, depth_mm=5)
PIPE = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=(EDGE,))
TRUTH = drive(PIPE, Robot(), GantryDrive(stages=[{"to_mm": 300}]), np.random.default_rng(0))
RIG = preset_rig()


def frames(timing: Timing, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    return stamps_and_exposures_s(TRUTH, 15.0, timing, np.random.default_rng(seed))


def test_without_errors_a_frame_is_exposed_at_its_stamp():
    stamp_s, exposed_s = frames(Timing())
    np.testing.assert_array_equal(exposed_s, stamp_s[:, None])
    np.testing.assert_array_equal(stamp_s, TRUTH.sample_times_s(15.0))


def test_latency_jitter_and_lost_frames_have_the_stated_size():
    stamp_s, exposed_s = frames(Timing(camera_latency_ms=30, stamp_jitter_ms=4))
    late_ms = 1e3 * (stamp_s - exposed_s[:, 0])[2:]  # before, the drive has not begun
    assert late_ms.mean() == pytest.approx(30, abs=1.5)
    assert late_ms.std() == pytest.approx(4, rel=0.3)
    kept = np.mean([len(frames(Timing(dropped_share=0.2), seed)[0]) for seed in range(50)])
    assert kept == pytest.approx(0.8 * len(stamp_s), rel=0.03)
    assert frames(Timing(dropped_share=0.95))[0][0] == stamp_s[0]
    with pytest.raises(ValueError, match=r"can swap frames at 15 Hz; less than 11\.1 ms"):
        frames(Timing(stamp_jitter_ms=12))


def test_a_recording_with_a_late_clock_shows_what_was_seen_before(tmp_path):
    """At 50 mm/s a latency of 40 ms shifts what is seen by 2 mm against the stamp."""

    def slits(latency_ms: float) -> tuple[np.ndarray, int]:
        timing = Timing(camera_latency_ms=latency_ms, dropped_share=0.5)
        sensing = Sensing(fidelity="points", points={"pixel_noise_px": 0, "drop_out_share": 0}, timing=timing)
        nominal = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
        folder = tmp_path / f"{latency_ms}"
        for _ in sense(TRUTH, RIG, RIG, nominal, sensing, 3, folder):
            pass
        recording = open_recording(folder)
        near = int(np.argmin(np.abs(recording.frame_stamps_ns / 1e9 - 1.0)))
        return recording[near].slit_pixels, int(recording.frame_stamps_ns[near])

    (seen, stamp_ns), (late, late_ns) = slits(0.0), slits(40.0)
    assert stamp_ns == late_ns
    assert not np.array_equal(seen.pixel, late.pixel)


def test_missed_edges_lose_their_share_of_the_counts_either_way():
    there = np.repeat(np.arange(0, 20_000, 40)[:, None], 3, axis=1)
    counts = np.concatenate([there, there[::-1]])
    np.testing.assert_array_equal(with_missed_counts(counts, 0.0, np.random.default_rng(0)), counts)
    missed = with_missed_counts(counts, 0.05, np.random.default_rng(0))
    turn = len(there) - 1
    assert missed[turn] == pytest.approx(0.95 * counts[turn], rel=0.01)
    assert np.abs(missed[-1]) == pytest.approx(np.zeros(3), abs=200)


def test_a_strobe_smears_the_picture_by_the_way_it_burns(monkeypatch, tmp_path):
    """The mean of the poses that the strobe spans, and not the picture of its middle."""
    import cv2

    from sensor_model import sense as module

    drawn: list[float] = []

    def watched(pipe, pose, rig, optics):
        drawn.append(float(pose[2, 3]))
        return draw(pipe, pose, rig, optics)

    monkeypatch.setattr("sensor_model.raycast.draw", watched)
    _, exposed_s = frames(Timing(strobe_ms=20))
    sensing = Sensing(fidelity="raycast", optics={"shot_noise": 0, "read_noise": 0})
    poses = TRUTH.pose_at(exposed_s[20])
    for name, taken in (("smeared", poses), ("sharp", poses[1:2])):
        module.write_frame(PIPE, taken, RIG, sensing, 0, 20, tmp_path / f"{name}.png")
    assert np.ptp(drawn[:3]) == pytest.approx(1.0, abs=0.01)  # 20 ms at 50 mm/s
    assert drawn[3] == pytest.approx(np.mean(drawn[:3]), abs=1e-3)
    smeared, sharp = (cv2.imread(str(tmp_path / f"{name}.png")).astype(float) for name in ("smeared", "sharp"))
    assert 0.05 < np.abs(smeared - sharp).mean() < 5
