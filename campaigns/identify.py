"""Twins with hidden settings, identified from their logs alone: how often the 95 % intervals hold what was hidden.

Each log is then made again from the scenario that was identified, and both are compared. `--points N` logs of slit
pixels with every quantity but the pictures' own, `--pictures N` short ones with pictures.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from io import StringIO
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np

from algorithms.identification.estimate import Estimate
from algorithms.identification.identify import Identified
from algorithms.identification.scan import walk
from scenarios.field.compare import compared
from scenarios.field.identify import identified, seen_frames
from scenarios.field.twin_of_log import scenario_text
from scenarios.load import load_scenario
from scenarios.progress import Progress
from scenarios.scenario import Scenario, nominal_pipe, nominal_rig
from sensor_model.optics import Optics
from sensor_model.recording import open_recording
from sensor_model.sense import sense
from sensor_model.streams import stream
from twin.simulate import simulate
from twin.truth import Truth

BANDS = ((5.0, 10.0), (10.0, 20.0), (20.0, 40.0))
POCKET = "kind: pocket, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5"
REST_S, RAMP_S, ROW_S = 2.0, 0.4, 0.1


def hidden_points(rng: np.random.Generator) -> list[str]:
    """Settings of a log of slit pixels, as `--set` takes them; half of the drives shake, with rest before and after."""
    draw, log = rng.uniform, lambda low, high: float(np.exp(rng.uniform(np.log(low), np.log(high))))
    changes = {
        "sensing.fidelity": "points",
        "pipe.inner_radius_mm": draw(72, 79),
        "pipe.ovality_pct": draw(0.1, 1.5),
        "pipe.ovality_clock_deg": draw(0, 180),
        "pipe.inclination_deg": draw(-5, 5),
        "pipe.features": f"[{{{POCKET}, distance_mm: {draw(150, 200)}}}]",
        "sensing.encoders.wheel_diameter_error_pct": f"[{draw(-1.2, 1.2)}, {draw(-1.2, 1.2)}, {draw(-1.2, 1.2)}]",
        "sensing.points.pixel_noise_px": draw(0.1, 0.5),
        "sensing.points.drop_out_share": draw(0.005, 0.08),
        "sensing.timing.dropped_share": draw(0, 0.05),
        "sensing.imu.gyroscope_noise_density": log(1e-4, 1e-3),
        "sensing.imu.accelerometer_noise_density": log(8e-4, 6e-3),
        "sensing.imu.gyroscope_bias_deg_s": log(0.05, 0.5),
        "sensing.imu.attitude_noise_deg": log(0.03, 0.2),
    }
    to_mm, speed = draw(180, 260), draw(30, 60)
    offset, tilt = draw(-4, 4, 2).tolist(), draw(-2.5, 2.5, 2).tolist()
    if rng.random() < 0.5:
        where = f"offset_mm: {offset}, tilt_deg: {tilt}"
        drive = f"{{kind: gantry, stages: [{{to_mm: {to_mm}}}], {where}, speed_mm_s: {speed}}}"
    else:
        drive = json.dumps(shaking_drive(to_mm, speed, offset, tilt, rng))
    return [f"{key}={value}" for key, value in {**changes, "drive": drive}.items()]


def shaking_drive(to_mm: float, speed: float, offset: list, tilt: list, rng: np.random.Generator) -> dict[str, Any]:
    """A way out of rest and into rest again, that shakes between."""
    end_s = 2 * REST_S + to_mm / speed + RAMP_S
    times = np.arange(0, end_s + ROW_S, ROW_S)
    ramp = np.clip((np.linspace(0, end_s, 20_000) - REST_S) / RAMP_S, 0, 1)
    ramp *= np.clip((REST_S + to_mm / speed + RAMP_S - np.linspace(0, end_s, 20_000)) / RAMP_S, 0, 1)
    way = np.cumsum(ramp)
    z = np.interp(times, np.linspace(0, end_s, 20_000), to_mm * way / way[-1])
    bands = [
        {
            "from_hz": low,
            "to_hz": high,
            "acceleration_m_s2": np.exp(rng.uniform(np.log(0.02), np.log(0.3), 3)).tolist(),
            "rate_deg_s": np.exp(rng.uniform(np.log(0.1), np.log(1.5), 3)).tolist(),
        }
        for low, high in BANDS
    ]
    rows = [[float(t), float(at), *offset, 0.0, *tilt] for t, at in zip(times - times[0], z, strict=True)]
    return {"kind": "recorded", "rows": rows, "vibration": bands}


def hidden_pictures(rng: np.random.Generator) -> list[str]:
    """Settings of a short log of pictures."""
    draw = rng.uniform
    changes = {
        "sensing.fidelity": "raycast",
        "sensing.frame_rate_hz": 6,
        "pipe.features": "[]",
        "pipe.inner_radius_mm": draw(72, 79),
        "sensing.optics.haze": draw(0.02, 0.35),
        "sensing.optics.slide_jag_deg": draw(0.06, 0.3),
        "sensing.optics.slide_jag_cells": int(draw(150, 700)),
        "sensing.optics.shot_noise": draw(0.006, 0.03),
        "sensing.optics.read_noise": draw(0.001, 0.008),
    }
    offset, tilt = draw(-4, 4, 2).tolist(), draw(-2.5, 2.5, 2).tolist()
    drive = f"{{kind: gantry, stages: [{{to_mm: 130}}], offset_mm: {offset}, tilt_deg: {tilt}}}"
    return [f"{key}={value}" for key, value in {**changes, "drive": drive}.items()]


def made(scenario: Scenario, folder: Path) -> Truth:
    """Drive and log."""
    truth = simulate(scenario.pipe, scenario.robot, scenario.drive, stream(scenario.seed, "drive"))
    true_rig = scenario.true_rig or scenario.rig
    rigs = true_rig, nominal_rig(scenario), nominal_pipe(scenario)
    list(sense(truth, *rigs, scenario.sensing, scenario.seed, folder))
    return truth


def hidden_values(scenario: Scenario, truth: Truth, frames_s: np.ndarray) -> dict[str, float]:
    """What identification is to find, by its names."""
    pipe, sensing = scenario.pipe, scenario.sensing
    seen_mm = truth.pose_at(frames_s[[0, -1]])[:, 2, 3]  # a log shows nothing of the way after its last frame
    out = {
        "diameter_mm": 2 * pipe.bore_radius_mm,
        "ovality_pct": pipe.ovality_pct,
        "inclination_deg": pipe.inclination_deg,
        "frame_rate_hz": sensing.frame_rate_hz,
        "travel_mm": float(np.ptp(seen_mm)),
        "dropped_share": sensing.timing.dropped_share,
        "gyroscope_noise_density": sensing.imu.gyroscope_noise_density,
        "accelerometer_noise_density": sensing.imu.accelerometer_noise_density,
        "gyroscope_bias_deg_s": sensing.imu.gyroscope_bias_deg_s,
        "attitude_noise_deg": sensing.imu.attitude_noise_deg,
    }
    turn = truth.pose_at(truth.time_s[::50])
    out["offset_x_mm"], out["offset_y_mm"] = turn[:, :2, 3].mean(axis=0).tolist()
    out["tilt_x_deg"] = float(np.degrees(np.arctan2(turn[:, 2, 1], turn[:, 2, 2])).mean())
    out["tilt_y_deg"] = float(np.degrees(-np.arcsin(turn[:, 2, 0])).mean())
    out["turned_deg"] = float(
        np.degrees(np.arctan2(turn[-1, 1, 0], turn[-1, 0, 0]) - np.arctan2(turn[0, 1, 0], turn[0, 0, 0]))
    )
    # the device's own bias: what its stream draws after both noises
    rng, n = stream(scenario.seed, "imu"), truth.sample_times_s(sensing.imu.update_rate).size
    rng.standard_normal((n, 3))
    walked = (
        np.cumsum(rng.standard_normal((n, 3)), axis=0)
        * sensing.imu.gyroscope_random_walk
        / np.sqrt(sensing.imu.update_rate)
    )
    bias = rng.standard_normal(3) * sensing.imu.gyroscope_bias_deg_s + np.degrees(walked.mean(axis=0))
    out |= {f"gyroscope_bias_{axis}_deg_s": float(value) for axis, value in zip("xyz", bias, strict=True)}
    rolls = 1 / (1 + np.array(sensing.encoders.wheel_diameter_error_pct) / 100)
    out["wheel_common_scale_pct"] = 100 * float(1 / rolls.mean() - 1)
    out |= {f"wheel{k}_scale_beside_mean_pct": 100 * float(rolls.mean() / roll - 1) for k, roll in enumerate(rolls)}
    if sensing.fidelity == "points":
        out |= {"pixel_noise_px": sensing.points.pixel_noise_px, "drop_out_share": sensing.points.drop_out_share}
        return out
    optics = sensing.optics
    out |= {"haze": optics.haze, "shot_noise": optics.shot_noise, "read_noise": optics.read_noise}
    return out | {"edge_jitter_deg": optics.slide_jag_deg / 3, "edge_jitter_cells": float(optics.slide_jag_cells)}


def held(
    found: Identified, scenario: Scenario, truth: Truth, frames_s: np.ndarray
) -> Iterator[tuple[str, bool, float]]:
    """Each quantity: whether its interval holds what was hidden, and by how many half widths it is off."""
    for name, value in hidden_values(scenario, truth, frames_s).items():
        one = found.quantities[name]
        if isinstance(one, Estimate):
            slack = 1e-9 * abs(value)
            half = max((one.high - one.low) / 2, 1e-12)
            yield name, one.low - slack <= value <= one.high + slack, (one.value - value) / half
    told = {band.from_hz: band for band in getattr(scenario.drive, "vibration", ())}
    for band in found.bands:
        if band.from_hz not in told:
            continue
        hidden = told[band.from_hz]
        pairs = zip(
            (*band.force_m_s2, *(rate.scaled(float(np.degrees(1))) for rate in band.rate_rad_s)),
            (*hidden.acceleration_m_s2, *hidden.rate_deg_s),
            ("vibration_m_s2",) * 3 + ("vibration_deg_s",) * 3,
            strict=True,
        )
        for one, value, name in pairs:
            if isinstance(one, Estimate):
                yield name, one.low <= value <= one.high, (one.value - value) / max((one.high - one.low) / 2, 1e-12)


def one_log(changes: list[str], seed: int, folder: Path) -> dict[str, Any]:
    """Make a log, identify it, make it again by what was found, and compare."""
    progress = Progress(StringIO())
    scenario = load_scenario("paper-gantry", changes, seed)
    truth = made(scenario, folder / "log")
    done = identified(folder / "log", None, Optics(), "again", progress)
    file = folder / "again.yaml"
    file.write_text(scenario_text(done.given, done.found, done.drive))
    fidelity = f"sensing.fidelity={scenario.sensing.fidelity}"
    made(load_scenario(str(file), [fidelity], seed + 1000), folder / "again")
    both = [open_recording(folder / name) for name in ("log", "again")]
    lines = compared(*(part for one in both for part in (one, walk(one, seen_frames(one, progress)))))
    outside = {
        line.name: round(line.difference / line.spread, 2) if line.spread else 0.0 for line in lines if not line.inside
    }
    rows = [
        (name, bool(inside), float(off))
        for name, inside, off in held(done.found, scenario, truth, both[0].frame_stamps_ns / 1e9)
    ]
    return {"held": rows, "figures": len(lines), "outside": outside, "said": done.found.said}


def campaign(count: int, hide: Any, first_seed: int, say: bool) -> dict[str, Any]:
    """So many logs; per quantity how often it was held, of how many, and how many replays lie inside."""
    tally: dict[str, list[bool]] = defaultdict(list)
    passed, outside, figures = 0, defaultdict(int), 0
    for k in range(count):
        started = process_time()
        seed = first_seed + k
        with tempfile.TemporaryDirectory() as folder:
            row = one_log(hide(np.random.default_rng([seed, 77])), seed, Path(folder))
        for name, inside, _ in row["held"]:
            tally[name].append(inside)
        figures += row["figures"]
        passed += not row["outside"]
        for name in row["outside"]:
            outside[name] += 1
        missed = [f"{name} {off:+.1f}" for name, inside, off in row["held"] if not inside]
        if say:
            print(f"seed {seed}: not held: {', '.join(missed) or 'none'}; outside: {row['outside'] or 'none'}; "
                  f"{process_time() - started:.0f} s", flush=True)  # fmt: skip
    shares = {name: (sum(values), len(values)) for name, values in sorted(tally.items())}
    return {"held": shares, "logs": count, "passed": passed, "figures": figures, "outside": dict(outside)}


def report(title: str, result: dict[str, Any]) -> None:
    """Print a campaign's outcome."""
    print(f"{title}: {result['logs']} logs")
    for name, (inside, of) in result["held"].items():
        print(f"  {name:<32} {inside:3d} of {of:3d}  {100 * inside / of:5.1f} %")
    count = sum(of for _, of in result["held"].values())
    inside = sum(i for i, _ in result["held"].values())
    print(f"  {'all':<32} {inside:3d} of {count:3d}  {100 * inside / max(count, 1):5.1f} %")
    off = sum(result["outside"].values())
    print(f"  replays: {result['passed']} of {result['logs']} wholly inside; ", end="")
    print(f"{off} of {result['figures']} figures outside {result['outside']}")


def main() -> None:
    """Run both campaigns."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--points", type=int, default=20)
    asked.add_argument("--pictures", type=int, default=20)
    asked.add_argument("--seed", type=int, default=0)
    given = asked.parse_args()
    for title, count, hide in (
        ("slit pixels", given.points, hidden_points),
        ("pictures", given.pictures, hidden_pictures),
    ):
        if count:
            report(title, campaign(count, hide, given.seed, True))


if __name__ == "__main__":
    main()
