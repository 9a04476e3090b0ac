"""One scenario through the whole chain: simulate, sense, reconstruct, score, report; all of it in one folder."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np

from algorithms.localisation.gaps import log_gaps
from algorithms.method import Method
from algorithms.reconstruct import ReconstructionFailed, State, begin, finish, see, step
from algorithms.types import Reconstruction
from scenarios.artefacts import write_reconstruction
from scenarios.document import BadInput
from scenarios.extrapolated import extrapolated
from scenarios.found_truth import read_truth
from scenarios.load import load_scenario
from scenarios.provenance import versions
from scenarios.run_folder import run_folder
from scenarios.scenario import Scenario, nominal_pipe, nominal_rig
from scenarios.score import FrameTally, Score, score, tally_frame
from scenarios.settings_yaml import settings_yaml
from sensor_model.recording import Recording, SlitPixels, open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from sensor_model.workers import spread
from twin.simulate import DriveFailed, simulate
from twin.truth import Truth, save_truth

Report = Callable[[str, int, int], None]
SAMPLES = 3


class RunFailed(RuntimeError):
    """A stage of the run failed; the message says which and why."""


@dataclass(frozen=True)
class Sample:
    """One frame kept for the report: where it was taken, and what was seen in it."""

    index: int
    z_mm: float
    seen: SlitPixels


@dataclass(frozen=True)
class Scan:
    """What a report shows of any scan, a robot's too."""

    recording: Recording
    found: Reconstruction
    samples: tuple[Sample, ...]


@dataclass(frozen=True)
class Run(Scan):
    """Everything that the report of a simulated scan shows."""

    scenario: Scenario
    truth: Truth
    score: Score


def run(scenario: Scenario, out: Path, workers: int, progress: Report) -> dict[str, float | int | None]:
    """Run a scenario into a folder, which appears when it is whole; returns the score.

    Raises:
        BadInput: when the folder cannot be written.
        RunFailed: when a stage fails.
    """
    seconds: dict[str, float] = {}
    peaks_kb: dict[int, int] = {}
    with run_folder(out) as folder:
        (folder / "scenario.yaml").write_text(settings_yaml(scenario))
        with stage("drive", seconds):
            progress("drive", 0, 1)
            truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
            save_truth(truth, folder / "truth")
            progress("drive", 1, 1)
        with stage("sense", seconds):
            sensed(scenario, truth, folder / "recording", workers, peaks_kb, progress)
            recording = open_recording(folder / "recording")
        with stage("reconstruct", seconds):
            found, tally, samples = _reconstructed(scenario, truth, recording, workers, peaks_kb, progress)
            write_reconstruction(found, folder / "reconstruction")
        with stage("score", seconds):
            result = score(found, truth, tally)
            (folder / "score.json").write_text(json.dumps(asdict(result), indent=1, allow_nan=False) + "\n")
        with stage("report", seconds):
            from scenarios.report.page import write_report

            write_report(Run(recording, found, samples, scenario, truth, result), folder / "report.html")
        (folder / "run.json").write_text(json.dumps(provenance(scenario, seconds, peaks_kb), indent=1) + "\n")
    return asdict(result)


@contextmanager
def stage(name: str, seconds: dict[str, float]) -> Iterator[None]:
    """Time a stage, and give its failures its name."""
    start = time.perf_counter()
    try:
        yield
    except (DriveFailed, ReconstructionFailed, ValueError, OSError) as error:
        raise RunFailed(f"{name}: {error}") from error
    seconds[name] = round(time.perf_counter() - start, 3)


def sensed(
    scenario: Scenario, truth: Truth, folder: Path, workers: int, peaks_kb: dict[int, int], progress: Report
) -> None:
    """Have the sensor log the drive into a folder."""
    true_rig = scenario.true_rig or scenario.rig
    total = truth.sample_times_s(scenario.sensing.frame_rate_hz).size
    frames = sense(
        truth,
        true_rig,
        nominal_rig(scenario),
        nominal_pipe(scenario),
        scenario.sensing,
        scenario.seed,
        folder,
        workers,
        peaks_kb,
    )
    for done in frames:
        progress(f"sense ({scenario.sensing.fidelity})", done, total)


def _reconstructed(
    scenario: Scenario,
    truth: Truth,
    recording: Recording,
    workers: int,
    peaks_kb: dict[int, int],
    progress: Report,
) -> tuple[Reconstruction, FrameTally, tuple[Sample, ...]]:
    """The fold over the recording, with pictures decoded ahead by the workers and each frame's figures taken."""
    T_true = true_poses(truth, recording)
    kept, samples = set(_sample_indices(truth, T_true)), []
    ahead = 1 if scenario.sensing.fidelity == "points" else workers
    jobs = ((str(recording.folder), index, scenario.method) for index in range(len(recording)))

    def watched() -> Iterator[SlitPixels]:
        for index, seen in enumerate(spread(_seen, jobs, ahead, peaks_kb)):
            yield seen
            if index in kept:
                samples.append(Sample(index, float(T_true[index, 2, 3]), seen))
            progress("reconstruct", index + 1, len(recording))

    state, tally = fold(scenario, truth, recording, watched())
    return with_gaps(finish(state), recording), tally, tuple(samples)


def with_gaps(found: Reconstruction, recording: Recording) -> Reconstruction:
    """A reconstruction with the gaps that the whole log has, in place of those that its estimator came to know."""
    noted = tuple(episode for episode in found.episodes if episode.kind != "gap")
    return replace(found, episodes=noted + log_gaps(recording))


def scenario_and_truth(folder: Path) -> tuple[Scenario, Truth]:
    """What a run's folder holds of how it came about.

    Raises:
        BadInput: when it is not a whole run.
    """
    for part in ("scenario.yaml", "truth/truth.npz", "truth/pipe.json"):
        if not (folder / part).is_file():
            raise BadInput([f"{folder}: {part} is missing; `pipetwin run` makes such a folder"])
    scenario = load_scenario(str(folder / "scenario.yaml"), [], None)
    return scenario, read_truth(folder / "truth")


def true_poses(truth: Truth, recording: Recording) -> np.ndarray:
    """`T_pipe_camera` of every frame, as it really was."""
    return truth.pose_at(recording.frame_stamps_ns / 1e9)


def fold(
    scenario: Scenario, truth: Truth, recording: Recording, seen: Iterable[SlitPixels]
) -> tuple[State, FrameTally]:
    """Measure frame by frame from the slit pixels of each, and take each frame's figures."""
    T_true = true_poses(truth, recording)
    tally = FrameTally(truth.pipe, scenario.true_rig or scenario.rig, optics=scenario.sensing.optics)
    state = begin(recording.rig, recording.pipe, scenario.method)
    for index, pixels in enumerate(seen):
        tally_frame(tally, step(state, recording.frame(index), pixels), T_true[index])
    return state, tally


def _seen(folder: str, index: int, method: Method) -> SlitPixels:
    recording = opened(folder)
    return see(recording[index], recording.rig, method)


@cache
def opened(folder: str) -> Recording:
    """A recording, read once by each process."""
    return open_recording(Path(folder))


def _sample_indices(truth: Truth, T_true: np.ndarray) -> list[int]:
    """Frames worth a look: the first, and those whose middle ring lies on each defect's middle."""
    look_ahead = 1.5 * truth.pipe.bore_radius_mm
    places = [feature.distance_mm - look_ahead for feature in truth.pipe.features]
    nearest = [int(np.argmin(np.abs(T_true[:, 2, 3] - z))) for z in places]
    return sorted({0, *nearest})[:SAMPLES]


def provenance(scenario: Scenario, seconds: dict[str, float], peaks_kb: dict[int, int]) -> dict:
    """What made this result: versions, seed, git state, seconds per stage, peak memory."""
    session = scenario.calibration
    return {
        **versions(),
        "seed": scenario.seed,
        "extrapolated": extrapolated(scenario),
        "nominal_rig": f"calibrated on {session.boards} boards" if session else "as stated",
        **effort(seconds, peaks_kb),
    }


def effort(seconds: dict[str, float], peaks_kb: dict[int, int]) -> dict:
    """Seconds per stage and peak memory."""
    import resource

    peaks_mb = [resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, *(kb / 1024 for kb in peaks_kb.values())]
    return {
        "seconds": seconds,
        "seconds_total": round(sum(seconds.values()), 3),
        "peak_memory_mb": {"this_process": round(peaks_mb[0]), "all_processes": round(sum(peaks_mb))},
    }
