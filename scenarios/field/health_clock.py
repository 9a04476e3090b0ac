"""Rates, gaps, dropped frames and jumps of the clock, from the stamps alone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from algorithms.localisation.gaps import log_gaps
from scenarios.field.finding import Finding, finding
from sensor_model.recording import Recording

LONG_GAP_S = 1.0
UNEVEN_SHARE = 0.3  # a step that is off by this share of the usual one is uneven
MOST_NAMED = 3
FASTEST_HZ = 5000.0


def rates_hz(recording: Recording) -> dict[str, float | int | None]:
    """How often each sensor speaks, by its middle step."""
    return {f"{name}_rate_hz": _rate_hz(stamps) for name, stamps in _logs(recording).items()}


def _logs(recording: Recording) -> dict[str, Int[np.ndarray, "n"]]:
    return {
        "cam0": recording.frame_stamps_ns,
        "imu0": recording.imu_stamps_ns,
        "orientation0": recording.orientation_stamps_ns,
        "encoders0": recording.encoder_stamps_ns,
    }


def _rate_hz(stamps_ns: Int[np.ndarray, "n"]) -> float | None:
    return round(1e9 / float(np.median(np.diff(stamps_ns))), 3) if stamps_ns.size > 1 else None


def clock_findings(recording: Recording) -> list[Finding]:
    """What the stamps show."""
    return [_rates(recording), _covered(recording), _gaps(recording), _dropped(recording), _uneven(recording)]


def _rates(recording: Recording) -> Finding:
    rates = {name: _rate_hz(stamps) for name, stamps in _logs(recording).items()}
    says = ", ".join(f"{name} {rate:.4g} Hz" if rate else f"{name} one sample" for name, rate in rates.items())
    slow = [name for name, rate in rates.items() if name != "cam0" and rate and rates["cam0"] and rate < rates["cam0"]]
    means = f"{', '.join(slow)} is slower than the camera: what lies between its samples is interpolated."
    impossible = any(rate is not None and not 0.2 < rate < FASTEST_HZ for rate in rates.values())
    if impossible:
        means = "No such sensor is that fast or slow: stamps are in another unit than ns, or were made up."
    return finding("clock", "rates", says, bool(slow) or impossible, impossible, means)


def _covered(recording: Recording) -> Finding:
    frames, wheels = (float(np.ptp(stamps)) for stamps in (recording.frame_stamps_ns, recording.encoder_stamps_ns))
    share = frames / max(wheels, 1.0)
    means = "Most of the way was not looked at, or the camera's stamps are in another unit."
    return finding(
        "clock",
        "coverage",
        f"pictures over {100 * min(share, 1):.0f} % of the wheels' time",
        share < 0.7,
        share < 0.1,
        means,
    )


def _gaps(recording: Recording) -> Finding:
    gaps = log_gaps(recording)
    if not gaps:
        return Finding("clock", "gaps and jumps", "good", "no silence in any log")
    start = int(recording.encoder_stamps_ns[0])
    named = [
        f"{gap.who} silent for {gap.amount:.2f} s at {(gap.start_ns - start) / 1e9:.2f} s" for gap in gaps[:MOST_NAMED]
    ]
    more = f", and {len(gaps) - MOST_NAMED} more" if len(gaps) > MOST_NAMED else ""
    bad = any(gap.amount > LONG_GAP_S for gap in gaps)
    means = (
        "Across a silence distance and attitude are interpolated, not measured: sizes and places there are doubtful."
    )
    return finding("clock", "gaps and jumps", "; ".join(named) + more, True, bad, means)


def _dropped(recording: Recording) -> Finding:
    steps = np.diff(recording.frame_stamps_ns)
    if steps.size < 2:
        return Finding("clock", "dropped frames", "bad", f"{len(recording)} frames", "There is next to nothing to map.")
    lost = np.maximum(np.rint(steps / np.median(steps)).astype(np.int64) - 1, 0)
    share = float(lost.sum() / (lost.sum() + len(recording)))
    says = f"{int(lost.sum())} of {int(lost.sum()) + len(recording)} frames missing, in {int((lost > 0).sum())} places"
    means = "The rings skip a stretch of the wall with every lost frame; what lies there may be sized short, or missed."
    return finding("clock", "dropped frames", says, share > 0, share > 0.1, means)


def _uneven(recording: Recording) -> Finding:
    worst_name, worst_share = "", 0.0
    for name, stamps in _logs(recording).items():
        steps = np.diff(stamps) / max(float(np.median(np.diff(stamps))), 1.0) if stamps.size > 2 else np.ones(1)
        share = float((np.abs(steps - np.rint(steps)) > UNEVEN_SHARE).mean())
        if share > worst_share:
            worst_name, worst_share = name, share
    says = f"{100 * worst_share:.1f} % of {worst_name}'s steps" if worst_name else "every step is even"
    means = (
        "Stamps that were made on arrival shift pictures against encoders: places scatter by speed times the jitter."
    )
    return finding("clock", "uneven stamps", says, worst_share > 0.02, worst_share > 0.3, means)
