"""The IMU by itself and against its own attitude: gravity, units, axes, saturation, stuck axes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from scenarios.field.finding import Finding, finding
from sensor_model.geometry import GRAVITY_M_S2
from sensor_model.recording import Recording

AXES = ("gyro x", "gyro y", "gyro z", "force x", "force y", "force z")
STUCK_S, STUCK_SAMPLES = 1.0, 20
CLIPPED_RUN, FINE_VALUES = 4, 100
RANGES = {
    "gyro": np.radians([125.0, 250.0, 500.0, 1000.0, 2000.0]),
    "force": GRAVITY_M_S2 * np.array([2.0, 4.0, 8.0, 16.0]),
}
UNITS = {1 / GRAVITY_M_S2: "g", 1e3: "mm/s2", 1e3 / GRAVITY_M_S2: "mg"}
TURNING_RAD_S = 0.02  # so fast it must turn somewhere, or the gyroscope cannot be held against the attitude
DEG = 180 / np.pi


def imu_findings(recording: Recording) -> list[Finding]:
    """What the IMU's samples show."""
    return [_gravity(recording), _upright(recording), _turning(recording), _stuck(recording), _saturated(recording)]


def _gravity(recording: Recording) -> Finding:
    felt = float(np.median(np.linalg.norm(recording.imu[:, 3:], axis=1)))
    off = felt / GRAVITY_M_S2 - 1
    unit = next((name for scale, name in UNITS.items() if abs(felt / (GRAVITY_M_S2 * scale) - 1) < 0.1), None)
    says = f"{felt:.4g} m/s2 felt, {100 * off:+.1f} % off gravity" + (f": it is in {unit}" if unit else "")
    means = "Forces are not in m/s2, or the accelerometer is out of order: estimators that use it are misled."
    return finding("IMU", "gravity", says, abs(off) > 0.03, abs(off) > 0.1, means)


def _upright(recording: Recording) -> Finding:
    """Where the force points by the device's own attitude: upward, on the whole."""
    force_world = _attitude_at(recording, recording.imu_stamps_ns).apply(recording.imu[:, 3:])
    middle = np.median(force_world, axis=0)
    off = float(np.degrees(np.arctan2(np.hypot(*middle[:2]), middle[2])))
    says = f"gravity lies {off:.2f} degrees off the upright of the device's own attitude"
    means = "Axes of the IMU are swapped, or its attitude is wrong: do not trust clock positions and roll."
    return finding("IMU", "axes", says, off > 3, off > 10, means)


def _attitude_at(recording: Recording, stamps_ns: np.ndarray) -> Rotation:
    """The attitude nearest in time."""
    stamps = recording.orientation_stamps_ns
    after = np.clip(np.searchsorted(stamps, stamps_ns), 1, stamps.size - 1)
    nearest = after - (stamps_ns - stamps[after - 1] < stamps[after] - stamps_ns)
    return Rotation.from_quat(recording.q_world_imu_wxyz[nearest][:, [1, 2, 3, 0]])


def _turning(recording: Recording) -> Finding:
    """The gyroscope held against how the attitude turns, over steps long enough for its noise to fade."""
    rates, turned = _rates(recording)
    fast = np.linalg.norm(turned, axis=1) > TURNING_RAD_S
    if fast.sum() < 4:
        return Finding(
            "IMU", "gyroscope", "good", "it hardly turned: the gyroscope cannot be held against the attitude"
        )
    slope = float(np.sum(rates[fast] * turned[fast]) / np.sum(turned[fast] ** 2))
    power = np.sqrt(np.sum(rates[fast] ** 2) * np.sum(turned[fast] ** 2))
    alike = float(np.sum(rates[fast] * turned[fast]) / power) if power > 0 else 0.0
    unit = ": it is in degrees/s" if abs(slope / DEG - 1) < 0.3 else ""
    says = f"{slope:.2f} times the attitude's rate{unit}, alike by {alike:.2f}"
    means = "Its unit is not rad/s, or its axes are swapped: whatever integrates it is misled."
    off = abs(slope - 1)
    return finding("IMU", "gyroscope", says, off > 0.3 or alike < 0.8, off > 1 or alike < 0.3, means)


def _rates(recording: Recording) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    """Mean rates (rad/s, device axes) over steps of about half a second: by gyroscope, and by the attitude."""
    stamps = recording.imu_stamps_ns
    every = max(int(0.5e9 / max(float(np.median(np.diff(stamps))), 1.0)), 1)
    ends = np.arange(0, stamps.size, every)
    if ends.size < 2:
        return np.zeros((0, 3)), np.zeros((0, 3))
    attitude = _attitude_at(recording, stamps[ends])
    seconds = np.diff(stamps[ends])[:, None] / 1e9
    turned = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / seconds
    steps = np.diff(stamps, append=stamps[-1])[:, None] / 1e9
    return np.add.reduceat(recording.imu[:, :3] * steps, ends[:-1])[: ends.size - 1] / seconds, turned


def _stuck(recording: Recording) -> Finding:
    longest = [_longest_run(np.diff(column) == 0) for column in recording.imu.T]
    rate_hz = 1e9 / max(float(np.median(np.diff(recording.imu_stamps_ns))), 1.0)
    stuck = [k for k, run in enumerate(longest) if run > max(STUCK_S * rate_hz, STUCK_SAMPLES)]
    fine = [len(np.unique(column)) > FINE_VALUES for column in recording.imu.T]
    named = ", ".join(f"{AXES[k]} for {longest[k] / rate_hz:.1f} s" for k in stuck)
    means = "An axis that says the same for so long is dead or frozen; what rests on it is not measured."
    always = any(not fine[k] for k in stuck)
    return finding("IMU", "stuck axes", named or "none", bool(stuck), always, means)


def _saturated(recording: Recording) -> Finding:
    clipped = []
    for k, column in enumerate(recording.imu.T):
        top = float(np.abs(column).max())
        at_top = np.abs(column) == top
        of_range = np.abs(RANGES[AXES[k].split()[0]] / max(top, 1e-9) - 1).min() < 0.01
        fine = len(np.unique(column)) > FINE_VALUES
        if 0 < at_top.sum() < column.size and _longest_run(at_top) >= CLIPPED_RUN and (fine or of_range):
            clipped.append(f"{AXES[k]} at {top:.4g} in {100 * at_top.mean():.1f} % of the samples")
    means = "Past its range the IMU says too little: the motion there is larger than what was logged."
    return finding("IMU", "saturation", ", ".join(clipped) or "none", bool(clipped), False, means)


def _longest_run(flags: np.ndarray) -> int:
    """Length of the longest run of true values."""
    edges = np.flatnonzero(np.diff(np.r_[0, flags.astype(np.int8), 0]))
    return int((edges[1::2] - edges[::2]).max()) if edges.size else 0
