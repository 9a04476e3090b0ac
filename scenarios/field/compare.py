"""`pipetwin compare`: a log and its twin's replay, figure by figure, inside or outside the log's own spread."""

from __future__ import annotations

import json
from math import isfinite
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from algorithms.identification.estimate import NORMAL_95, t_factor
from algorithms.identification.scan import Walk, walk
from algorithms.types import Defect
from scenarios.document import BadInput
from scenarios.extrapolated import extrapolated
from scenarios.field.compare_page import compare_page
from scenarios.field.identify import seen_frames
from scenarios.field.line import Line
from scenarios.field.log_figures import WayFigure, log_figures, way_figures
from scenarios.load import load_scenario
from scenarios.progress import Progress
from scenarios.run_folder import whole_file
from scenarios.scenario import Scenario
from sensor_model.recording import BadRecording, Recording, open_recording

LEAST_SHARE = 0.005  # two logs are alike to half a per cent, however steady the log is
# another device has biases of its own, and another print of a slide is rough otherwise, which stretches do not show
OF_THE_PRINT = ("pixel_noise_px", "edge_jitter_deg", "residual_mm", "look_jitter_px")
LEAST_SHARES = {
    "diameter_mm": 2e-4,
    **dict.fromkeys(OF_THE_PRINT, 0.04),
    "drop_out_share": 0.1,
    "force_mean_m_s2": 0.008,
}
SAME_PLACE_MM = 25.0
LEAST_BLOCKS = 3
SIZE_SIGMAS = 2.39  # for all three sizes of a defect to lie inside 95 times in 100
WAY_SIGMAS = NORMAL_95 * float(np.sqrt(2.0))


def compare(log: Path, replay: Path, out: Path, progress: Progress) -> dict[str, Any]:
    """Compare two runs or recordings; write `compare.html` and `compare.json`, and give the figures.

    Raises:
        BadInput: for a folder that is neither, and for logs that have no figure in common.
    """
    of_log, of_replay = (_measured(folder, progress) for folder in (log, replay))
    lines = compared(*of_log, *of_replay)
    if not lines:
        raise BadInput([f"{log}, {replay}: have no figure in common"])
    scenario = _scenario(replay)
    figures = _figures(lines, scenario)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise BadInput([f"{out}: cannot be made: {error.strerror}; choose another folder with -o"]) from error
    with whole_file(out / "compare.json") as work:
        work.write_text(json.dumps(figures, indent=1, allow_nan=False) + "\n")
    with whole_file(out / "compare.html") as work:
        work.write_text(compare_page(log.name, replay.name, lines, scenario), encoding="utf-8")
    return figures


def _measured(folder: Path, progress: Progress) -> tuple[Recording, Walk]:
    """A recording, or a run's, walked through.

    Raises:
        BadInput: for something else.
    """
    for place in (folder, folder / "recording"):
        if (place / "cam0" / "data.csv").exists():
            try:
                recording = open_recording(place)
            except BadRecording as error:
                raise BadInput([str(error)]) from error
            return recording, walk(recording, seen_frames(recording, progress))
    raise BadInput([f"{folder}: neither a run nor a recording; `pipetwin run` makes such a folder"])


def compared(log: Recording, log_walk: Walk, replay: Recording, replay_walk: Walk) -> list[Line]:
    """Every figure that both have."""
    ours, theirs = log_figures(log, log_walk), log_figures(replay, replay_walk)
    lines = [line for name in ours if name in theirs and (line := _line(name, ours[name], theirs[name]))]
    ways = way_figures(log, log_walk), way_figures(replay, replay_walk)
    lines += [line for name in ways[0] if name in ways[1] and (line := _way_line(name, ways[0][name], ways[1][name]))]
    if log_walk.found is None or replay_walk.found is None:
        return lines
    return lines + _defect_lines(log_walk.found.defects, replay_walk.found.defects)


def _line(name: str, log: Float[np.ndarray, "a"], replay: Float[np.ndarray, "b"]) -> Line | None:
    """The spread is a prediction interval: where one more stretch of the log would lie."""
    log, replay = log[np.isfinite(log)], replay[np.isfinite(replay)]
    if log.size < LEAST_BLOCKS or not replay.size:
        return None
    mean = float(log.mean())
    spread = t_factor(log.size - 1) * float(log.std(ddof=1)) * float(np.sqrt(1 + 1 / log.size))
    return Line(
        name, mean, float(replay.mean()), max(spread, LEAST_SHARES.get(name, LEAST_SHARE) * abs(mean)), int(log.size)
    )


def _way_line(name: str, log: WayFigure, replay: WayFigure) -> Line | None:
    """The stretch in which both differ most, against how single values of the log lie off by themselves."""
    if log.blocks.size != replay.blocks.size or not np.isfinite([*log.blocks, *replay.blocks, log.std]).all():
        return None
    off = replay.blocks - log.blocks
    worst, mean = float(off[np.argmax(np.abs(off))]), float(log.blocks.mean())
    least = LEAST_SHARE * float(np.abs(log.blocks).max())
    return Line(name, mean, mean + worst, max(WAY_SIGMAS * log.std, least), int(log.blocks.size))


def _defect_lines(log: tuple[Defect, ...], replay: tuple[Defect, ...]) -> list[Line]:
    """Their number, and the sizes of those at the same place within what both state; not those that the scan cuts."""
    log, replay = (tuple(one for one in defects if not one.cut_by_scan_end) for defects in (log, replay))
    lines = [Line("defects", float(len(log)), float(len(replay)), 0.0, 1)]
    for k, one in enumerate(log):
        near = [other for other in replay if abs(other.distance_mm - one.distance_mm) < SAME_PLACE_MM]
        if not near:
            continue
        other = min(near, key=lambda candidate: abs(np.angle(np.exp(1j * (candidate.theta_rad - one.theta_rad)))))
        for size in ("length_mm", "width_mm", "depth_mm"):
            std = float(np.hypot(*(getattr(d, size.replace("_mm", "_std_mm")) for d in (one, other))))
            values = float(getattr(one, size)), float(getattr(other, size))
            lines.append(Line(f"defect{k}_{size}", *values, max(SIZE_SIGMAS * std, LEAST_SHARE * values[0]), 1))
    return lines


def _scenario(replay: Path) -> Scenario | None:
    """The replay's scenario, where it is a run."""
    file = replay / "scenario.yaml"
    return load_scenario(str(file), [], None) if file.is_file() else None


def _figures(lines: list[Line], scenario: Scenario | None) -> dict[str, Any]:
    rows = {
        line.name: {
            "log": line.log,
            "replay": line.replay,
            "difference": line.difference,
            "spread": line.spread if isfinite(line.spread) else None,
            "blocks": line.blocks,
            "verdict": "inside" if line.inside else "outside",
        }
        for line in lines
    }
    outside = [line.name for line in lines if not line.inside]
    return {
        "figures": rows,
        "inside": len(lines) - len(outside),
        "outside": outside,
        "passes": not outside,
        "extrapolated": extrapolated(scenario) if scenario else None,
    }
