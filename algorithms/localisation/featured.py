"""The fused estimator, which also finds its way by the wall: what one ring saw is seen again by the next ones.

The rings land a known way apart, so a feature of the wall that passes under them is a rule of about 100 mm against
which the wheels are measured; and a joint whose place is written down ties the distance to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from algorithms.hindsight import moved
from algorithms.localisation import fused
from algorithms.localisation.fused import FilterSettings, Fused, corrected
from algorithms.localisation.fused_model import ROLL, S
from algorithms.localisation.joints import joint_mm
from algorithms.localisation.lags import REACH, lag_about_bins, lag_along_mm
from algorithms.localisation.marks import POSE, Sight, let_go, mark_pose, mark_tile, place, sight, tile_mark
from algorithms.localisation.ring_profiles import BINS, RingProfiles, add_frame, front_mm, profile, shift
from algorithms.types import Alignment, Episode, LookedBack, RingPoints
from sensor_model.recording import Frame, NominalPipe
from sensor_model.rig import Rig

TILE_MM = 40.0
KEEP_MM = 260.0  # frames are kept for so long a way: from the first ring's sight of a tile to the last one's
POSE_MM = 10.0  # the path is marked in such steps while there is something to see
POSES_MM = 120.0  # and the marks are kept for so long
BORDER_MM = 5.0  # a tile is compared with so much of its neighbours, lest an edge on its border be cut
LEAP_MM = 4.0
ALL_TILES = 2**62
JOINT_MM = 12.0  # a joint's half width, at most
FEWEST_BINS = 8
GATE = 9.0  # sigmas squared that a lag may lie off before it is taken for a mistake
JOINT_GATE = 25.0  # the same of a joint, which is not easily mistaken
BIN_RAD = 2 * np.pi / BINS


class FeaturedSettings(FilterSettings):
    """The filter's settings, and from what height on the wall shows something.

    A lag between profiles is trusted to `lag_std_mm`, and to a share of the way between two frames, whatever its fit.
    """

    kind: Literal["featured"] = "featured"
    feature_mm: Annotated[float, Field(gt=0.1, le=5)] = 0.4
    noise_mm: Annotated[float, Field(gt=0)] = 0.1
    lag_std_mm: Annotated[float, Field(gt=0)] = 0.05
    lag_std_share: Annotated[float, Field(ge=0, le=1)] = 0.02
    about_std_deg: Annotated[float, Field(gt=0)] = 0.5


@dataclass(frozen=True)
class Featured:
    """The filter, and what the rings have seen; the latter is shared by the states of one log, and only goes on.

    `compared` holds which ring was compared in which tile, `references` which ring saw a tile first, `tied` where a
    joint of the list was found.
    """

    filter: Fused
    seen: RingProfiles
    pipe: NominalPipe
    compared: set[tuple[int, int]]
    references: dict[int, int]
    tied: tuple[Episode, ...] = ()


def launch(
    frame: Frame, rig: Rig, pipe: NominalPipe, axis_camera: Float[np.ndarray, "3"], settings: FeaturedSettings
) -> Featured:
    """The start of the log; nothing was seen yet."""
    state = fused.launch(frame, rig, pipe, axis_camera, settings)
    return Featured(state, RingProfiles(len(rig.projector.slits)), pipe, set(), {})


def advance(before: Featured, frame: Frame, rig: Rig, settings: FeaturedSettings) -> Featured:
    """One frame on by wheels and IMU."""
    return replace(before, filter=fused.advance(before.filter, frame, rig, settings))


def predict(state: Featured) -> Alignment:
    """The prior of a frame."""
    return fused.predict(state.filter)


def settle(state: Featured, alignment: Alignment) -> Featured:
    """Remember the pipe's axis and the centre."""
    return replace(state, filter=fused.settle(state.filter, alignment))


def look(
    state: Featured, points: RingPoints, alignment: Alignment, settings: FeaturedSettings
) -> tuple[Featured, Alignment]:
    """What the wall shows: each ring's profile of a tile is compared with the first ring's, joints with the list."""
    if not add_frame(state.seen, points, alignment, KEEP_MM) or not state.seen.frames:
        return state, alignment
    before, fronts, step = state.filter, front_mm(state.seen), _step_mm(state)
    poses = [mark.at_mm for mark in before.marks if mark.kind == POSE]
    if _in_view(state, settings) and (not poses or before.x[S] - poses[-1] >= POSE_MM):
        state = replace(state, filter=mark_pose(before))
    passed = ((fronts - REACH - BORDER_MM - step) // TILE_MM - 1)[np.isfinite(fronts)].astype(np.int64)
    information = 0.0
    for ring, last in zip(np.flatnonzero(np.isfinite(fronts)).tolist(), passed.tolist(), strict=True):
        for number in (last - 1, last):
            state, gained = _compare(state, number, ring, step, settings)
            information += gained
    first = int(passed.min()) - 1 if passed.size else 0
    leap_mm = float(state.filter.x[S] - before.x[S])
    state = _in_new_places(state, leap_mm, fronts, step)
    state.compared.intersection_update({one for one in state.compared if one[0] >= first})
    kept_from = float(state.filter.x[S]) - POSES_MM
    leapt = abs(leap_mm) >= LEAP_MM
    state = replace(state, filter=let_go(state.filter, kept_from, ALL_TILES if leapt else first))
    return state, _realigned(alignment, before, state.filter, information)


def _in_new_places(state: Featured, moved_mm: float, fronts_mm: np.ndarray, step_mm: float) -> Featured:
    """What was seen, moved with a distance that has been corrected; after a leap the tiles begin anew."""
    shift(state.seen, moved_mm)
    marks = tuple(replace(mark, at_mm=mark.at_mm + moved_mm) for mark in state.filter.marks)
    state = replace(state, filter=replace(state.filter, marks=marks))
    if abs(moved_mm) < LEAP_MM:
        return state
    state.compared.clear()
    state.references.clear()
    for ring in np.flatnonzero(np.isfinite(fronts_mm)).tolist():
        last = int((fronts_mm[ring] + moved_mm - REACH - BORDER_MM - step_mm) // TILE_MM)
        state.compared.update((number, ring) for number in (last - 2, last - 1, last))
    return state


def _in_view(state: Featured, settings: FeaturedSettings) -> bool:
    """Whether some ring sees more than bare wall."""
    height = state.seen.frames[-1][2]
    return bool((np.count_nonzero(np.abs(height) > settings.feature_mm, axis=1) >= FEWEST_BINS).any())


def _step_mm(state: Featured) -> float:
    """Way between the last frames."""
    at = [frame[0] for frame in state.seen.frames[-5:]]
    return float(np.median(np.diff(at))) if len(at) > 1 else 1.0


def _compare(
    state: Featured, number: int, ring: int, step_mm: float, settings: FeaturedSettings
) -> tuple[Featured, float]:
    """One ring's sight of one tile that it has passed, and the information on distance that it gave."""
    if (number, ring) in state.compared:
        return state, 0.0
    state.compared.add((number, ring))
    low = number * TILE_MM
    own, cameras = profile(state.seen, ring, low - BORDER_MM, low + TILE_MM + BORDER_MM)
    high = np.abs(own.height_mm) > settings.feature_mm
    if np.count_nonzero(high.any(axis=0)) < FEWEST_BINS:
        return state, 0.0
    camera = float(np.average(cameras, weights=np.count_nonzero(high, axis=1))) - state.filter.launch_mm
    seen_from = sight(state.filter, camera)
    if seen_from is None:
        return state, 0.0
    std = float(np.hypot(settings.lag_std_mm, settings.lag_std_share * step_mm))
    k = tile_mark(state.filter, number)
    gained = 0.0
    if k is not None:
        about = np.radians(settings.about_std_deg)
        state, gained = _match(state, k, ring, low, seen_from, np.array([std, about]), step_mm, settings)
    wide, _ = profile(state.seen, ring, low - JOINT_MM, low + TILE_MM + JOINT_MM)
    found = joint_mm(wide, settings.feature_mm)
    if found is not None and low <= found < low + TILE_MM:
        state, tied = _tie(state, found, seen_from, std)
        gained += tied
    if k is None:
        about = np.radians(settings.about_std_deg)
        filtered = mark_tile(state.filter, number, seen_from, np.array([std, about]))
        state = replace(state, filter=filtered)
        state.references[number] = ring
    return state, gained


def _match(
    state: Featured,
    k: int,
    ring: int,
    low_mm: float,
    seen_from: Sight,
    std: Float[np.ndarray, "2"],
    step_mm: float,
    settings: FeaturedSettings,
) -> tuple[Featured, float]:
    """Take in how far a ring's profile of a tile lies from the first ring's: the robot went so much less."""
    mark, gap = state.filter.marks[k], 1.7 * step_mm + 1.0
    more = BORDER_MM + REACH + gap
    reference, own = (
        profile(state.seen, one, low_mm - more, low_mm + TILE_MM + more)[0]
        for one in (state.references[mark.number], ring)
    )
    span = (low_mm - BORDER_MM, low_mm + TILE_MM + BORDER_MM)
    along = lag_along_mm(reference, own, span, gap, settings.noise_mm)
    if not np.isfinite(along.std):
        return state, 0.0
    about = lag_about_bins(reference, own, span, gap, settings.noise_mm, along.lag)
    lags, spread = np.array([along.lag, BIN_RAD * about.lag]), np.array([along.std, BIN_RAD * about.std])
    rows = np.array(seen_from.rows)
    rows[:, place(state.filter, k) : place(state.filter, k) + 2] -= np.eye(2)
    seen = np.array([seen_from.at_mm - mark.at_mm, seen_from.roll_rad - mark.roll_rad]) - lags
    gained = 0.0
    for axis in (0, 1):
        if np.isfinite(spread[axis]):
            variance = spread[axis] ** 2 + std[axis] ** 2
            state, taken = _taken(state, float(seen[axis]), rows[axis], variance, GATE)
            gained += taken * (axis == 0) / variance
    return state, gained


def _tie(state: Featured, found_mm: float, seen_from: Sight, std: float) -> tuple[Featured, float]:
    """Tie the distance to the joint of the list that is near, if just one is."""
    joints = np.array(state.pipe.joints_mm)
    rows, P = seen_from.rows[0], state.filter.P
    allowed = np.sqrt(JOINT_GATE * float(rows @ P @ rows)) + JOINT_MM
    near = joints[np.abs(joints - found_mm) < allowed]
    if near.size != 1:
        return state, 0.0
    variance = std**2 + state.pipe.joints_std_mm**2
    seen = seen_from.at_mm - (found_mm - float(near[0]))
    state, taken = _taken(state, seen, rows, variance, JOINT_GATE)
    if taken:
        stamp, moved_mm = state.filter.stamp_ns, float(near[0]) - found_mm
        state = replace(state, tied=_noted(state.tied, f"joint at {near[0]:g} mm", stamp, moved_mm))
    return state, taken / variance


def _noted(tied: tuple[Episode, ...], joint: str, stamp_ns: int, moved_mm: float) -> tuple[Episode, ...]:
    """One more sight of a joint: the rings that pass it one after the other are one episode."""
    if tied and tied[-1].who == joint:
        return (*tied[:-1], replace(tied[-1], end_ns=stamp_ns, amount=tied[-1].amount + moved_mm))
    return (*tied, Episode("joint", joint, stamp_ns, stamp_ns, moved_mm))


def _taken(
    state: Featured, seen: float, row: Float[np.ndarray, "n"], variance: float, gate: float
) -> tuple[Featured, bool]:
    """A sighting taken into the filter, unless it lies too far off to be one."""
    x, P = state.filter.x, state.filter.P
    row = np.append(row, np.zeros(x.size - row.size))  # marks were added since
    if (seen - row @ x) ** 2 > gate * (row @ P @ row + variance):
        return state, False
    x, P = corrected(x, P, np.array([seen]), row[None, :], np.array([variance]))
    return replace(state, filter=replace(state.filter, x=x, P=P)), True


def _realigned(alignment: Alignment, before: Fused, after: Fused, information: float) -> Alignment:
    """The frame's pose moved to where the filter now has it."""
    both = [S, ROLL]
    move = after.x[both] - before.x[both]
    if not move.any():
        return alignment
    evidence = alignment.evidence if alignment.evidence is None else alignment.evidence.copy()
    if evidence is not None:
        evidence[2, 2] += information
    shifted = moved(alignment, float(move[0]), float(move[1]), after.P[np.ix_(both, both)])
    return replace(shifted, evidence=evidence)


def look_back(state: Featured) -> LookedBack:
    """The whole path by what came before and after each frame."""
    return fused.look_back(state.filter)


def episodes(state: Featured) -> tuple[Episode, ...]:
    """Slips, silences, and the joints that the distance was tied to."""
    return fused.episodes(state.filter) + state.tied
