"""The check before and after a job: a reference spool with known defects, and whether rig and sizing still hold."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from algorithms.method import Method
from algorithms.reconstruct import ReconstructionFailed, reconstruct
from algorithms.sizing.disposition import at_least
from algorithms.types import INWARD_RING, Defect
from scenarios.document import BadInput
from scenarios.field.alignment import Laid, Places, lay_over
from scenarios.field.export_tally import TWO_SIDED_95, box_cells
from scenarios.field.match import SEEN_ENOUGH, SIZES, places_of
from scenarios.field.spool import CertifiedDefect, Spool
from scenarios.found_run import FoundRun, found_of, read_found
from sensor_model.recording import BadRecording, open_recording

UNDAMAGED_MM = 0.4  # cells that lie less deep show the bore
LOOKS = 4  # fewer points in a cell show no scatter

Verdict = Literal["inside", "outside", "not judged"]


class Figure(NamedTuple):
    """One figure of the check: what was measured, what is certified, how far apart they may be."""

    what: str
    measured: float | None
    certified: float | None
    allowed: float | None
    unit: str
    verdict: Verdict
    words: str = ""


class Check(NamedTuple):
    """A whole check."""

    spool: Spool
    run: FoundRun
    laid: Laid
    rig: tuple[Figure, ...]
    sizing: tuple[Figure, ...]

    @property
    def verdict(self) -> Verdict:
        """Outside when any figure is; not judged when a defect of the spool was not seen."""
        said = [figure.verdict for figure in (*self.rig, *self.sizing)]
        unjudged = any(figure.verdict == "not judged" for figure in self.sizing)
        return "outside" if "outside" in said else "not judged" if unjudged else "inside"


def verify(log_or_run: Path, spool: Spool) -> Check:
    """Hold a scan of the spool against its certificate.

    Raises:
        BadInput: when the scan cannot be read or reconstructed.
    """
    return check_of(_measured(log_or_run), spool)


def check_of(run: FoundRun, spool: Spool) -> Check:
    """Hold a measurement of the spool against its certificate.

    Raises:
        BadInput: when too little bare wall was seen.
    """
    laid = lay_over(_certified_places(spool), places_of(run.defects), spool.inner_radius_mm)
    return Check(spool, run, laid, tuple(_rig_figures(run, spool)), tuple(_sizing_figures(run, spool, laid)))


def _measured(place: Path) -> FoundRun:
    """A run's reconstruction, or one made now of a log by the default method."""
    if (place / "reconstruction").is_dir():
        return read_found(place)
    if not (place / "cam0").is_dir():
        raise BadInput([f"{place}: neither a run (reconstruction/) nor a log (cam0/) is there"])
    try:
        log = open_recording(place)
        found = reconstruct((log[k] for k in range(len(log))), log.rig, log.pipe, Method())
    except (BadRecording, ReconstructionFailed) as error:
        raise BadInput([f"{place}: {error}"]) from error
    return found_of(place, found)


def _certified_places(spool: Spool) -> Places:
    z, turn, size = zip(
        *((d.distance_mm, d.clock_deg, (d.length_mm * d.width_mm) ** 0.5) for d in spool.defects),
        strict=True,
    )
    return Places(np.array(z), np.radians(turn), np.array(size))


# ---- the rig


def _rig_figures(run: FoundRun, spool: Spool) -> list[Figure]:
    """Diameter, roundness, scatter and axis."""
    wall, drift = run.wall, spool.drift
    bare = (wall.count >= LOOKS) & (np.abs(run.deviation_mm) < UNDAMAGED_MM)
    if bare.sum() < 4 * wall.theta_rad.size:
        raise BadInput([f"{run.folder}: {bare.sum()} cells of undamaged wall were seen often; too few to judge a rig"])
    radius_mm, oval_mm = bore_of(run, bare)
    ratio = float(np.median(wall.spread_mm[bare]) / np.median(wall.sigma_mm[bare]))
    allowed = drift.diameter_mm + 2 * spool.inner_radius_u95_mm
    return [
        _within("diameter", 2 * radius_mm, 2 * spool.inner_radius_mm, allowed, "mm"),
        _within("out of round, second harmonic", oval_mm, 0.0, drift.roundness_mm + spool.inner_radius_u95_mm, "mm"),
        _within("residual, over what the points state", ratio, None, drift.residual_ratio, ""),
        _axis_figure(run, spool),
    ]


def bore_of(run: FoundRun, bare: np.ndarray) -> tuple[float, float]:
    """Mean radius of the undamaged cells, and the amplitude of their second harmonic around the wall, mm."""
    radius = np.where(bare, run.wall.radius_mm, np.nan)
    known = bare.any(axis=1)
    profile, theta = np.nanmedian(radius[known], axis=1), run.wall.theta_rad[known]
    orders = theta[:, None] * np.array([1, 2])
    terms = np.hstack([np.ones((theta.size, 1)), np.cos(orders), np.sin(orders)])
    fit = np.linalg.lstsq(terms, profile, rcond=None)[0]
    return float(fit[0]), float(np.hypot(fit[2], fit[4]))


def _axis_figure(run: FoundRun, spool: Spool) -> Figure:
    """Where the pipe's axis lies in the camera's own frame: a knocked rig tips it the same way in each frame."""
    axis = np.degrees(np.arcsin(run.T_pipe_camera[:, 2, :2])).mean(axis=0)
    shown = f"{axis[0]:.3f}, {axis[1]:.3f} degrees in the camera's x and y"
    if spool.axis_deg is None:
        return Figure("axis", None, None, None, "deg", "not judged", f"{shown}; the spool file has no axis_deg")
    off = float(np.hypot(*(axis - spool.axis_deg)))
    return _within("axis, off the accepted one", off, 0.0, spool.drift.axis_deg, "deg")._replace(words=shown)


def _within(what: str, measured: float, certified: float | None, allowed: float, unit: str) -> Figure:
    inside = abs(measured - (certified or 0.0)) <= allowed
    return Figure(what, measured, certified, allowed, unit, "inside" if inside else "outside")


# ---- sizes


def _sizing_figures(run: FoundRun, spool: Spool, laid: Laid) -> list[Figure]:
    """Every certified defect's sizes, and what was called that is in no certificate."""
    partner = dict(laid.pairs)
    figures: list[Figure] = []
    for index, defect in enumerate(spool.defects):
        if index in partner:
            found = run.defects[partner[index]]
            figures += [_size_figure(name, defect, found, spool) for name in SIZES]
        else:
            figures.append(_missing(run, defect, laid))
    for k, found in enumerate(run.defects):
        if k not in partner.values() and found.feature_class != INWARD_RING:  # a spool has joints
            where = f"at {found.distance_mm:.0f} mm, {np.degrees(found.theta_rad):.0f} degrees"
            words = f"{where}: called, and not in the certificate"
            figures.append(Figure("false call", found.depth_mm, None, None, "mm", "outside", words))
    return figures


def _size_figure(name: str, certified: CertifiedDefect, found: Defect, spool: Spool) -> Figure:
    """One size: inside when it is no further off than the drift that is let pass and what is open of both."""
    measured, true = getattr(found, f"{name}_mm"), getattr(certified, f"{name}_mm")
    std, u95 = getattr(found, f"{name}_std_mm"), getattr(certified, f"{name}_u95_mm")
    allowed = getattr(spool.drift, f"{name}_mm") + float(np.hypot(TWO_SIDED_95 * std, u95))
    what = f"{certified.name}: {name}"
    least_only = (name == "depth" and not found.floor_seen) or (name == "length" and found.cut_by_scan_end)
    if not least_only:
        return _within(what, measured, true, allowed, "mm")
    least = at_least(measured, std)
    verdict: Verdict = "outside" if least > true + u95 + getattr(spool.drift, f"{name}_mm") else "not judged"
    return Figure(what, measured, true, allowed, "mm", verdict, f"a least size only: at least {least:.2f} mm")


def _missing(run: FoundRun, defect: CertifiedDefect, laid: Laid) -> Figure:
    start = defect.distance_mm - defect.length_mm / 2 - laid.offset_mm
    theta = np.radians(defect.clock_deg) - laid.turn_rad
    depths = run.deviation_mm[box_cells(run, start, defect.length_mm, theta, defect.width_mm)]
    share = float(np.isfinite(depths).sum() / max(depths.size, 1))
    seen = share >= SEEN_ENOUGH
    words = f"not found, and {100 * share:.0f} % of its place was seen"
    return Figure(
        f"{defect.name}: depth", None, defect.depth_mm, None, "mm", "outside" if seen else "not judged", words
    )


def rows(check: Check) -> list[dict[str, Any]]:
    """A row a figure."""
    return [
        {"part": part, **figure._asdict()}
        for part, figures in (("rig", check.rig), ("sizing", check.sizing))
        for figure in figures
    ]
