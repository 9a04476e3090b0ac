"""A spool's check passes a sound rig and names what a knocked one gets wrong."""

from __future__ import annotations

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.field.spool import read_spool
from scenarios.field.verify import verify

POCKET = "{kind: pocket, distance_mm: 150, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 3}"
SMALL = "{kind: pocket, distance_mm: 220, clock_deg: 240, length_mm: 25, width_mm: 20, depth_mm: 2}"
SHORT = ("sensing.frame_rate_hz=10", "pipe.end_mm=500", "drive.stages=[{to_mm: 220}]")
SPOOL = """
name: spool 7
inner_radius_mm: 76.2
inner_radius_u95_mm: 0.01
wall_thickness_mm: 7.5
axis_deg: [1.5, 2.0]
defects:
  - {name: A, distance_mm: 50, clock_deg: "3:00", length_mm: 40, length_u95_mm: 0.05, width_mm: 30,
     width_u95_mm: 0.05, depth_mm: 3, depth_u95_mm: 0.02}
  - {name: B, distance_mm: 120, clock_deg: "7:00", length_mm: 25, length_u95_mm: 0.05, width_mm: 20,
     width_u95_mm: 0.05, depth_mm: 2, depth_u95_mm: 0.02}
"""


@pytest.fixture(scope="module")
def spool(tmp_path_factory):
    """Distances and clock positions are the spool's own: 100 mm and an hour off the scan's."""
    file = tmp_path_factory.mktemp("spool") / "spool.yaml"
    file.write_text(SPOOL)
    return file


@pytest.fixture(scope="module")
def scan_of_spool(run_of, tmp_path_factory):
    def scan(*changes, seed=0, features=f"pipe.features=[{POCKET}, {SMALL}]"):
        return run_of(tmp_path_factory.mktemp("scan") / "run", *SHORT, features, *changes, seed=seed)

    return scan


@pytest.fixture(scope="module")
def sound(scan_of_spool):
    return scan_of_spool()


def test_a_sound_rig_passes_by_run_and_by_log(sound, spool, tmp_path):
    done = CliRunner().invoke(app, ["verify", str(sound), "--spool", str(spool), "-o", str(tmp_path / "check")])
    assert done.exit_code == 0, done.output
    assert "spool 7: INSIDE: all 10 figures judged." in done.output
    held = json.loads((tmp_path / "check" / "verify.json").read_text())
    by_log = verify(sound / "recording", read_spool(spool))
    assert by_log.verdict == held["verdict"] == "inside"
    assert by_log.laid.offset_mm == pytest.approx(-100, abs=1)
    for row, figure in zip(held["figures"], (*by_log.rig, *by_log.sizing), strict=True):
        assert row["measured"] == pytest.approx(figure.measured, abs=0.01)


@pytest.mark.parametrize(
    ("error", "named"),
    [
        ("true_rig.projector.apex_mm=[0, 0, -52.7]", "diameter"),
        ("true_rig.projector.axis=[0.00524, 0, 0.99999]", "axis, off the accepted one"),
    ],
)
def test_a_rig_that_was_knocked_fails_and_is_named(scan_of_spool, spool, tmp_path, error, named):
    scan = scan_of_spool(error)
    done = CliRunner().invoke(app, ["verify", str(scan), "--spool", str(spool), "-o", str(tmp_path / "check")])
    assert done.exit_code == 1, done.output
    verdict = next(line for line in done.output.splitlines() if "OUTSIDE" in line)
    assert named in verdict
    assert "faulty" in (tmp_path / "check" / "report.html").read_text()


def test_a_certified_size_that_is_off_a_defect_too_many_and_one_missing_are_outside(sound, scan_of_spool, spool):
    told = read_spool(spool)
    deeper = told.defects[0].model_copy(update={"depth_mm": 3.4})
    check = verify(sound, told.model_copy(update={"defects": (deeper, told.defects[1])}))
    (off,) = [figure for figure in check.sizing if figure.verdict == "outside"]
    assert (off.what, off.certified) == ("A: depth", 3.4)
    more = scan_of_spool(features=f"pipe.features=[{POCKET}, {SMALL.replace('220', '180').replace('240', '30')}]")
    said = {figure.what: figure for figure in verify(more, told).sizing}
    assert said["B: depth"].verdict == "outside"
    assert said["B: depth"].words.startswith("not found, and 8")
    assert said["false call"].verdict == "outside"


def test_a_defect_that_was_not_seen_is_not_judged_and_the_check_does_not_pass(scan_of_spool, spool):
    short = scan_of_spool("drive.stages=[{to_mm: 25}]")
    check = verify(short, read_spool(spool))
    assert {f.verdict for f in check.sizing if f.what.startswith("B")} == {"not judged"}
    assert check.verdict == "not judged"


def test_a_bad_spool_is_told_by_line(tmp_path, spool, sound):
    file = tmp_path / "spool.yaml"
    file.write_text(spool.read_text().replace("depth_mm: 3,", "depth_mm: -3,", 1).replace("axis_deg", "axes_deg"))
    with pytest.raises(BadInput) as told:
        read_spool(file)
    said = "\n".join(told.value.lines)
    assert f"{file}:9:" in said
    assert "defects.0.depth_mm: got -3; must be greater than 0" in said
    assert "did you mean axis_deg" in said
    with pytest.raises(BadInput, match="neither a run"):
        verify(tmp_path, read_spool(spool))
    assert np.isfinite(verify(sound, read_spool(spool).model_copy(update={"axis_deg": None})).rig[0].measured)
