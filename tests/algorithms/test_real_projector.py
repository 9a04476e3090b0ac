"""The real projector's pictures, and the real frames in a pipe: what is found beside what was published."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from algorithms.calibration.boards import ArucoGrid
from algorithms.calibration.clean_pipe import fit_pipe, seat_prior
from algorithms.calibration.pipe_view import robust_residual_mm, view_pipe
from algorithms.calibration.slide import learn_slide, pixels_of, with_jag
from algorithms.decode import DecodeSettings, decode
from scenarios.calibration import projector
from scenarios.calibration.look import look_of, twin_of
from scenarios.calibration.pictures import read_picture
from sensor_model.optics import look
from sensor_model.rig import Rig, load_settings, preset_rig

# read by eye from magnified strips of the frames, every 10 degrees, before any decoder's points were laid over them
LABELS = Path(__file__).with_name("in_pipe_labels.csv")
LABEL_PX = 12.0  # slits are 35 px apart or more; the eye and the slide's print are off by 3
LINE_DEG = 0.5
PUBLISHED_DEG = [19.19, 21.43, 23.99, 26.58, 28.99]
PUBLISHED_RMS_MM = [0.36, 0.37, 0.38, 0.47, 0.44]


@pytest.fixture(scope="module")
def calibrated(shared, tmp_path_factory):
    folder = shared / "real" / "projector"
    if not folder.is_dir():
        pytest.skip("no real pictures of the projector's board")
    out = tmp_path_factory.mktemp("rig") / "rig.yaml"
    return projector.calibrate(folder, preset_rig(), ArucoGrid(), out), load_settings(Rig, out)


@pytest.fixture(scope="module")
def frames(shared):
    files = [shared / "real" / "in_pipe" / f"im{k}.png" for k in (1, 2)]
    if not all(file.is_file() for file in files):
        pytest.skip("no real frames in a pipe")
    return [read_picture(file) for file in files]


def test_all_slits_are_calibrated_near_the_published_cones(calibrated):
    figures, _ = calibrated
    assert figures["pairs_used"] == 8
    assert len(figures["slits"]) == 8
    found = [row["half_angle_deg"] for row in figures["slits"]]
    # with the published lens; its focal length stretches the angles by as much
    assert np.abs(np.array(found[:5]) - PUBLISHED_DEG).max() < 0.3
    assert np.array([row["residual_rms_mm"] for row in figures["slits"][:5]]) == pytest.approx(
        PUBLISHED_RMS_MM, rel=0.2
    )
    assert figures["apex_mm"][2] == pytest.approx(-53.5, abs=1.5)
    assert figures["correction_kept"]
    assert figures["left_out_residual_corrected_mm"] < 0.75 * figures["left_out_residual_mm"]


@pytest.fixture(scope="module")
def seated(calibrated, frames):
    """The rig in the pipe, and what the frames show by it; before that, what they show by the boards' rig."""
    rig = with_jag(calibrated[1], np.zeros((8, 0)))
    before = [view_pipe(frame, rig, DecodeSettings()) for frame in frames]
    rig, _ = fit_pipe([pixels_of(view) for view in before], rig, seat_prior(8), None)
    return rig, [view_pipe(frame, rig, DecodeSettings()) for frame in frames], before


def test_real_frames_are_decoded_and_one_diameter_and_one_slide_fit_both(seated):
    rig, views, before = seated
    for view in before:
        assert view.alignment.converged
        assert view.coverage(slice(0, 5)) > 0.90
        assert view.coverage(slice(5, 8)) > 0.80
    diameters = np.array([2 * view.alignment.radius_mm for view in views])
    assert np.ptp(diameters) < 0.01 * diameters.mean()
    assert all(np.mean(~view.right) < 0.01 for view in views)
    learned = learn_slide(views, rig)
    assert learned.helps
    assert (learned.corrected_mm < 0.75 * learned.plain_mm).all()
    assert max(robust_residual_mm(view) for view in views) < 1.2


def test_the_twin_looks_like_the_real_frames(seated, frames):
    width_deg = preset_rig("endoscope-measured").projector.slit_width_deg
    rig = seated[0]
    wide = rig.model_copy(update={"projector": rig.projector.model_copy(update={"slit_width_deg": width_deg})})
    for frame, view in zip(frames, seated[1], strict=True):
        drawn = twin_of(view, wide, look("endoscope"), np.random.default_rng(0))
        real = look_of(frame, view, rig).figures()
        twin = look_of(drawn, view_pipe(drawn, rig, DecodeSettings()), rig).figures()
        for name, value in real.items():
            assert twin[name] == pytest.approx(value, rel=0.2), name


@pytest.mark.parametrize("number", [1, 2])
def test_slits_are_found_where_the_eye_sees_them(frames, number):
    rig = preset_rig()
    seen = decode(frames[number - 1], rig, DecodeSettings())
    off = seen.pixel - [rig.camera.cx_px, rig.camera.cy_px]
    azimuth_deg, radius_px = np.degrees(np.arctan2(off[:, 0], -off[:, 1])) % 360, np.hypot(off[:, 0], off[:, 1])
    with LABELS.open() as file:
        rows = [row for row in csv.DictReader(file) if row["frame"] == f"im{number}"]
    assert len(rows) > 200
    names = [slit.name for slit in rig.projector.slits]
    found, right = np.zeros(len(rows), dtype=bool), np.zeros(len(rows), dtype=bool)
    inner = np.array([row["slit"] in names[:5] for row in rows])
    for k, row in enumerate(rows):
        line = np.abs(azimuth_deg - float(row["azimuth_deg"])) < 0.5 * LINE_DEG
        here = radius_px[line & (seen.slit == names.index(row["slit"]))]
        found[k] = here.size > 0
        right[k] = here.size > 0 and abs(here[0] - float(row["radius_px"])) < LABEL_PX
    assert right[inner].mean() >= 0.90
    assert right[~inner].mean() >= 0.80
    assert np.mean(found & ~right) < 0.01
