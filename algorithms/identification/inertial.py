"""What the IMU's log tells of the IMU: noise and bias, at rest or else above the motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.signal import periodogram, welch

from algorithms.identification.estimate import (
    NORMAL_95,
    Estimate,
    Quantity,
    Unknown,
    about,
    of_blocks,
    of_variances,
    root_of,
    widened,
)
from algorithms.robust import spread
from sensor_model.geometry import GRAVITY_M_S2

STRETCHES = 4  # of a rest
LEAST_REST_S, LEAST_REST_SAMPLES = 1.0, 40
REST_STEP_MM = 0.011  # of a wheel between two stamps at rest: a count of a fine encoder to and fro
LEAST_SAMPLES = 60
SPEED_OVER_S, MOVING_SHARE = 0.3, 0.5
LONG_REST_S = 300.0
WALK_BLOCK_S = 30.0
WINDOW_S = 1.0
CHANCES = 5.0  # standard deviations that two octaves, or two axes, may differ by and still be taken for alike
THIRD_DIFFERENCE_GAIN = 20.0  # variance of the third difference of white noise over its own
THIRD_DIFFERENCE_FREEDOM = 0.4  # degrees of freedom that a third difference is worth
JOLT_SIGMAS = 4.0
MEDIAN_WORTH = 0.37  # of a variance, for one by the median absolute deviation


@dataclass(frozen=True)
class Imu:
    """The samples of a log: seconds since its start, rate of turn (rad/s), specific force (m/s2); rest and motion."""

    time_s: Float[np.ndarray, "n"]
    gyro_rad_s: Float[np.ndarray, "n 3"]
    force_m_s2: Float[np.ndarray, "n 3"]
    at_rest: Bool[np.ndarray, "n"]
    moving: Bool[np.ndarray, "n"]

    @property
    def step_s(self) -> float:
        """Time between samples."""
        return float(np.median(np.diff(self.time_s)))


def rest_by_wheels(
    imu_stamps_ns: Int[np.ndarray, "n"],
    encoder_stamps_ns: Int[np.ndarray, "k"],
    rolled_mm: Float[np.ndarray, "k wheels"],
) -> Bool[np.ndarray, "n"]:
    """Which samples fall into stretches of `LEAST_REST_S` or longer in which no wheel moves."""
    still = np.abs(np.diff(rolled_mm, axis=0)).max(axis=1) < REST_STEP_MM
    edges = np.flatnonzero(np.diff(np.concatenate([[False], still, [False]]).astype(np.int8)))
    rest = np.zeros(imu_stamps_ns.size, dtype=bool)
    for first, last in edges.reshape(-1, 2):
        begin, end = encoder_stamps_ns[first], encoder_stamps_ns[last]
        drift = np.abs(rolled_mm[last] - rolled_mm[first]).max()
        if (end - begin) / 1e9 >= LEAST_REST_S and drift < 0.02 * (end - begin) / 1e9 + 0.05:
            rest |= (imu_stamps_ns > begin + 2e8) & (imu_stamps_ns < end - 1e8)  # the robot swings out first
    return rest


def motion_by_wheels(
    imu_stamps_ns: Int[np.ndarray, "n"],
    encoder_stamps_ns: Int[np.ndarray, "k"],
    rolled_mm: Float[np.ndarray, "k wheels"],
) -> Bool[np.ndarray, "n"]:
    """Which samples fall where the wheels go at a good part of their fastest; all, where they never move."""
    time_s, way = (encoder_stamps_ns - encoder_stamps_ns[0]) / 1e9, np.median(rolled_mm, axis=1)
    at = (imu_stamps_ns - encoder_stamps_ns[0]) / 1e9
    speed = np.abs(np.interp(at + SPEED_OVER_S / 2, time_s, way) - np.interp(at - SPEED_OVER_S / 2, time_s, way))
    return speed >= MOVING_SHARE * speed.max()


def noise_density(imu: Imu, of: str) -> Quantity:
    """White noise per root hertz of `gyro` (rad/s/sqrt(Hz)) or `force` (m/s2/sqrt(Hz)); all axes alike.

    At rest by the Allan deviation at one sample; in motion by third differences, which hold whatever shakes as fast
    as one can sample: then the interval begins with 0, unless the spectrum's top is flat.
    """
    values = imu.gyro_rad_s if of == "gyro" else imu.force_m_s2
    rest = imu.at_rest
    if np.count_nonzero(rest) >= LEAST_REST_SAMPLES:
        steps = np.diff(values, axis=0)[rest[1:] & rest[:-1]]
        # a robot that is about to start, or still swings, is not at rest
        steps = steps[(np.abs(steps) <= JOLT_SIGMAS * np.array([spread(axis) for axis in steps.T])).all(axis=1)]
        # in stretches, of which one may swing more than others
        parts = np.array([0.5 * np.mean(part**2, axis=0) for part in np.array_split(steps, STRETCHES)])
        # neighbouring differences share a sample, which leaves two thirds of them
        words = "Allan deviation at rest, one sample"
        found = of_variances(parts.ravel(), 2 / 3 * len(steps) / STRETCHES, words)
        return found.scaled(float(np.sqrt(imu.step_s)))
    if imu.time_s.size < LEAST_SAMPLES:
        return Unknown(f"{imu.time_s.size} samples; {LEAST_SAMPLES} are needed")
    third = np.diff(values, n=3, axis=0)
    scatter = np.array([spread(axis) for axis in third.T])
    axes, words = scatter**2 / THIRD_DIFFERENCE_GAIN, "third differences in motion; the log has no rest"
    freedom = MEDIAN_WORTH * THIRD_DIFFERENCE_FREEDOM * third.shape[0]
    found = of_variances(axes, freedom, words).scaled(np.sqrt(imu.step_s))
    if _white_at_the_top(imu, values) and axes.max() < (1 + CHANCES * np.sqrt(2 / freedom)) * axes.min():
        return found
    shaken = "third differences in motion: at most so much, for noise and vibration are not told apart without rest"
    least = float(np.sqrt(axes.min() * imu.step_s))
    return Estimate(least, 0.0, found.high, found.count, shaken)


def _white_at_the_top(imu: Imu, values: Float[np.ndarray, "n 3"]) -> bool:
    """Whether the top octave of the spectrum is as high as the octave below it on every axis, but for chance."""
    frequency, power = periodogram(values, 1 / imu.step_s, window="hann", detrend="linear", axis=0)
    share = frequency / frequency[-1]
    upper, lower = (power[(share > low) & (share < high)].mean(axis=0) for low, high in ((0.5, 0.95), (0.25, 0.5)))
    chance = 1 + CHANCES * np.sqrt(12 / imu.time_s.size)
    return bool((np.maximum(lower / upper, upper / lower) < chance).all())


def spectrum(imu: Imu, values: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "f"], Float[np.ndarray, "f 3"]]:
    """Frequencies and the usual one-sided power density of each axis in motion: medians over windows, free of jolts."""
    samples = values[imu.moving if np.count_nonzero(imu.moving) >= LEAST_SAMPLES else slice(None)]
    window = min(round(WINDOW_S / imu.step_s), samples.shape[0])
    frequency, power = welch(samples, 1 / imu.step_s, nperseg=window, average="median", axis=0, detrend="linear")
    return frequency[1:], power[1:]


def random_walk(imu: Imu, of: str) -> Quantity:
    """How the bias wanders (per second and root hertz), from means of long stretches of one long rest."""
    values = imu.gyro_rad_s if of == "gyro" else imu.force_m_s2
    rest_s = float(np.count_nonzero(imu.at_rest) * imu.step_s)
    if rest_s < LONG_REST_S:
        return Unknown(f"{rest_s:.1f} s of rest; {LONG_REST_S:g} s are needed to see a bias wander")
    density = noise_density(imu, of)
    white = density.value if isinstance(density, Estimate) else 0.0
    length = round(WALK_BLOCK_S / imu.step_s)
    at_rest = values[imu.at_rest]
    means = at_rest[: at_rest.shape[0] // length * length].reshape(-1, length, 3).mean(axis=1)
    steps2 = np.mean(np.diff(means, axis=0) ** 2, axis=1)
    # two means of white noise and of a walk differ by 2 q^2 / T + 2/3 k^2 T
    walked = of_blocks((steps2 - 2 * white**2 / WALK_BLOCK_S) * 1.5 / WALK_BLOCK_S, "Allan deviation at rest, 30 s")
    return root_of(walked)


def gyro_bias(
    imu: Imu,
    frame_s: Float[np.ndarray, "frames"],
    turned_rad: Float[np.ndarray, "steps 3"],
    pose_std_rad: float,
    density: float,
    walk: float,
) -> list[Quantity]:
    """Bias of each axis (rad/s): the mean at rest, or the mean rate less what the poses turned.

    Args:
        imu: the log.
        frame_s: times of the poses, in the log's seconds; none where there are no poses.
        turned_rad: how far each pose has turned since the one before, in the IMU's axes.
        pose_std_rad: standard deviation of a pose's turn.
        density: of the white noise.
        walk: how the bias may wander (rad/s/sqrt(s)), which a short log does not tell.
    """
    rest = np.count_nonzero(imu.at_rest)
    wander = walk * np.sqrt((imu.time_s[-1] - imu.time_s[0]) / 3)
    if rest >= LEAST_REST_SAMPLES:
        std = float(np.hypot(density / np.sqrt(rest * imu.step_s), wander))
        return [about(float(mean), std, int(rest), "mean at rest") for mean in imu.gyro_rad_s[imu.at_rest].mean(axis=0)]
    if frame_s.size < 10:
        return [Unknown("the log has neither rest nor poses to hold the rate against")] * 3
    span_s = float(frame_s[-1] - frame_s[0])
    mean = _mean_rate(imu, float(frame_s[0]), float(frame_s[-1])) - turned_rad.sum(axis=0) / span_s
    std = np.sqrt(density**2 / span_s + 2 * (pose_std_rad / span_s) ** 2 + wander**2)
    words = f"mean rate less the turn of the poses over {span_s:.1f} s"
    return [about(float(value), float(std), frame_s.size, words) for value in mean]


def _mean_rate(imu: Imu, begin_s: float, end_s: float) -> Float[np.ndarray, "3"]:
    """Mean rate between two times, by trapezoids."""
    inside = (imu.time_s > begin_s) & (imu.time_s < end_s)
    knots = np.concatenate([[begin_s], imu.time_s[inside], [end_s]])
    rates = np.stack([np.interp(knots, imu.time_s, axis) for axis in imu.gyro_rad_s.T], axis=1)
    return np.trapezoid(rates, knots, axis=0) / (end_s - begin_s)


def size_of(biases: list[Quantity], source: str) -> Quantity:
    """The standard deviation over devices of which the axes of this one are draws."""
    known = [bias for bias in biases if isinstance(bias, Estimate)]
    if not known:
        return biases[0]
    measured = np.array([((b.high - b.low) / (2 * NORMAL_95)) ** 2 for b in known])
    found = of_variances(
        np.array([max(float(np.mean([b.value**2 for b in known])) - measured.mean(), 0.0)]), float(len(known)), source
    )
    blur = float(np.sqrt(measured.mean()))
    return Estimate(found.value, max(found.low - 2 * blur, 0.0), found.high + 2 * blur, len(known), source)


def force_bias_down(imu: Imu) -> Quantity:
    """How much the specific force exceeds gravity's where nothing accelerates, m/s2: the bias along the vertical."""
    chosen = imu.at_rest if np.count_nonzero(imu.at_rest) >= LEAST_REST_SAMPLES else np.ones_like(imu.at_rest)
    size = np.linalg.norm(imu.force_m_s2[chosen], axis=1) - GRAVITY_M_S2
    parts = np.array([part.mean() for part in np.array_split(size, 8)])
    where = "at rest" if chosen is imu.at_rest else "over the drive"
    return of_blocks(parts, f"mean specific force {where} less 9.80665 m/s2; local gravity differs by up to 0.03")


def attitude_noise(
    q_xyzw_turns: Float[np.ndarray, "steps 3"], gyro_turns: Float[np.ndarray, "steps 3"], source: str
) -> Quantity:
    """White noise of the device's attitude (rad): steps of it less the gyroscope's, whose neighbours must not drift."""
    off = q_xyzw_turns - gyro_turns
    parts = np.array([np.sqrt(np.mean(np.var(part, axis=0)) / 2) for part in np.array_split(off, 8) if len(part) > 5])
    return of_blocks(parts, source)


def inclination(force_along_m_s2: Float[np.ndarray, "frames"], bias_std_m_s2: float) -> Quantity:
    """How far the pipe goes down (rad): the specific force along it, whose accelerations add up to nothing."""
    blocks = np.array([part.mean() for part in np.array_split(force_along_m_s2, 8)])
    return widened(
        of_blocks(np.arcsin(np.clip(-blocks / GRAVITY_M_S2, -1, 1)), "specific force along the pipe"),
        bias_std_m_s2 / GRAVITY_M_S2,
    )
