"""The wheel encoders against each other and against what a robot can do: jumps, dead and reversed wheels, slip."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from algorithms.localisation.wheels import wheel_distances_mm
from scenarios.field.finding import Finding, finding
from sensor_model.recording import Recording

FASTEST_MM_S = 2000.0
LEAST_JUMP_MM = 5.0
STILL_MM = 5.0
COUNTERS = (8, 15, 16, 24, 31, 32)  # bits
DEAD_SHARE, DEAD_MM = 0.05, 30.0
MOST_NAMED = 3


def wheel_findings(recording: Recording) -> list[Finding]:
    """What the counts show."""
    rolled = wheel_distances_mm(recording.counts.astype(float), recording.rig)
    steps, jumps = _steps(recording, rolled)
    return [_jumps(recording, jumps), _moved(steps), *_against_each_other(steps)]


def _steps(recording: Recording, rolled_mm: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What each wheel rolled between samples, nothing where it jumped; and where it did."""
    steps = np.diff(rolled_mm, axis=0)
    seconds = np.diff(recording.encoder_stamps_ns)[:, None] / 1e9
    jumps = np.abs(steps) > np.maximum(FASTEST_MM_S * seconds, LEAST_JUMP_MM)
    return np.where(jumps, 0.0, steps), jumps


def _jumps(recording: Recording, jumps: np.ndarray) -> Finding:
    named = [_jump(recording, int(row), int(wheel)) for row, wheel in np.argwhere(jumps)[:MOST_NAMED]]
    more = f", and {int(jumps.sum()) - MOST_NAMED} more" if jumps.sum() > MOST_NAMED else ""
    means = "Distance leaps there: everything after it is misplaced, and what the rings were on is torn or stretched."
    return finding(
        "encoders", "resets and jumps", "; ".join(named) + more or "none", bool(jumps.any()), bool(jumps.any()), means
    )


def _jump(recording: Recording, row: int, wheel: int) -> str:
    before, after = int(recording.counts[row, wheel]), int(recording.counts[row + 1, wheel])
    at_s = (recording.encoder_stamps_ns[row] - recording.encoder_stamps_ns[0]) / 1e9
    bits = next((b for b in COUNTERS if abs(abs(after - before) - 2**b) < 0.02 * 2**b), None)
    words = (
        f"an overflow of {bits} bits" if bits else "a reset to zero" if abs(after) < 0.02 * abs(before) else "a jump"
    )
    return f"wheel {wheel + 1}: {words}, from {before} to {after} counts at {at_s:.2f} s"


def _moved(steps_mm: np.ndarray) -> Finding:
    way = float(np.median(np.abs(steps_mm).sum(axis=0)))
    means = "No wheel turned: unless the robot stood, every place and every length is wrong."
    return finding(
        "encoders", "travel", f"{way:.1f} mm rolled by the middle wheel", way < STILL_MM, way < STILL_MM, means
    )


def _against_each_other(steps_mm: Float[np.ndarray, "n wheels"]) -> list[Finding]:
    if steps_mm.shape[1] < 2:
        return [
            Finding("encoders", "agreement", "weak", "one wheel", "Nothing can be held against it: slip is not seen.")
        ]
    common, ways = np.median(steps_mm, axis=1), np.abs(steps_mm).sum(axis=0)
    middle = max(float(np.median(ways)), 1e-9)
    still = _still_mm(steps_mm, common)
    dead = [f"wheel {k + 1}" for k, way in enumerate(ways) if way < DEAD_SHARE * middle and middle > STILL_MM]
    resting = [
        f"wheel {k + 1} for {mm:.0f} mm" for k, mm in enumerate(still) if mm > DEAD_MM and f"wheel {k + 1}" not in dead
    ]
    away = [f"wheel {k + 1}" for k, s in enumerate(steps_mm.T) if s @ common < -0.5 * (common @ common) < 0]
    share = float(np.max(np.abs(ways / middle - 1)))
    dead_means = (
        "A wheel that does not turn with the others is stuck or its encoder is dead; the middle of the rest is used."
    )
    off_means = (
        "Wheels that go unlike ways slip, or their diameters are not those of the rig: distance is off by as much."
    )
    others = [w for k, w in enumerate(ways / middle) if f"wheel {k + 1}" not in dead]
    spread = float(np.max(np.abs(np.array(others) - 1))) if others else share
    return [
        finding("encoders", "dead wheels", ", ".join(dead + resting) or "none", bool(resting), bool(dead), dead_means),
        finding(
            "encoders",
            "direction",
            f"{', '.join(away)} against the others" if away else "all turn the same way",
            bool(away),
            bool(away),
            "A wheel's encoder is wired or named the wrong way round.",
        ),
        finding(
            "encoders",
            "agreement",
            f"ways differ by up to {100 * spread:.2f} %",
            spread > 0.02,
            spread > 0.1,
            off_means,
        ),
    ]


def _still_mm(steps_mm: np.ndarray, common_mm: np.ndarray) -> list[float]:
    """How far the others rolled, at most, while each wheel stood."""
    out = []
    for wheel in steps_mm.T:
        way, longest = 0.0, 0.0
        for own, all_ in zip(wheel.tolist(), common_mm.tolist(), strict=True):
            way = way + abs(all_) if own == 0 else 0.0
            longest = max(longest, way)
        out.append(longest)
    return out
