"""The budget of one real defect: what each source does to its sizes, alone and together, and what is stated."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from algorithms.reconstruct import finish, sized, trajectory
from algorithms.triangulate import triangulate
from algorithms.trust.budget import Source, compare, monte_carlo, propagate
from algorithms.types import Alignment, Defect, Reconstruction
from algorithms.wall_map import MapBuilder, add_points, finish_map, on_a_wall
from scenarios.bench.calibrated import BoardSession
from scenarios.bench.scans import Scan, take_scan
from scenarios.load import load_scenario
from scenarios.matching import match
from scenarios.run import fold
from scenarios.scenario import Scenario
from sensor_model.streams import stream

DIMENSIONS = ("length", "width", "depth")
TRUE_MM = np.array([70.0, 35.0, 7.5])
POCKET = "kind: pocket, distance_mm: {z:.6f}, clock_deg: {clock:.6f}, length_mm: 70, width_mm: 35, depth_mm: 7.5"
QUIET = {
    "sensing.points.pixel_noise_px": 0.0,
    "sensing.points.drop_out_share": 0.0,
    "sensing.imu.attitude_noise_deg": 0.0,
    "sensing.imu.attitude_drift_deg": 0.0,
}
NOISE = {"sensing.points.pixel_noise_px": 0.25, "sensing.points.drop_out_share": 0.02}  # the preset's
ROLL = {"sensing.imu.attitude_noise_deg": 0.05, "sensing.imu.attitude_drift_deg": 0.2}  # the preset's
WHEEL_PCT = 0.2  # one standard deviation of a wheel's diameter
PHASE_MM, PHASE_DEG = 50 / 15 / 2, 0.5  # a pocket's place between two frames and two cells: anywhere
SIGMAS, LEAST_MM = (4.0, 9.0), (0.3, 0.6)  # the threshold's two settings: anywhere between
DRAWS = 200_000
SOURCES = ("image noise", "calibration", "registration", "odometry", "roll", "threshold", "sampling")
ALL = "all of them"


class Measured(NamedTuple):
    """One scan's errors of length, width and depth, mm, and the standard deviations that it states."""

    error_mm: Float[np.ndarray, "3"]
    stated_mm: Float[np.ndarray, "3"]


def scenario_of(on: set[str], seed: int, changes: list[str]) -> Scenario:
    """The gantry past one pocket, with only some sources of error, each drawn anew with the seed."""
    settings: dict[str, Any] = dict(QUIET)
    settings |= NOISE if on & {"image noise", "registration"} else {}
    settings |= ROLL if "roll" in on else {}
    draws = {name: stream(seed, "bench", k) for k, name in enumerate(SOURCES)}
    if "odometry" in on:
        settings["sensing.encoders.wheel_diameter_error_pct"] = (
            WHEEL_PCT * draws["odometry"].standard_normal(3)
        ).tolist()
    if "threshold" in on:
        settings["method.sizing.threshold.noise_sigmas"] = float(draws["threshold"].uniform(*SIGMAS))
        settings["method.sizing.threshold.min_depth_mm"] = float(draws["threshold"].uniform(*LEAST_MM))
    place = draws["sampling"].uniform(-1, 1, 2) if "sampling" in on else np.zeros(2)
    pocket = POCKET.format(z=285 + PHASE_MM * place[0], clock=120 + PHASE_DEG * place[1])
    path = ["drive.start_mm=40", "drive.stages=[{to_mm: 260}]", "sensing.fidelity=points"]
    said = [f"{key}={value}" for key, value in settings.items()]
    scenario = load_scenario("paper-gantry", [f"pipe.features=[{{{pocket}}}]", *path, *said, *changes], seed)
    if "calibration" in on:
        scenario = scenario.model_copy(update={"calibration": BoardSession()})
    return scenario


def measured(on: set[str], seed: int, changes: list[str]) -> Measured:
    """One scan with some sources of error, sized blind.

    Image noise alone is mapped at the true poses, and registration alone maps points without noise at the poses that
    noisy frames gave, so that neither holds the other.
    """
    scan = _scanned(scenario_of(on, seed, changes))
    if on == {"image noise"}:
        return _judged(scan, _mapped(scan, scan.T_true))
    if on == {"registration"}:
        poses = _reconstructed(scan).trajectory.T_pipe_camera
        clean = _scanned(scenario_of(set(), seed, changes))
        return _judged(clean, _mapped(clean, poses))
    return _judged(scan, _reconstructed(scan))


def _scanned(scenario: Scenario) -> Scan:
    return take_scan(scenario, 1, lambda *_: None)


def _reconstructed(scan: Scan) -> Reconstruction:
    state, _ = fold(scan.scenario, scan.truth, scan.recording, scan.seen)
    return finish(state)


def _mapped(scan: Scan, poses: Float[np.ndarray, "frames 4 4"]) -> Reconstruction:
    """Map and size the frames at given poses."""
    rig, pipe, method = scan.recording.rig, scan.recording.pipe, scan.scenario.method
    builder = MapBuilder(method.map)
    for seen, T in zip(scan.seen, poses, strict=True):
        points = triangulate(seen, rig)
        kept = on_a_wall(points, T, pipe)
        add_points(builder, points, kept, Alignment(T, np.zeros((6, 6)), kept))
    return sized(trajectory([]), finish_map(builder), rig, pipe, method)


def _judged(scan: Scan, found: Reconstruction) -> Measured:
    pipe = scan.truth.pipe
    ((_, k),) = match(pipe, found.defects)
    defect: Defect = found.defects[k]
    sizes = np.array([getattr(defect, f"{name}_mm") for name in DIMENSIONS])
    return Measured(sizes - TRUE_MM, np.array([getattr(defect, f"{name}_std_mm") for name in DIMENSIONS]))


def report(runs: dict[str, list[Measured]], rng: np.random.Generator, say: Callable[[str], None]) -> None:
    """Print the budget: a line a source, their sum by propagation and by Monte Carlo, all at once, what is stated."""
    heads = "".join(f"   {name + ': sd':>12} {'mean':>8} {'share %':>8}" for name in DIMENSIONS)
    say(f"{'source':16s} {'n':>3}{heads}")
    n = len(runs[ALL])
    errors = {name: np.array([one.error_mm for one in some]) for name, some in runs.items()}
    sd = {name: error.std(axis=0, ddof=1) for name, error in errors.items()}
    budgets, draws = [], []
    for k in range(3):
        sources = [Source(name, 0.0, float(sd[name][k]), n - 1) for name in SOURCES]
        budgets.append(propagate(_total, sources))
        draws.append(monte_carlo(_total, sources, rng, DRAWS))
    for i, name in enumerate(SOURCES):
        cells = (
            f"   {sd[name][k]:12.4f} {errors[name][:, k].mean():+8.4f} {budgets[k].parts[i].variance_pct:8.1f}"
            for k in range(3)
        )
        say(f"{name:16s} {n:3d}{''.join(cells)}")
    whole, stated = errors[ALL], np.array([one.stated_mm for one in runs[ALL]])
    say(_line("sum, propagated", [f"{b.u:12.4f} {'':8} {b.degrees_of_freedom:5.0f} df" for b in budgets]))
    say(_line("its 95 % half", [f"{b.expanded():12.4f} {'':17}" for b in budgets]))
    say(_line("by Monte Carlo", [f"{(d.high - d.low) / 2:12.4f} {'':17}" for d in draws]))
    agree = [compare(b, d) for b, d in zip(budgets, draws, strict=True)]
    say(_line("they agree", [f"{'yes' if one.agree else 'no':>12} {'':17}" for one in agree]))
    say(_line(ALL, [f"{sd[ALL][k]:12.4f} {whole[:, k].mean():+8.4f} {'':8}" for k in range(3)]))
    say(_line("stated", [f"{stated[:, k].mean():12.4f} {'':17}" for k in range(3)]))
    inside = np.abs(whole) <= 1.96 * stated
    say(_line("95 % held", [f"{inside[:, k].sum():9d}/{n:<2d} {'':17}" for k in range(3)]))


def _line(what: str, cells: list[str]) -> str:
    return f"{what:20s}" + "".join(f"   {cell}" for cell in cells)


def _total(values: Any) -> Any:
    """An error is the sum of its sources' errors."""
    return sum(values.values())


def main() -> None:
    """Scan with one source at a time and with all, and print the budget."""
    words = argparse.ArgumentParser(description=__doc__)
    words.add_argument("--seeds", type=int, default=20, help="scans a source")
    words.add_argument("--set", nargs="*", default=[], help="settings, as in `pipetwin run --set`")
    asked = words.parse_args()
    runs = {name: [measured({name}, seed, asked.set) for seed in range(asked.seeds)] for name in SOURCES}
    runs[ALL] = [measured(set(SOURCES), seed, asked.set) for seed in range(asked.seeds)]
    report(runs, np.random.default_rng(0), print)


if __name__ == "__main__":
    main()
