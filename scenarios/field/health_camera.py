"""The camera: unreadable, repeated and badly exposed pictures, blind sectors, missing slits, swapped colours."""

from __future__ import annotations

from collections import Counter

import numpy as np
from jaxtyping import Bool

from algorithms.decode import decode
from algorithms.localisation.wheels import wheel_distances_mm
from algorithms.method import Method
from scenarios.field.finding import Finding, finding
from scenarios.field.look import SECTORS, Watched
from sensor_model.geometry import clock_position
from sensor_model.recording import BadRecording, Recording

MOVED_MM = 0.3
BLIND_SHARE = 0.3  # of what a usual sector or slit shows
LOST_SHARE = 0.5  # of a usual frame's slits
LOW_YIELD = 0.6
TRIED = 3


def camera_findings(recording: Recording, method: Method, watched: Watched) -> list[Finding]:
    """What the frames show."""
    return [
        _unreadable(watched),
        _repeated(recording, watched),
        *_exposure(watched),
        _yield_over_time(recording, watched),
        _blind(recording, watched),
        _slits(recording, watched),
        *_colors(recording, method),
    ]


def _unreadable(watched: Watched) -> Finding:
    faults = [fault for fault in watched.fault if fault]
    share = len(faults) / len(watched.fault)
    says = f"{len(faults)} of {len(watched.fault)} frames" + (
        f", the first: {_without_folder(faults[0])}" if faults else ""
    )
    means = "A frame that cannot be read shows nothing; its stretch of the wall rests on its neighbours."
    return finding("camera", "unreadable frames", says, share > 0, share > 0.1, means)


def _without_folder(fault: str) -> str:
    """The fault without the path of a folder that is gone by the time it is read."""
    return fault[fault.find("cam0/") :].split(", named in")[0] if "cam0/" in fault else fault


def _repeated(recording: Recording, watched: Watched) -> Finding:
    rolled = wheel_distances_mm(np.array([recording.frame(k).counts for k in range(len(recording))]), recording.rig)
    moved = np.abs(np.diff(np.median(rolled, axis=1))) > MOVED_MM
    same = np.array(
        [bool(a) and a == b for a, b in zip(watched.digest[:-1], watched.digest[1:], strict=True)], dtype=bool
    )
    count, share = int((same & moved).sum()), float((same & moved).mean()) if moved.size else 0.0
    says = f"{count} of {len(watched.digest)} frames show what the one before showed, though the wheels turned"
    means = "The camera stood still while the robot went on: what was not looked at is not measured, and places smear."
    return finding("camera", "repeated frames", says, count > 0, share > 0.1, means)


def _exposure(watched: Watched) -> list[Finding]:
    level, full, black = np.array(watched.exposure).T
    shown = np.isfinite(level)
    if not shown.any():
        return []
    usual = float(np.median(level[shown]))
    lit = max(float(np.median(1 - black[shown])), 1e-6)
    glare = float(np.median(full[shown]) / lit)
    dim = shown & (level < 0.5 * usual)
    glaring = shown & (full > np.maximum(4 * np.median(full[shown]), 0.05))
    odd = int((dim | glaring).sum())
    return [
        finding(
            "camera",
            "exposure",
            f"mean level {100 * usual:.0f} %, {100 * glare:.1f} % of the lit pixels are full",
            usual < 0.03 or glare > 0.1,
            usual < 0.01 or glare > 0.4,
            "Full or black pixels have no colour to read a slit's code from, and edges shift: fewer and worse points.",
        ),
        finding(
            "camera",
            "even light",
            f"{int(dim.sum())} frames much darker than usual, {int(glaring.sum())} much brighter",
            odd > 0,
            odd > 0.1 * shown.sum(),
            "The light or the exposure failed there; these frames show little.",
        ),
    ]


def _yield_over_time(recording: Recording, watched: Watched) -> Finding:
    share = np.array(watched.slits).mean(axis=1)
    usual = float(np.median(share))
    poor = share < LOST_SHARE * usual
    at_s = (recording.frame_stamps_ns - recording.frame_stamps_ns[0]) / 1e9
    where = f", from {at_s[poor][0]:.1f} to {at_s[poor][-1]:.1f} s" if poor.any() else ""
    few = f"{int(poor.sum())} frames have half of it or less{where}"
    says = f"{100 * usual:.0f} % of slits and azimuths in the middle frame; {few}"
    means = (
        "Little light came back: the pipe's end, water, dirt, or a lamp that failed; the wall there is thinly measured."
    )
    low = usual < LOW_YIELD
    return finding("camera", "decode yield", says, low or bool(poor.any()), usual < 0.3 or poor.mean() > 0.2, means)


def _blind(recording: Recording, watched: Watched) -> Finding:
    """Sectors of the picture that hardly ever show a slit, the strut's apart."""
    seen = watched.sectors / len(watched.digest)
    blind = (seen < BLIND_SHARE * np.median(seen)) & ~_strut(recording)
    middles = (np.flatnonzero(blind) + 0.5) * 2 * np.pi / SECTORS
    says = f"{blind.sum() * 360 / SECTORS:.0f} degrees of the picture"
    says += (
        f", about {clock_position(float(np.angle(np.exp(1j * middles).mean()) % (2 * np.pi)))}" if blind.any() else ""
    )
    means = "One part of every picture shows nothing: dirt, or something in the way. A defect there would be missed."
    return finding("camera", "blind sectors", says, bool(blind.any()), blind.sum() * 360 / SECTORS > 45, means)


def _strut(recording: Recording) -> Bool[np.ndarray, "sectors"]:
    """Sectors that the strut touches."""
    projector = recording.rig.projector
    middle_deg = (np.arange(SECTORS) + 0.5) * 360 / SECTORS
    off = np.abs((middle_deg - projector.strut_clock_deg + 180) % 360 - 180)
    return off < projector.strut_width_deg / 2 + projector.strut_softness_deg + 2 * 360 / SECTORS


def _slits(recording: Recording, watched: Watched) -> Finding:
    """Slits that are hardly ever found; the outermost may lie beyond the picture's edge."""
    seen = np.array(watched.slits).mean(axis=0)
    inner = seen[:-1] if seen.size > 2 else seen
    missing = [
        recording.rig.projector.slits[k].name for k in np.flatnonzero(inner < BLIND_SHARE * max(np.median(inner), 0.3))
    ]
    says = f"{', '.join(missing)} hardly ever found" if missing else "every slit found"
    means = (
        "With slits missing the map is thinner and steep floors stay dark; a lamp, a filter or the rig may be wrong."
    )
    return finding("camera", "slits", says, bool(missing), len(missing) > inner.size / 2, means)


def _colors(recording: Recording, method: Method) -> list[Finding]:
    """Whether the pictures' slits are better read with red and blue swapped."""
    chosen = np.unique(np.linspace(0, len(recording) - 1, TRIED).round().astype(int)).tolist()
    found: Counter[str] = Counter()
    for index in chosen:
        try:
            picture = recording[index].picture
        except (BadRecording, OSError):
            continue
        if picture is None:
            return []
        found["as is"] += decode(picture, recording.rig, method.decode).slit.size
        found["swapped"] += decode(np.ascontiguousarray(picture[:, :, ::-1]), recording.rig, method.decode).slit.size
    swapped = found["swapped"] > 1.2 * found["as is"]
    says = f"{found['as is']} slit points read in {len(chosen)} frames, {found['swapped']} with red and blue swapped"
    means = "The pictures' red and blue are swapped: slits are taken for others, and every point is wrong."
    return [finding("camera", "colours", says, swapped, swapped, means)]
