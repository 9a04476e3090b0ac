"""`pipetwin calibrate pipe`: the projector from a pipe's own wall, out of a whole scan or of a few pictures."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from algorithms.calibration.clean_pipe import (
    Direction,
    PipeCalibration,
    calibrate_in_pipe,
    fit_pipe,
    seat_prior,
)
from algorithms.calibration.failure import CannotCalibrate
from algorithms.calibration.pipe_view import PipeView
from algorithms.calibration.poses_needed import Off, off_from
from algorithms.calibration.slide import SlideCalibration, learn_slide, pixels_of, with_jag
from algorithms.method import Method
from algorithms.reconstruct import see
from scenarios.calibration.camera import page_of
from scenarios.calibration.covariance_file import read_covariance, write_covariance
from scenarios.calibration.in_pipe import jag_figure, read_for, seen_in
from scenarios.calibration.in_scan import MOST_FRAMES
from scenarios.calibration.pictures import listed
from scenarios.calibration.rig_file import read_rig, write_rig
from scenarios.document import BadInput
from scenarios.report.calibration_page import Section, calibration_page
from scenarios.report.canvas import BLUE, VERMILION, Picture, drawing, to_picture
from scenarios.run import scenario_and_truth
from scenarios.run_folder import whole_file
from sensor_model.recording import open_recording
from sensor_model.rig import Rig

NORMAL_95 = 1.96
MOST_DIRECTIONS, MOST_NAMED = 4, 6
NAMED = 0.25  # of a direction: what moves by less than this share of its own is not named


class Known(NamedTuple):
    """A rig to start from, what is known of its projector, and who says so."""

    rig: Rig
    covariance: np.ndarray
    by: str


def calibrate_pipe(
    paths: list[Path], rig_name: str, out: Path, radius_mm: float | None, true_rig: str | None
) -> dict[str, Any]:
    """Calibrate from a run or recording, or from pictures; write rig and page, and give the figures.

    Raises:
        BadInput: where they do not do.
    """
    known = _known(rig_name)
    if len(paths) == 1 and ((paths[0] / "scenario.yaml").exists() or (paths[0] / "cam0").is_dir()):
        return _from_scan(paths[0], known, out, radius_mm, read_rig(true_rig) if true_rig else None)
    if radius_mm is not None or true_rig is not None:
        raise BadInput([f"{paths[0]}: --radius-mm and --true-rig go with a run or a recording"])
    return _from_pictures(paths, known.rig, out)


def _known(rig_name: str) -> Known:
    rig = read_rig(rig_name)
    covariance = read_covariance(rig.projector, Path(rig_name))
    if covariance is not None:
        return Known(rig, covariance, "the boards")
    return Known(rig, seat_prior(len(rig.projector.slits)), "a projector mounted anew: no covariance beside the rig")


def _from_scan(scan: Path, known: Known, out: Path, radius_mm: float | None, true: Rig | None) -> dict[str, Any]:
    is_run = (scan / "scenario.yaml").exists()
    method = scenario_and_truth(scan)[0].method if is_run else Method()
    recording = open_recording(scan / "recording" if is_run else scan)
    chosen = np.unique(np.linspace(0, len(recording) - 1, MOST_FRAMES).round().astype(int)).tolist()
    try:
        frames = [see(recording[i], known.rig, method) for i in chosen]
        found = calibrate_in_pipe(frames, known.rig, known.covariance, radius_mm)
    except CannotCalibrate as error:
        raise BadInput([f"{scan}: {error}"]) from error
    rig, covariance = (found.rig, found.covariance) if found.helps else (known.rig, known.covariance)
    write_rig(rig, out)
    write_covariance(rig.projector, covariance, out)
    figures = _scan_figures(found, known, radius_mm, true)
    with whole_file(page_of(out, "pipe")) as work:
        work.write_text(_scan_page(figures, found, known), encoding="utf-8")
    return figures


def names_of(rig: Rig) -> list[str]:
    """The unknowns of a projector, with units."""
    return ["apex_x_mm", "apex_y_mm", "apex_z_mm", "tilt_x_deg", "tilt_y_deg",
            *(f"{slit.name}_deg" for slit in rig.projector.slits)]  # fmt: skip


def _in_units(values: np.ndarray) -> np.ndarray:
    """Apex in mm, angles in degrees."""
    return np.concatenate([values[:3], np.degrees(values[3:])])


def _scan_figures(found: PipeCalibration, known: Known, radius_mm: float | None, true: Rig | None) -> dict[str, Any]:
    names = names_of(known.rig)
    interval = {
        name: NORMAL_95 * _in_units(np.sqrt(np.diag(one)))
        for name, one in (("before", known.covariance), ("after", found.covariance))
    }
    projector = found.rig.projector
    figures: dict[str, Any] = {
        "frames": found.frames,
        "radius_mm": found.radius_mm,
        "radius": "free" if radius_mm is None else "known",
        "known_by": known.by,
        "pattern_mm": found.plain_mm,
        "pattern_adjusted_mm": found.adjusted_mm,
        "kept": found.helps,
        "apex_mm": list(projector.apex_mm),
        "axis": list(projector.axis),
        "half_angle_deg": {slit.name: slit.half_angle_deg for slit in projector.slits},
        "interval_95_before": dict(zip(names, interval["before"].tolist(), strict=True)),
        "interval_95": dict(zip(names, interval["after"].tolist(), strict=True)),
        "not_observed": [
            {"left_share": one.left, "moves": _said(one, names, known.covariance)}
            for one in found.stayed[:MOST_DIRECTIONS]
        ],
    }
    if true is not None:
        for name, rig in (("off_true_rig_before", known.rig), ("off_true_rig", found.rig)):
            figures[name] = off_from(rig, true)._asdict()
    return figures


def _said(direction: Direction, names: list[str], before: np.ndarray) -> str:
    """What moves together in a direction, one standard deviation of it, the most uncertain first."""
    share = direction.by / np.sqrt(np.diag(before))
    by = _in_units(direction.by) * np.sign(share[np.argmax(np.abs(share))])
    largest = [k for k in np.argsort(-np.abs(share))[:MOST_NAMED] if abs(share[k]) > NAMED * np.abs(share).max()]
    return ", ".join(f"{names[k]} {by[k]:+.2g}" for k in largest)


def _scan_page(figures: dict[str, Any], found: PipeCalibration, known: Known) -> str:
    radius = "of known radius" if figures["radius"] == "known" else "of free radius"
    verdict = f"From one half of the scan, the cones take the pattern on the other from {found.plain_mm:.4f} to "
    verdict += f"{found.adjusted_mm:.4f} mm; "
    verdict += "they are kept." if found.helps else "they are not kept, and the rig is as it was."
    words = [
        f"{found.frames} frames on one bore {radius}, {found.radius_mm:.3f} mm. Before the scan the projector is known "
        f"by {known.by}."
    ]
    if figures["radius"] == "free":
        words.append("With a free radius no pipe tells the scale: apex and radius grow together, by as much as before.")
    rows = [("unknown", "± before (95 %)", "± after"), *(
        (name, f"{before:.4f}", f"{figures['interval_95'][name]:.4f}")
        for name, before in figures["interval_95_before"].items()
    )]  # fmt: skip
    errors: list[tuple[str, ...]] = []
    if "off_true_rig" in figures:
        errors = [("against the true rig", "before", "after")]
        both = figures["off_true_rig_before"], figures["off_true_rig"]
        errors += [(name, *(f"{one[name]:.4f}" for one in both)) for name in Off._fields]
    stayed = [("what moves together (one standard deviation)", "share of its uncertainty that is left")]
    stayed += [(one["moves"], f"{100 * one['left_share']:.0f} %") for one in figures["not_observed"]]
    seen_all = [] if len(stayed) > 1 else ["The scan saw every direction better than it was known before."]
    sections = [
        Section("Frames", words, errors),
        Section("What is known of the projector", [], rows, [_interval_figure(figures)]),
        Section("What clean pipe does not show", seen_all, stayed if not seen_all else ()),
    ]
    return calibration_page("Calibration in clean pipe", "", verdict, found.helps, sections)


def _interval_figure(figures: dict[str, Any]) -> Picture:
    names = list(figures["interval_95"])
    with drawing(3.6) as figure:
        axes = figure.subplots()
        for key, color, aside, label in (("interval_95_before", BLUE, -0.2, "before the scan"),
                                         ("interval_95", VERMILION, 0.2, "after")):  # fmt: skip
            axes.bar(np.arange(len(names)) + aside, list(figures[key].values()), 0.38, color=color, label=label)
        axes.set_yscale("log")
        axes.set_xticks(np.arange(len(names)), [name.rsplit("_", 1)[0] for name in names], rotation=45)
        axes.set_ylabel("± 95 % (mm, degrees)")
        axes.set_title("What the scan adds to what was known")
        axes.legend()
        return to_picture(
            figure, "Bars of the 95 % interval of each unknown, before and after.", "Apex in mm, angles in degrees."
        )


def _from_pictures(images: list[Path], rig: Rig, out: Path) -> dict[str, Any]:
    """Learn the projector's seat and the slide's jaggedness from pictures of one clean pipe; write rig and page.

    Raises:
        BadInput: where the pictures do not do.
    """
    files = listed(images)
    pictures = [read_for(file, rig) for file in files]
    plain = with_jag(rig, np.zeros((len(rig.projector.slits), 0)))
    before = [seen_in(file, picture, plain) for file, picture in zip(files, pictures, strict=True)]
    try:
        seated, _ = fit_pipe([pixels_of(view) for view in before], plain, seat_prior(len(rig.projector.slits)), None)
        after = [seen_in(file, picture, seated) for file, picture in zip(files, pictures, strict=True)]
        slide = learn_slide(after, seated)
    except CannotCalibrate as error:
        raise BadInput([f"{files[0]}: {error}"]) from error
    write_rig(with_jag(seated, slide.table_rad) if slide.helps else seated, out)
    figures = _pipe_figures(files, before, after, slide, seated)
    with whole_file(out.with_name(f"{out.stem}-pipe.html")) as work:
        work.write_text(_pipe_page(figures, slide, seated), encoding="utf-8")
    return figures


def _pipe_figures(
    files: list[Path], before: list[PipeView], after: list[PipeView], slide: SlideCalibration, rig: Rig
) -> dict[str, Any]:
    return {
        "axis": list(rig.projector.axis),
        "apex_mm": list(rig.projector.apex_mm),
        "half_angle_deg": {slit.name: slit.half_angle_deg for slit in rig.projector.slits},
        "correction_kept": slide.helps,
        "pictures": {
            str(file): {
                "diameter_before_mm": 2 * one.alignment.radius_mm,
                "diameter_mm": 2 * two.alignment.radius_mm,
                "residual_mm": float(plain),
                "residual_corrected_mm": float(corrected),
            }
            for file, one, two, plain, corrected in zip(
                files, before, after, slide.plain_mm, slide.corrected_mm, strict=True
            )
        },
    }


def _pipe_page(figures: dict[str, Any], slide: SlideCalibration, rig: Rig) -> str:
    rows = [("picture", "diameter before (mm)", "diameter (mm)", "residual (mm)", "corrected by the others (mm)")]
    for name, row in figures["pictures"].items():
        rows.append((name, *(f"{value:.2f}" for value in row.values())))
    gain = 100 * (1 - float(np.mean(slide.corrected_mm) / np.mean(slide.plain_mm)))
    verdict = f"The correction learned from the other pictures takes {gain:.0f} % off the residual of the one left out"
    verdict += "; it is kept." if slide.helps else "; it is not kept."
    sections = [
        Section("Pictures", ["Each is judged by what the others taught; the seat is of all."], rows),
        Section("The slide's jaggedness", [], (), [jag_figure(slide.table_rad, rig)]),
    ]
    return calibration_page("Calibration in the pipe", "", verdict, slide.helps, sections)
