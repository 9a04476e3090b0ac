"""`pipetwin calibrate slide`: the slide's jaggedness out of a whole scan, and what the correction does to the scan."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.slide import with_jag
from algorithms.calibration.slide_in_scan import ScanSlide, learn_slide_from_scan
from algorithms.method import Method
from algorithms.reconstruct import finish, see
from scenarios.calibration.camera import page_of
from scenarios.calibration.in_pipe import jag_figure
from scenarios.calibration.rig_file import write_rig
from scenarios.document import BadInput
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.run import fold, scenario_and_truth
from scenarios.run_folder import whole_file
from scenarios.scenario import Scenario
from scenarios.score import score
from sensor_model.recording import Recording, open_recording
from sensor_model.rig import Rig
from twin.truth import Truth

MOST_FRAMES = 60  # spread over the scan, so that memory stays flat in its length
JUDGED = (
    "length_error_mm_max",
    "width_error_mm_max",
    "depth_error_mm_max",
    "depth_bias_mm",
    "map_rms_mm",
    "defects_found",
    "false_calls",
)


def calibrate_slide(scan: Path, out: Path) -> dict[str, Any]:
    """Learn the slide's jaggedness from a run or a recording; write rig and page, and give the figures.

    The rig is the recording's own, with the correction if it helps on frames that had no part in it. Of a twin's run
    the scan is also measured again, with the recording's rig and with the one written, and both are scored.

    Raises:
        BadInput: for a folder that is neither, and for frames that do not do.
    """
    is_run = (scan / "scenario.yaml").exists()
    scenario, truth = scenario_and_truth(scan) if is_run else (None, None)
    recording = open_recording(scan / "recording" if is_run else scan)
    method = scenario.method if scenario else Method()
    chosen = np.unique(np.linspace(0, len(recording) - 1, MOST_FRAMES).round().astype(int)).tolist()
    try:
        found = learn_slide_from_scan([see(recording[i], recording.rig, method) for i in chosen], recording.rig)
    except CannotCalibrate as error:
        raise BadInput([f"{scan}: {error}"]) from error
    rig = with_jag(recording.rig, found.table_rad) if found.helps else recording.rig
    write_rig(rig, out)
    figures = _figures(found)
    if scenario and truth:
        figures["scan"] = _scored(scenario, truth, recording, recording.rig)
        figures["scan_corrected"] = _scored(scenario, truth, recording, rig) if found.helps else figures["scan"]
    with whole_file(page_of(out, "slide")) as work:
        work.write_text(_page(figures, found, recording.rig), encoding="utf-8")
    return figures


def _figures(found: ScanSlide) -> dict[str, Any]:
    alike = np.flatnonzero(found.alike_mm)
    most = float(np.abs(found.alike_mm).max())
    said = f"over {alike.size} of {found.alike_mm.size} cells all slits see the wall stand off alike, by up to "
    said += f"{most:.2f} mm, as on a groove along the pipe: no part of the correction"
    return {
        "frames": found.frames,
        "residual_mm": found.plain_mm,
        "residual_corrected_mm": found.corrected_mm,
        "correction_kept": found.helps,
        "unused_share": found.unused_share,
        "weak": said if alike.size else "",
    }


def _scored(scenario: Scenario, truth: Truth, recording: Recording, rig: Rig) -> dict[str, float | int | None]:
    """Measure the scan with a rig, and score it."""
    seen = (see(recording[index], rig, scenario.method) for index in range(len(recording)))
    state, tally = fold(scenario, truth, replace(recording, rig=rig), seen)
    row = score(finish(state), truth, tally)
    return {name: getattr(row, name) for name in JUDGED}


def _page(figures: dict[str, Any], found: ScanSlide, rig: Rig) -> str:
    verdict = "Learned from one half of the scan, the correction takes the residual of the other from "
    verdict += f"{found.plain_mm:.3f} to {found.corrected_mm:.3f} mm; "
    verdict += "it is kept." if found.helps else "it is not kept, and the rig is as it was."
    rows: list[tuple[str, ...]] = []
    if "scan" in figures:
        rows = [("the twin's scan against its truth", "before", "after")]
        both = (figures["scan"], figures["scan_corrected"])
        rows += [(name, *("-" if one[name] is None else f"{one[name]:.4g}" for one in both)) for name in JUDGED]
    sentences = [
        f"{found.frames} frames along the scan; {100 * found.unused_share:.1f} % of their points were left out."
    ]
    sentences += [figures["weak"]] if figures["weak"] else []
    sections = [
        Section("Frames", sentences, rows),
        Section("The slide's jaggedness", [], (), [jag_figure(found.table_rad, rig)]),
    ]
    return calibration_page("The slide, learned in the pipe", "", verdict, found.helps, sections)
