"""What the motors are told, and what is wrong with them: profiles of motion, stops on the way, stalls."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from jaxtyping import Float
from pydantic import Field

from sensor_model.settings import Settings
from twin.robot import Robot
from twin.robot_model import MM, STEP_S, motor_names

HOLD_PER_S = 5.0  # share of a missing roll that is made up for in a second


class RollStage(Settings):
    """A turn about the pipe's axis by the end wheels: from when, for how long, how fast; clockwise seen along +z."""

    start_s: Annotated[float, Field(ge=0)]
    duration_s: Annotated[float, Field(gt=0)]
    rate_deg_s: Annotated[float, Field(ge=-180, le=180)]


class RollTo(Settings):
    """A roll to go to by the end wheels, which then hold it: clockwise seen along +z, 0 as the robot stands level."""

    start_s: Annotated[float, Field(ge=0)]
    to_deg: Annotated[float, Field(ge=-350, le=350)]
    rate_deg_s: Annotated[float, Field(gt=0, le=180)] = 20.0


class Via(Settings):
    """A place to stop at on the way, and for how long; behind the last place, the robot reverses to it."""

    to_mm: float
    dwell_s: Annotated[float, Field(ge=0, le=60)] = 0.5


class MotorFault(Settings):
    """One leg's motor fails for a while.

    `stalled` holds its wheels still, as a 603:1 gear does that nothing turns; the motor then goes on from where it
    stands. `weak` leaves it `torque_pct` of its torque.
    """

    leg: Annotated[int, Field(ge=0, lt=6)]
    start_s: Annotated[float, Field(ge=0)]
    duration_s: Annotated[float, Field(gt=0)]
    kind: Literal["stalled", "weak"] = "stalled"
    torque_pct: Annotated[float, Field(ge=0, le=100)] = 20.0

    @property
    def end_s(self) -> float:
        """When it is over."""
        return self.start_s + self.duration_s


def motor_controls(
    robot: Robot,
    bore_radius_mm: float,
    places_mm: Sequence[float],
    dwells_s: Sequence[float],
    speed_mm_s: float,
    ramp_s: float,
    roll: Sequence[RollStage | RollTo],
    faults: Sequence[MotorFault],
    feed_forward_s: float,
) -> Float[np.ndarray, "n motors"]:
    """What every motor is told at every step: its angle and, fed forward, its rate.

    The legs take the robot from place to place and let it stand at each but the first for its dwell; the end wheels
    turn it meanwhile. Wheels and bore are taken to have their nominal sizes.
    """
    legs = list(pairwise(places_mm))
    spans = [_move_s(abs(b - a), speed_mm_s, ramp_s) for a, b in legs]
    turns = list(_turns(roll))
    roll_end = max((start_s + duration_s + ramp_s for start_s, duration_s, _ in turns), default=0.0)
    driven = sum(move for _, move in spans) + sum(dwells_s[:-1])
    time = STEP_S * np.arange(round((max(driven, roll_end) + dwells_s[-1]) / STEP_S) + 1)

    way, rate, start_s = np.zeros_like(time), np.zeros_like(time), 0.0
    for (a, b), (ramp, move), dwell in zip(legs, spans, dwells_s, strict=True):
        distance, speed = _smooth_move(time, start_s, move, ramp)
        way += np.sign(b - a) * distance
        rate += np.sign(b - a) * speed
        start_s += move + dwell
    leg = [_faulty(time, way, rate, [f for f in faults if f.leg == k]) for k in range(robot.leg_count)]
    end = np.zeros_like(time)
    for start_s, duration_s, rate_deg_s in turns:
        turned, turning = _smooth_move(time, start_s, duration_s + ramp_s, ramp_s)
        rim = np.radians(rate_deg_s) * bore_radius_mm / robot.end_wheel_radius_mm
        end += rim * (turned + feed_forward_s * turning)
    told = [speed_mm_s * (way + feed_forward_s * rate) / robot.wheel_radius_mm for way, rate in leg]
    return np.column_stack(told + [end] * (len(motor_names(robot)) - robot.leg_count))


class RollHold:
    """Holds the roll that is asked for: what the end wheels turn too little or too much is made up for.

    The robot stands below the pipe's axis and its wheels slide a little, so that turning them by what the bore says
    rolls it some 6 % too far. The roll is taken as the twin knows it: an attitude control without errors.
    """

    def __init__(self, roll: Sequence[RollTo], steps: int, ramp_s: float, rim_per_roll: float, feed_forward_s: float):
        time = STEP_S * np.arange(steps)
        asked = np.zeros(steps)
        for start_s, duration_s, rate_deg_s in _turns(roll):
            asked += np.radians(rate_deg_s) * _smooth_move(time, start_s, duration_s + ramp_s, ramp_s)[0]
        self._asked_rad, self._rim, self._ahead_s = asked.tolist(), rim_per_roll, feed_forward_s
        self._made_up_rad = 0.0

    def more_rad(self, i: int, roll_rad: float) -> float:
        """By how much to turn the end wheels further than planned at step i."""
        missing = self._asked_rad[i] - roll_rad
        self._made_up_rad += HOLD_PER_S * STEP_S * missing
        return self._rim * (self._made_up_rad + self._ahead_s * HOLD_PER_S * missing)


def _turns(roll: Sequence[RollStage | RollTo]) -> Iterator[tuple[float, float, float]]:
    """When each turn starts, how long it takes and how fast it is."""
    at_deg = 0.0
    for stage in roll:
        if isinstance(stage, RollStage):
            yield stage.start_s, stage.duration_s, stage.rate_deg_s
        elif stage.to_deg != at_deg:
            way_deg, at_deg = stage.to_deg - at_deg, stage.to_deg
            yield stage.start_s, abs(way_deg) / stage.rate_deg_s, float(np.sign(way_deg)) * stage.rate_deg_s


def torque_limits_n_m(robot: Robot, faults: Sequence[MotorFault], steps: int) -> dict[int, Float[np.ndarray, "motors"]]:
    """The motors' torque limits by the step from which on they hold."""
    full = np.full(len(motor_names(robot)), MM * robot.motor_torque_limit_n_mm)
    weak = [fault for fault in faults if fault.kind == "weak"]
    changes = {0, *(round(t / STEP_S) for fault in weak for t in (fault.start_s, fault.end_s))}
    limits = {}
    for step in sorted(change for change in changes if change < steps):
        limits[step] = full.copy()
        for fault in weak:
            if round(fault.start_s / STEP_S) <= step < round(fault.end_s / STEP_S):
                limits[step][fault.leg] *= fault.torque_pct / 100
    return limits


def torque_share(robot: Robot, spin_rad_s: Float[np.ndarray, "motors"]) -> Float[np.ndarray, "motors"]:
    """What is left of each motor's torque limit at its speed, by the straight line of a direct-current motor."""
    supply = robot.supply_pct / 100
    if robot.motor_no_load_turns_s is None:
        return np.full(spin_rad_s.size, supply)
    return np.clip(supply - np.abs(spin_rad_s) / (2 * np.pi * robot.motor_no_load_turns_s), 0.0, None)


def _move_s(travel_mm: float, speed_mm_s: float, ramp_s: float) -> tuple[float, float]:
    """Ramp and whole duration of one move, s."""
    ramp = min(ramp_s, max(travel_mm / speed_mm_s, STEP_S))
    return ramp, travel_mm / speed_mm_s - ramp + 2 * ramp


def _faulty(
    time: np.ndarray, way: np.ndarray, rate: np.ndarray, faults: Sequence[MotorFault]
) -> tuple[np.ndarray, np.ndarray]:
    """Way and speed of a motor that stands still while it is stalled, and then goes on from there."""
    for fault in faults:
        if fault.kind == "stalled":
            first, last = np.searchsorted(time, [fault.start_s, fault.end_s])
            held, rate = way[min(first, time.size - 1)], rate.copy()
            missed = way[min(last, time.size - 1)] - held
            way = np.concatenate([way[:first], np.full(last - first, held), way[last:] - missed])
            rate[first:last] = 0.0
    return way, rate


def _smooth_move(time: np.ndarray, start_s: float, duration_s: float, ramp_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Way and speed of a move at unit speed whose speed rises and falls smoothly (3 u^2 - 2 u^3) over `ramp_s`."""

    def risen(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        u = np.clip(t / ramp_s, 0, 1)
        return ramp_s * (u**3 - u**4 / 2) + np.maximum(t - ramp_s, 0), u * u * (3 - 2 * u)

    up, down = risen(time - start_s), risen(time - start_s - duration_s + ramp_s)
    return up[0] - down[0], up[1] - down[1]
