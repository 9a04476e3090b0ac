"""`pipetwin report`: performance over run folders, every number a link to its rows."""

from __future__ import annotations

import csv
import json
import re
import shutil
import subprocess
import sys

import pytest

from scenarios.artefacts import write_reconstruction
from scenarios.document import BadInput
from scenarios.load import load_scenario
from scenarios.paper.sized_scan import sized_scan
from scenarios.settings_yaml import settings_yaml
from scenarios.trust import performance, runs
from scenarios.trust.performance_page import page, run_report, statements
from twin.truth import save_truth

POCKET = "kind: pocket, length_mm: 40, width_mm: 30"
FEATURES = {
    # the second lies where the strut hides the wall, the third beyond what is scanned
    "first": f"[{{{POCKET}, distance_mm: 150, clock_deg: 120, depth_mm: 5}}, "
    f"{{kind: pit, distance_mm: 190, clock_deg: 0, diameter_mm: 12, depth_mm: 3}}, "
    f"{{{POCKET}, distance_mm: 420, clock_deg: 240, depth_mm: 5}}]",
    "second": f"[{{{POCKET}, distance_mm: 175, clock_deg: 230, depth_mm: 2}}]",
}


@pytest.fixture(scope="module")
def folders(tmp_path_factory):
    """Two run folders, as far as a report needs them."""
    root, made = tmp_path_factory.mktemp("runs"), []
    drive = [
        "sensing.frame_rate_hz=10",
        "drive.offset_mm=[0, 0]",
        "drive.tilt_deg=[0, 0]",
        "drive.stages=[{to_mm: 120}]",
    ]
    for seed, (name, features) in enumerate(FEATURES.items()):
        changes = ["sensing.fidelity=points", f"pipe.features={features}", *drive]
        scenario = load_scenario("paper-gantry", changes, seed)
        scan = sized_scan(scenario, 1, lambda *_: None)
        folder = root / name
        save_truth(scan.scan.truth, folder / "truth")
        write_reconstruction(scan.found, folder / "reconstruction")
        (folder / "scenario.yaml").write_text(settings_yaml(scenario))
        made.append(folder)
    return made


@pytest.fixture(scope="module")
def found(folders):
    return performance.performance_of(folders)


def test_misses_count_and_what_was_not_scanned_does_not(found):
    assert [(t.run, t.number, t.found is not None) for t in found.targets] == [
        ("first", 1, True),
        ("first", 2, False),
        ("second", 1, True),
    ]
    hidden = found.targets[1]
    assert not hidden.inspected
    assert (found.identification.detected.counted, found.identification.detected.n) == (2, 3)
    assert (found.on_seen_wall.counted, found.on_seen_wall.n) == (2, 2)
    assert found.false_calls.calls == 0
    assert found.false_calls.length_m == pytest.approx(sum(scan.length_m for scan in found.scans))


def test_depths_are_judged_by_each_pipe_s_own_wall(found):
    assert found.unity.n == found.unity.inside.counted == 2
    assert found.unity.worst_pct < 2
    assert found.unity.certainties[0].verdict == "not shown"  # of two
    assert set(found.coverage) == {"length_mm", "width_mm", "depth_mm"}


def test_a_wrong_truth_finds_no_more_than_chance(found):
    assert found.shuffled.exchanged.n == 3
    assert found.shuffled.exchanged.counted == 0
    assert found.shuffled.moved.n == 5 * 4  # all of a pipe's features, brought into what was scanned
    assert not found.shuffled.leak


def test_a_measurement_that_knows_the_truth_is_told(folders, monkeypatch):
    scans = [runs.read_scan(folder) for folder in folders]
    monkeypatch.setattr(performance, "_moved", lambda _, scan, __: scan.pipe)
    assert performance.shuffled(scans).leak


def test_every_number_leads_to_rows_that_are_there(found, tmp_path):
    html = page(found, None, tmp_path)
    anchors = set(re.findall(r'href="#([\w-]+)"', html))
    assert anchors >= {"targets", "sized", "calls", "intervals", "scans"}
    assert anchors <= set(re.findall(r'<section id="([\w-]+)"', html))
    sentences = re.findall(r"<p>(.*?)</p>", html)
    assert len(sentences) >= sum(len(lines) for lines in statements(found, None).values())
    for sentence in sentences:
        assert not re.search(r"(?<![\w/.-])\d", re.sub(r"<a .*?</a>", "", sentence)), sentence


def test_the_rows_are_looks_for_pod(folders, tmp_path):
    _, pod = run_report(folders, tmp_path / "report")
    assert pod.figures["looks"] == 3
    rows = list(csv.DictReader((tmp_path / "report" / "rows.csv").read_text().splitlines()))
    assert [row["found"] for row in rows] == ["1", "0", "1"]
    run_report(folders[:1], tmp_path / "report")  # a second replaces the first; one size has no spread
    said = json.loads((tmp_path / "report" / "performance.json").read_text())
    assert said["unity"]["standard_deviation_pct"] is None
    assert said["unity"]["inside"]["n"] == 1


def test_what_is_no_run_is_said(folders, tmp_path):
    with pytest.raises(BadInput, match="given twice"):
        performance.performance_of([folders[0], folders[0]])
    ran = subprocess.run(
        [sys.executable, "-m", "scenarios.cli", "report", str(tmp_path), "-o", str(tmp_path / "o")],
        capture_output=True,
        text=True,
    )
    assert ran.returncode == 2
    assert "scenario.yaml is missing" in ran.stderr


def test_a_damaged_defect_list_is_said_by_its_line(folders, tmp_path):
    folder = tmp_path / "damaged"
    shutil.copytree(folders[0], folder)
    file = folder / "reconstruction" / "defects.csv"
    head, first = file.read_text().splitlines()[:2]
    file.write_text("\n".join([head, first.replace(first.split(",")[5], "long")]) + "\n")
    with pytest.raises(BadInput, match=r"defects\.csv:2: length_mm: got 'long'"):
        runs.read_scan(folder)
    file.write_text(head + "\n")
    assert runs.read_scan(folder).defects == ()
    file.write_text("\n".join([head, first]) + "\n")
    assert runs.read_scan(folder).defects[0].seen_cells > 0
