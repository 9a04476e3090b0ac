"""What the robot's physics costs, part by part, and how far its encoders are from its travel."""

from __future__ import annotations

import time

import numpy as np

import twin.drives.robot as robot_drive
from twin.drives.robot import STEP_S, RobotDrive, simulate_motion, truth_of
from twin.features.pocket import Pocket
from twin.pipe import Pipe
from twin.robot import Robot, draw_build
from twin.robot_model import wheel_shapes
from twin.wheel_contact import wheel_contacts

SCENES = {"plain": None, "pockets at 4:00": "4:00", "pockets at 6:00": "6:00"}
DRIVE = RobotDrive(end_mm=667.0)


def pipe(clock: str | None) -> Pipe:
    """The paper's pipe, its two pockets at a clock position."""
    pockets = [
        Pocket(distance_mm=z, clock_deg=clock, depth_mm=7.5, length_mm=70, width_mm=35) for z in (285, 485) if clock
    ]
    return Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, features=tuple(pockets))


def kernel_us(scene: Pipe, robot: Robot) -> float:
    """One call of the contact kernel for eight wheels on the plain wall, microseconds."""
    angles = np.radians([60, 60, 180, 180, 300, 300, 180, 180])
    hub = np.column_stack([57.25 * np.sin(angles), -57.25 * np.cos(angles), np.zeros(8)])
    axle = np.cross([0.0, 0.0, 1.0], hub / 57.25)
    shapes, still = wheel_shapes(robot, draw_build(robot, np.random.default_rng(0))), np.zeros(8)
    wheel_contacts(scene.wall, hub, axle, still, shapes)
    begin = time.perf_counter()
    for _ in range(2000):
        wheel_contacts(scene.wall, hub, axle, still, shapes)
    return (time.perf_counter() - begin) / 2000 * 1e6


def step_us(scene: Pipe) -> float:
    """Median time of a step of a short drive, wheels, contacts and log together, microseconds."""
    times: list[float] = []
    step = robot_drive.step

    def timed(*args: object) -> None:
        step(*args)
        times.append(time.perf_counter())

    robot_drive.step = timed
    try:
        simulate_motion(scene, Robot(), RobotDrive(end_mm=300.0), np.random.default_rng(0))
    finally:
        robot_drive.step = step
    return float(np.median(np.diff(times[2000:]))) * 1e6


def by_length() -> None:
    """The same drive past the same pockets in a short pipe and in a long one with many more."""
    print(f"{'pipe':<30} {'us/step':>8} {'x real, one core':>17}")
    for metres in (1, 10, 50):
        pockets = [
            Pocket(distance_mm=250.0 * k + 200, clock_deg="4:00", depth_mm=4, length_mm=40, width_mm=30)
            for k in range(4 * metres)
        ]
        end_mm = max(1000.0 * metres, 900.0)
        scene = Pipe(inner_radius_mm=76.2, wall_thickness_mm=7.5, end_mm=end_mm, features=tuple(pockets))
        spent = min(step_us(scene) for _ in range(3))
        print(f"{f'{metres} m, {len(pockets)} pockets':<30} {spent:8.1f} {1e6 * STEP_S / spent:17.1f}")


def main() -> None:
    """Print one line a scene; run it on an idle machine."""
    robot = Robot()
    simulate_motion(pipe("4:00"), robot, RobotDrive(end_mm=5.0), np.random.default_rng(0))  # compiles
    print(f"contact kernel, 8 wheels: {kernel_us(pipe(None), robot):.0f} us")
    by_length()
    columns = f"{'us/step':>8} {'x real':>7} {'rolled/travel':>14} {'sag mm':>7} {'tilt deg':>9} {'roll deg':>9}"
    print(f"{'scene':<16} {columns}")
    for name, clock in SCENES.items():
        begin = time.perf_counter()
        motion = simulate_motion(pipe(clock), robot, DRIVE, np.random.default_rng(0))
        spent = time.perf_counter() - begin
        truth = truth_of(pipe(clock), robot, motion)
        steps = truth.time_s.size
        travel = np.ptp(truth.position_mm[[0, -1], 2])
        error_pct = 100 * (np.median(truth.wheel_angle_rad[-1]) * robot.wheel_radius_mm / travel - 1)
        w, x, y, z = truth.q_pipe_camera_wxyz.T
        tilt_deg = np.degrees(2 * np.arcsin(np.hypot(x, y))).max()
        roll_deg = np.degrees(2 * np.arctan2(z, w))[-1]
        sag_mm = truth.position_mm[:, 1].max()
        print(
            f"{name:<16} {spent / steps * 1e6:8.0f} {steps * STEP_S / spent:7.1f} {error_pct:+12.3f} % "
            f"{sag_mm:7.2f} {tilt_deg:9.3f} {roll_deg:+9.2f}"
        )


if __name__ == "__main__":
    main()
