"""Is the fused estimator as good as it says, and does its slip alarm speak in time: over many seeds, in closed form."""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np

from algorithms.localisation.featured import FeaturedSettings
from algorithms.localisation.fused import FilterSettings, FusedSettings
from scenarios.bench.drive_logs import Drive, SlipEpisode, estimate, look_at, make_log, nees
from sensor_model.points import PointNoise
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

RIG, FUSED = preset_rig(), FusedSettings()
NOISE = PointNoise(azimuths=360)
CHI2_2_95 = 5.991
ALARM_MM, IN_TIME_S = 5.0, 0.5


def consistency(seeds: int, upright: bool, settings: FilterSettings = FUSED) -> str:
    """Share of frames, one a second, whose error lies in the 95 % ellipse that the covariance states."""
    inside: tuple[list, list] = ([], [])
    roll, away = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        log = make_log(Drive(upright=upright), RIG, FUSED.inertial, FUSED.wheels, rng)
        sights = None if settings is FUSED else look_at(furnished(rng), log, RIG, NOISE, rng)
        found = estimate(log, RIG, settings, sights)
        inside[0].append(nees(found.error, found.covariance)[15::15] < CHI2_2_95)
        inside[1].append(nees(found.back_error, found.back_covariance)[15:-1:15] < CHI2_2_95)
        roll.append(np.degrees(found.error[:, 1]))
        away.append(abs(found.error[-1, 0]))
    live, back = (100 * float(np.mean(part)) for part in inside)
    rms = float(np.sqrt(np.mean(np.square(roll))))
    shares = f"{live:.1f} % live, {back:.1f} % looking back"
    return f"{shares}, roll {rms:.3f} deg RMS, {np.median(away):.2f} mm off at the end (median)"


def furnished(rng: np.random.Generator) -> Pipe:
    """A pipe in which there is something to see: pockets and pits all along, and two joints."""
    gap = {"gap_mm": 6, "gap_depth_mm": 2}
    size = {"pocket": {"length_mm": 50, "width_mm": 35}, "pit": {"diameter_mm": 30, "shape": "conical"}}
    features = [
        {"kind": kind, "distance_mm": z + rng.uniform(-20, 20), "clock_deg": rng.uniform(60, 300), "depth_mm": 4}
        | size[kind]
        for z, kind in zip(range(200, 1200, 150), ("pocket", "pit") * 4, strict=False)
    ]
    joints = [{"distance_mm": z + rng.uniform(-20, 20), **gap} for z in (420, 870)]
    return Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, end_mm=1400, features=features, joints=joints)


def alarms(episodes: int, draw: Callable[[np.random.Generator], SlipEpisode]) -> str:
    """How many slips of more than 5 mm are named, and rightly, within half a second of passing 5 mm."""
    rng, found, right, late = np.random.default_rng(1), 0, 0, []
    for seed in range(episodes):
        slip = draw(rng)
        log = make_log(
            Drive(seconds=9.0, slips=(slip,)), RIG, FUSED.inertial, FUSED.wheels, np.random.default_rng(seed)
        )
        past = slip.start_s + ALARM_MM / abs(slip.speed_mm_s)
        named = estimate(log, RIG, FUSED).episodes
        hits = [one for one in named if slip.start_s - 0.1 <= one.start_ns / 1e9 <= past + IN_TIME_S]
        who = "all wheels" if slip.wheel is None else f"wheel {slip.wheel + 1}"
        found, right = found + bool(hits), right + any(one.who == who for one in hits)
        late += [one.start_ns / 1e9 - past for one in hits[:1]]
    latest = f", {max(late):+.2f} s at the latest" if late else ""
    return f"{found} of {episodes} found in time, {right} with the right name{latest}"


def false_alarms(metres: int) -> int:
    """Alarms in clean drives of 10 m."""
    drive = Drive(seconds=100.5, speed_mm_s=100.0)
    logs = (make_log(drive, RIG, FUSED.inertial, FUSED.wheels, np.random.default_rng(k)) for k in range(metres // 10))
    return sum(len(estimate(log, RIG, FUSED).episodes) for log in logs)


def one_wheel(slowest: float, fastest: float) -> Callable[[np.random.Generator], SlipEpisode]:
    """A draw of slips of one wheel, of 6 to 20 mm, at a speed between two."""

    def draw(rng: np.random.Generator) -> SlipEpisode:
        speed = float(rng.uniform(slowest, fastest))
        return SlipEpisode(
            int(rng.integers(3)), float(rng.uniform(2, 4)), float(rng.uniform(6, 20)) / abs(speed), speed
        )

    return draw


def every_wheel(rng: np.random.Generator) -> SlipEpisode:
    """All wheels spin at once."""
    return SlipEpisode(None, float(rng.uniform(2, 4)), float(rng.uniform(0.3, 1.0)), float(rng.uniform(20, 60)))


if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 50
    print(f"inside the 95 % ellipse, level, {count} seeds: {consistency(count, upright=False)}")
    featured = consistency(count, upright=False, settings=FeaturedSettings())
    print(f"inside the 95 % ellipse, featured, {count} seeds: {featured}")
    print(f"inside the 95 % ellipse, vertical, {count} seeds: {consistency(count, upright=True)}")
    print(f"one wheel spins by 10 to 60 mm/s: {alarms(count, one_wheel(10, 60))}")
    print(f"one motor stalls (-50 mm/s): {alarms(count, one_wheel(-50, -50))}")
    print(f"one wheel creeps by 4 to 10 mm/s: {alarms(count, one_wheel(4, 10))}")
    print(f"all wheels spin by 20 to 60 mm/s: {alarms(count, every_wheel)}")
    print(f"false alarms in {2 * count} m: {false_alarms(2 * count)}")
