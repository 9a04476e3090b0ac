"""What the measurement costs a frame, and what a whole run takes in time and memory, in a short and a long pipe."""

from __future__ import annotations

import argparse
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import cv2
import numpy as np

from algorithms import decode as decoding
from algorithms import reconstruct as measuring
from algorithms.method import Method
from algorithms.registration import REGISTRATIONS
from scenarios.load import load_scenario
from scenarios.run import run
from scenarios.scenario import Scenario, nominal_pipe
from scenarios.score import FrameTally, tally_frame
from scenarios.study.cache import GB, Cache
from scenarios.study.scan import scan
from sensor_model.points import see_slits
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate
from twin.truth import Truth

SENSOR_HZ = 15.0
ROUNDS = 6
FEW_FRAMES = ["sensing.fidelity=raycast", "sensing.frame_rate_hz=1.25", "drive.stages=[{to_mm: 420}]"]
LONG_SCAN = [
    "sensing.fidelity=points",
    "pipe.end_mm=1300",
    "drive.stages=[{to_mm: 290, roll_to_deg: 25}, {to_mm: 1013}]",
]
MEMORY = Path("/dev/shm")  # noqa: S108  a drive would be timed as well
COARSE = ["method.map.cell_z_mm=20"]  # for the run that makes the frames, which must see most of its map
DECODE_PARTS = ["polar_lines", "find_dips", "color_scores", "name_slits", "usual", "supported", "_slit_pixels"]
LENGTHS = {"0.667 m": [], "3 m": ["pipe.end_mm=3300", "drive.end_mm=3000"]}


def timed(name: str, function: Callable, spent: dict[str, list[float]]) -> Callable:
    """The same function, which notes the processor time of each call, in ms."""

    def call(*args: object) -> object:
        start = time.process_time()
        result = function(*args)
        spent[name].append(1000 * (time.process_time() - start))
        return result

    return call


def watch(spent: dict[str, list[float]]) -> None:
    """Put a clock on every part of the measurement, where the fold looks them up."""
    for module, names in ((decoding, DECODE_PARTS), (measuring, ["decode", "step", "triangulate", "add_points"])):
        for name in names:
            setattr(module, name, timed(name, getattr(module, name), spent))
    for kind, method in REGISTRATIONS.items():
        REGISTRATIONS[kind] = method._replace(align=timed("register", method.align, spent))


def per_frame() -> None:
    """Time the measurement of a few frames of a carved pipe, from the picture in memory, on one core."""
    cv2.setNumThreads(1)
    scenario = load_scenario("paper-gantry", FEW_FRAMES + COARSE)
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(0, "drive"))
    with tempfile.TemporaryDirectory() as folder:
        run(scenario, Path(folder, "run"), 1, lambda *_: None)
        recording = open_recording(Path(folder, "run", "recording"))
        frames = [recording[i] for i in range(len(recording))]
    poses = truth.pose_at(np.minimum(recording.frame_stamps_ns / 1e9, truth.time_s[-1]))
    spent: dict[str, list[float]] = defaultdict(list)
    watch(spent)
    look = timed("see_slits", see_slits, spent)
    for attempt in range(ROUNDS + 1):
        if attempt == 1:
            spent.clear()  # what came before was compiled on the way
        state = measuring.begin(recording.rig, recording.pipe, Method())
        for frame, pose in zip(frames, poses, strict=True):
            measuring.step(state, frame, measuring.see(frame, recording.rig, Method()))
            look(scenario.pipe, pose, scenario.rig, scenario.sensing.points, np.random.default_rng(0))
    calls = ROUNDS * len(frames)
    print(f"\nper frame, one core, processor time, {len(frames)} frames x {ROUNDS}: mean (slowest)")
    for name in ["decode", *DECODE_PARTS, "triangulate", "register", "add_points"]:
        label = f"  {'  of it ' * (name in DECODE_PARTS)}{name.strip('_')}"
        print(f"{label:34s} {sum(spent[name]) / calls:8.2f} ms ({max(spent[name]):.1f})")
    core, whole, cheap = ["decode", "triangulate", "register"], ["decode", "step"], ["see_slits"]
    for names in (core, whole, cheap):
        ms = sum(sum(spent[name]) for name in names) / calls
        speed = f"{1000 / ms:6.1f} frames/s, {1000 / ms / SENSOR_HZ:.1f} x the sensor's rate"
        print(f"  {' + '.join(names):32s} {ms:8.2f} ms, {speed}")


def points_end_to_end() -> None:
    """Time a whole scan in points fidelity on one core: sensed and written, read back, measured, scored."""
    scenario = load_scenario("paper-gantry", ["sensing.fidelity=points"])
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(0, "drive"))
    best: dict[str, float] = {}
    with tempfile.TemporaryDirectory() as folder:
        for attempt in range(ROUNDS):
            seconds, frames = points_once(scenario, truth, Path(folder, str(attempt)))
            best = {part: min(spent, best.get(part, np.inf)) for part, spent in seconds.items()}
    print(f"\npoints fidelity end to end, one core, processor time, {frames} frames: best of {ROUNDS}")
    for part, spent in best.items():
        print(f"  {part:34s} {1000 * spent / frames:8.2f} ms")
    for name, left_out in (("all", ()), ("all but align", ("align",))):
        ms = 1000 * sum(spent for part, spent in best.items() if part not in left_out) / frames
        print(f"  {name:34s} {ms:8.2f} ms, {1000 / ms:6.1f} frames/s")


def points_once(scenario: Scenario, truth: Truth, folder: Path) -> tuple[dict[str, float], int]:
    """Processor seconds of each part of one scan, and the number of frames."""
    spent: dict[str, list[float]] = defaultdict(list)
    kind = scenario.method.registration.kind
    settings, align = REGISTRATIONS[kind]
    REGISTRATIONS[kind] = settings, timed("align", align, spent)
    sent = (truth, scenario.rig, scenario.rig, nominal_pipe(scenario), scenario.sensing, scenario.seed, folder)
    timed("sense and write", lambda: list(sense(*sent)), spent)()
    recording = timed("open the recording", lambda: open_recording(folder), spent)()
    T_true = truth.pose_at(recording.frame_stamps_ns / 1e9)
    state, tally = (
        measuring.begin(recording.rig, recording.pipe, scenario.method),
        FrameTally(truth.pipe, scenario.rig, optics=scenario.sensing.optics),
    )
    read, step, take = (
        timed(name, function, spent)
        for name, function in (
            ("read", recording.__getitem__),
            ("measure", measuring.step),
            ("tally", tally_frame),
        )
    )
    for index in range(len(recording)):
        frame = read(index)
        take(tally, step(state, frame, frame.slit_pixels), T_true[index])
    REGISTRATIONS[kind] = settings, align
    seconds = {part: sum(calls) / 1000 for part, calls in spent.items()}
    seconds["measure"] -= seconds["align"]
    return seconds, len(recording)


def whole_scan() -> None:
    """Time a whole scan in points fidelity as a study makes it: drive, sensing, map, sizing and score, on one core."""
    scenario = load_scenario("paper-gantry", LONG_SCAN)
    spent = []
    for _ in range(ROUNDS + 1):  # the first compiles
        # a folder in memory, and a new one each time, so that nothing comes out of the cache
        with tempfile.TemporaryDirectory(dir=MEMORY if MEMORY.is_dir() else None) as folder:
            start = time.process_time()
            row = scan(scenario, Cache(Path(folder), 10 * GB))[0]
            spent.append(time.process_time() - start)
    least = min(spent[1:])
    print(f"\nwhole scan in points fidelity, one core, processor time, {row['frames']} frames: best of {ROUNDS}")
    print(f"  {'drive to score':34s} {1000 * least:8.0f} ms, {row['frames'] / least:6.1f} frames/s")


def together_mb(session: int) -> float:
    """Memory of all processes of one session, shared pages counted once."""
    total = 0.0
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if os.getsid(int(entry.name)) == session:
                rows = (entry / "smaps_rollup").read_text().splitlines()
                total += sum(int(row.split()[1]) / 1024 for row in rows if row.startswith("Pss:"))
        except OSError:  # it ended meanwhile
            continue
    return total


def whole_run(changes: list[str]) -> dict[str, float]:
    """Run `paper-robot` in a process of its own: wall seconds per stage, and memory while it ran."""
    words = [word for change in changes for word in ("--set", change)]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "scenarios.cli", "run", "paper-robot", "-o", f"{folder}/run", *words]
        peak = 0.0
        nowhere = subprocess.DEVNULL
        with subprocess.Popen(command, start_new_session=True, stdout=nowhere, stderr=nowhere) as process:
            while process.poll() is None:
                peak = max(peak, together_mb(process.pid))
                time.sleep(0.25)
        made, score = (json.loads(Path(folder, "run", name).read_text()) for name in ("run.json", "score.json"))
    seconds = {"frames": score["frames"], **made["seconds"], "total s": made["seconds_total"]}
    return seconds | made["peak_memory_mb"] | {"all, sampled": peak}


def runs(fidelity: str) -> None:
    """One line a length, and how memory grows from the short pipe to the long one."""
    print(f"\npaper-robot in {fidelity} fidelity: wall seconds per stage, peak memory in MB")
    rows = [whole_run([f"sensing.fidelity={fidelity}", *changes]) for changes in LENGTHS.values()]
    print(f"  {'':8s}" + "".join(f"{name:>15s}" for name in rows[0]))
    for length, row in zip(LENGTHS, rows, strict=True):
        print(f"  {length:8s}" + "".join(f"{figure:15.4g}" for figure in row.values()))
    print(f"  {'ratio':8s}" + "".join(f"{rows[1][name] / max(rows[0][name], 1e-9):15.2f}" for name in rows[0]))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the cost of a frame only, in pictures and in points")
    parser.add_argument("--long", action="store_true", help="whole runs in picture fidelity too (ten minutes)")
    asked = parser.parse_args()
    model = next(row for row in Path("/proc/cpuinfo").read_text().splitlines() if row.startswith("model name"))
    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "opencv-python-headless", "mujoco"))
    print(f"{os.cpu_count()} x {model.split(': ')[1]}; Python {platform.python_version()}, {libraries}")
    whole_scan()
    points_end_to_end()
    per_frame()
    for fidelity in [] if asked.quick else ["points", "picture"] if asked.long else ["points"]:
        runs(fidelity)


if __name__ == "__main__":
    main()
