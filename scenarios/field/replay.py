"""A robot's log through the very code that the twin's logs go through: read, measured, examined, reported."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

from algorithms.method import Method
from algorithms.reconstruct import ReconstructionFailed, State, begin, finish, step
from algorithms.types import Reconstruction
from scenarios.artefacts import write_reconstruction
from scenarios.field.health import Health, examine, write_health
from scenarios.field.look import Watched, begin_watch, look_at, watch
from scenarios.field.read import read_log
from scenarios.field.told import Told
from scenarios.load import load_scenario
from scenarios.provenance import versions
from scenarios.run import Report, Sample, effort, stage, with_gaps
from scenarios.run_folder import run_folder
from sensor_model.recording import Recording
from sensor_model.rig import save_settings
from sensor_model.workers import spread

SAMPLES = 3


@dataclass(frozen=True)
class Replay:
    """What a replay gave; `found` is None where nothing could be reconstructed, and `why` says the reason."""

    recording: Recording
    found: Reconstruction | None
    why: str
    health: Health
    samples: tuple[Sample, ...]
    watched: Watched


def replay(log: Path, told: Told, method: Method | None, out: Path, workers: int, progress: Report) -> Replay:
    """Measure a log into a folder like a run's, which appears when it is whole.

    Raises:
        BadInput: when the log is none that can be read, or the folder cannot be written.
        RunFailed: when a stage fails.
    """
    method = method or method_of(log)
    seconds: dict[str, float] = {}
    peaks_kb: dict[int, int] = {}
    with run_folder(out) as folder:
        with stage("read", seconds):
            recording, remarks = read_log(log, told, folder / "recording", progress)
        with stage("reconstruct", seconds):
            result = measure(recording, method, remarks, workers, peaks_kb, progress)
        write_replay(result, method, log.name, folder, seconds)
        write_about(log, effort(seconds, peaks_kb), folder)
    return replace(result, recording=replace(result.recording, folder=out / "recording"))


def write_replay(result: Replay, method: Method, name: str, folder: Path, seconds: dict[str, float]) -> None:
    """Write everything but the recording and `run.json`.

    Raises:
        RunFailed: when something cannot be written.
    """
    with stage("write", seconds):
        save_settings(method, folder / "method.yaml")
        write_health(result.health, folder / "health.json")
        if result.found is not None:
            write_reconstruction(result.found, folder / "reconstruction")
    with stage("report", seconds):
        from scenarios.field.page import write_page

        write_page(result, name, folder / "report.html")


def write_about(log: Path, about: dict, folder: Path) -> None:
    """Write `run.json`, last: of which log, by which versions, and with what effort."""
    said = {**versions(), "log": log.name, **about}
    (folder / "run.json").write_text(json.dumps(said, indent=1) + "\n")


def method_of(log: Path) -> Method:
    """By what a run was measured, or else the default."""
    return load_scenario(str(log / "scenario.yaml")).method if (log / "scenario.yaml").is_file() else Method()


def measure(
    recording: Recording,
    method: Method,
    remarks: list[str],
    workers: int,
    peaks_kb: dict[int, int],
    progress: Report,
) -> Replay:
    """The fold over a recording, and what its frames say of the log."""
    jobs = ((str(recording.folder), index, method) for index in range(len(recording)))
    state, watched = begin(recording.rig, recording.pipe, method), begin_watch(recording.rig)
    kept, samples = set(sample_indices(len(recording))), []
    for index, frame in enumerate(spread(look_at, jobs, workers, peaks_kb)):
        result = step(state, recording.frame(index), frame.seen)
        watch(watched, frame, result, recording.rig, method.decode.azimuths)
        if index in kept:
            samples.append(Sample(index, float(result.alignment.T_pipe_camera[2, 3]), frame.seen))
        progress("reconstruct", index + 1, len(recording))
    return concluded(recording, state, watched, tuple(samples), remarks)


def concluded(
    recording: Recording, state: State, watched: Watched, samples: tuple[Sample, ...], remarks: list[str]
) -> Replay:
    """What a log gave, once its last frame was taken in."""
    found, why = None, ""
    try:
        found = with_gaps(finish(state), recording)
    except ReconstructionFailed as error:
        why = str(error)
    return Replay(recording, found, why, examine(recording, state.method, watched, found, remarks), samples, watched)


def sample_indices(frames: int) -> list[int]:
    """Frames worth a look: the first, the middle one, the last."""
    return sorted({round(k * (frames - 1) / (SAMPLES - 1)) for k in range(SAMPLES)})
