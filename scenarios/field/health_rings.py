"""What the rings say of rig and pipe: how much was seen and fitted, and whether the rings agree with each other."""

from __future__ import annotations

from collections import Counter

import numpy as np

from algorithms.large_arrays import lines
from algorithms.types import Reconstruction, seen_share
from scenarios.field.finding import Finding, finding
from scenarios.field.look import Watched
from scenarios.field.travel import way
from sensor_model.recording import Recording

WEAK_APART_MM, BAD_APART_MM = 0.12, 0.6
INWARD_MM, INWARD_SHARE = 1.5, 0.02
SURE = 0.02  # of the way, one standard deviation


def ring_figures(watched: Watched, found: Reconstruction | None) -> dict[str, float | int | None]:
    """The figures behind the verdicts."""
    apart, noise = rings_apart_mm(watched), _noise_scale(watched)
    return {
        "frames": len(watched.digest),
        "frames_registered": 0 if found is None else int(found.trajectory.registered.sum()),
        "decode_yield": None if found is None else float(found.trajectory.decode_yield.mean()),
        "seen_share": None if found is None else seen_share(found.wall),
        "rings_apart_mm": None if np.isnan(apart) else apart,
        "noise_scale": None if np.isnan(noise) else noise,
    }


def rings_apart_mm(watched: Watched) -> float:
    """How far the slits lie from one common wall, RMS; NaN where fewer than two were fitted."""
    off = np.array(watched.ring_off_mm)
    fitted = np.isfinite(off)
    if not fitted.any():
        return float("nan")
    middle = np.array([np.median(column[ok]) for column, ok in zip(off.T, fitted.T, strict=True) if ok.sum() >= 3])
    return float(np.sqrt(np.mean((middle - middle.mean()) ** 2))) if middle.size > 1 else float("nan")


def _noise_scale(watched: Watched) -> float:
    known = np.array(watched.noise_scale)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if known.size else float("nan")


def ring_findings(recording: Recording, watched: Watched, found: Reconstruction | None) -> list[Finding]:
    """What the fitted frames show; without a reconstruction, why there is none."""
    if found is None:
        return [Finding("rings", "registration", "bad", "no frame could be fitted", "There is no result.")]
    return [
        _registered(found),
        _radius(recording, found),
        _apart(watched),
        _noise(watched),
        _way(watched),
        _inward(found),
    ]


def _registered(found: Reconstruction) -> Finding:
    path = found.trajectory
    share, weak = float(path.registered.mean()), float(np.mean([bool(why) for why in path.reason]))
    reasons = Counter(why for why in path.reason if why).most_common(2)
    words = "".join(f"; {count} x {why}" for why, count in reasons)
    says = f"{int(path.registered.sum())} of {path.registered.size} frames fitted{words}"
    means = "Where frames are not fitted the pose is only predicted, and their points are left out of the map."
    return finding("rings", "registration", says, share < 0.98 or weak > 0.3, share < 0.8, means)


def _radius(recording: Recording, found: Reconstruction) -> Finding:
    path, told = found.trajectory, recording.pipe.inner_radius_mm
    seen = path.radius_mm[path.registered & np.isfinite(path.radius_mm)]
    if not seen.size:
        return Finding(
            "rings", "pipe's diameter", "weak", "no frame fits a radius of its own", "A wrong one is not seen."
        )
    off = float(np.median(seen)) / told - 1
    says = f"{2 * float(np.median(seen)):.2f} mm in the middle frame, {100 * off:+.2f} % off the {2 * told:g} mm told"
    means = (
        "The pipe told is not this one, or the rig's scale is off: every size is off by as much, and wall loss more."
    )
    return finding("rings", "pipe's diameter", says, abs(off) > 0.006, abs(off) > 0.02, means)


def _apart(watched: Watched) -> Finding:
    apart = rings_apart_mm(watched)
    if np.isnan(apart):
        return Finding("rings", "agreement", "weak", "fewer than two rings were fitted", "A wrong rig is not seen.")
    says = f"the rings lie {apart:.3f} mm RMS from one common wall"
    means = "The rig's calibration is not this sensor's: depths are off by so much from ring to ring, and edges shift."
    return finding("rings", "agreement", says, apart > WEAK_APART_MM, apart > BAD_APART_MM, means)


def _noise(watched: Watched) -> Finding:
    scale = _noise_scale(watched)
    says = "not stated by this registration" if np.isnan(scale) else f"points scatter {scale:.2f} times what they state"
    means = "The points are worse than they say of themselves: wrong slits, a rough slide, or a rig that does not fit."
    return finding("rings", "scatter", says, scale > 3, scale > 10, means)


def _way(watched: Watched) -> Finding:
    """The way by the wheels, held against what the rings see again of the wall."""
    told, turned = way(watched.travel.told), way(watched.travel.turned)
    means = "Distances and lengths are off by as much: wheels slip, their diameter is another, or stamps do not fit."
    if not np.isfinite(told.std):
        reversed_ = turned.std < SURE and abs(turned.more) < 0.2
        says = (
            "the rings see the wall the other way round" if reversed_ else "the wall shows nothing to hold it against"
        )
        return finding("rings", "way by the wheels", says, reversed_, reversed_, "The wheels' direction is wrong.")
    says = f"{100 * told.more:+.1f} ± {100 * told.std:.1f} % more than the rings see"
    off = abs(told.more) - 3 * told.std
    return finding("rings", "way by the wheels", says, off > 0.005, off > 0.03, means)


def _inward(found: Reconstruction) -> Finding:
    scanned = lines(found.deviation_mm[:, found.wall.scanned()])
    every = np.array([(np.isfinite(line).sum(), (line < -INWARD_MM).sum()) for (line,) in scanned])
    seen, inward = every.T
    share = float(inward.sum() / seen.sum()) if seen.any() else 0.0
    where = ""
    if inward.any():
        middle = np.angle(np.sum(inward * np.exp(1j * found.wall.theta_rad)))
        where = f", about {np.degrees(middle) % 360:.0f} degrees clockwise from 12 o'clock"
    says = f"{100 * share:.1f} % of the seen wall stands in by more than {INWARD_MM:g} mm{where}"
    means = "Water, debris, a dent or false slits lie before the wall; what is under them is not measured."
    return finding("rings", "wall standing in", says, share > INWARD_SHARE, share > 0.3, means)
