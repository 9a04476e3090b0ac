"""Eqs 11 to 27 on turns and wheels whose answer is known: hand-eye calibration, roll by the IMU, odometry, slip."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from scenarios.paper.checked import Found, difference, named, verdict
from sensor_model.recording import Frame, NominalPipe
from sensor_model.rig import Rig, preset_rig

TURN_DEG = 25.0  # the paper's roll between two defects
ROUNDING = 1e-9
HAND_EYE = "algorithms.calibration.hand_eye"
LEFT = "R_cal R_m R_cal^T"


def _turns(count: int = 200) -> tuple[Rotation, Rotation]:
    """A mount R_cal, and turns R_m of the IMU."""
    rng = np.random.default_rng(4)
    return Rotation.from_rotvec([0.3, -0.5, 1.2]), Rotation.from_rotvec(rng.normal(0, 0.3, (count, 3)))


def _frame(attitude: Rotation, counts: list[float], stamp_ns: int, rig: Rig) -> Frame:
    """A frame that says an attitude of the camera and wheel counts, and nothing else."""
    q = (attitude * Rotation.from_matrix(rig.imu.R_camera_imu)).as_quat(canonical=True)
    none = np.zeros(0, dtype=np.int64)
    return Frame(0, stamp_ns, None, None, q[[3, 0, 1, 2]], np.array(counts, dtype=float), none, np.zeros((0, 6)))


def eq11() -> Found:
    """The camera's turn between two board poses carries a board point's first place to its second."""
    _, imu = _turns()
    board = imu
    _, camera = named(f"{HAND_EYE}:_relative")(imu, board, "absolute")
    point = np.array([10.0, 20.0, 300.0])
    printed = camera.apply(board[0].apply(point))
    return difference(np.abs(printed - board[1:].apply(point)).max(), "mm", ROUNDING)


def _mount_error_deg(printed: str) -> float:
    """How far off the true mount our fit ends, when the camera turned as an equation says."""
    mount, imu = _turns()
    camera = mount * imu * mount.inv() if printed == LEFT else mount.inv() * imu * mount
    found = named(f"{HAND_EYE}:_aligned")(imu, camera)
    return float(np.degrees((found * mount.inv()).magnitude()))


def eq12() -> Found:
    """The mount found from turns that follow Eq. 12 with 13 put in."""
    off = _mount_error_deg(LEFT)
    return Found(f"mount found to {off:.1e} deg", verdict(off < 1e-5))


def eq14() -> Found:
    """The mount found from turns that follow 14 and 15: they say something else than 12 and 13."""
    off = _mount_error_deg("R_cal^T R_m R_cal")
    return Found(f"with {LEFT}, as 12 and 13 have it, off by {off:.0f} deg", "does not follow from 12 and 13")


def eq16() -> Found:
    """The attitude of a lagging log that is paired with each pose."""
    times = np.arange(30)
    imu = Rotation.from_rotvec(np.outer(times, [0.0, 0.0, 0.01]))
    paired = named(f"{HAND_EYE}:_at")(imu, 10, 20, 2.5)
    late = Rotation.from_rotvec(np.outer(times[10:] - 2.5, [0.0, 0.0, 0.01]))
    return difference(np.degrees((paired.inv() * late).magnitude().max()), "deg", 1e-6)


def eq18() -> Found:
    """How badly the null-space way is posed, and what a little noise leaves of it."""
    mount, imu = _turns()
    camera = mount * imu * mount.inv()
    null_space = named(f"{HAND_EYE}:null_space")
    _, clean = null_space(imu, camera)
    noise = Rotation.from_rotvec(np.random.default_rng(5).normal(0, 0.01, (len(imu), 3)))
    matrix, noisy = null_space(imu, noise * camera)
    off = np.linalg.norm(matrix.T @ matrix - np.eye(3))
    said = f"condition {clean:.1e}, with 0.01 rad of noise {noisy:.0f}; its matrix is off a rotation by {off:.2f}"
    return Found(said, "ill-posed, as printed" if clean > 1e10 and off > 0.1 else verdict(False))


def eq19() -> Found:
    """Turns between neighbours against the printed product, as the camera sees them."""
    _, board = _turns()
    _, turn = named(f"{HAND_EYE}:_relative")(board, board, "consecutive")
    printed = [board[i + 1].as_matrix() @ board[i].as_matrix().T for i in range(len(board) - 1)]
    return difference(np.abs(turn.as_matrix() - printed).max(), "", 1e-12)


def eq20() -> Found:
    """Turns since the first against the printed product."""
    _, board = _turns()
    _, turn = named(f"{HAND_EYE}:_relative")(board, board, "absolute")
    printed = [board[i + 1].as_matrix() @ board[0].as_matrix().T for i in range(len(board) - 1)]
    return difference(np.abs(turn.as_matrix() - printed).max(), "", 1e-12)


def eq21() -> Found:
    """The camera's attitude by the IMU's, taken at two frames, turns as the camera truly did."""
    from algorithms.localisation.paper import camera_attitude

    rig = preset_rig()
    camera = [Rotation.from_rotvec([0.1, 0.2, 0.3]), Rotation.from_rotvec([0.1, -0.1, 0.9])]
    said = [camera_attitude(_frame(attitude, [0.0], 0, rig), rig) for attitude in camera]
    true = (camera[0].inv() * camera[1]).as_matrix()
    return difference(np.abs(said[0].T @ said[1] - true).max(), "", 1e-9)


def _rolled() -> tuple[Rotation, Rotation, Rotation]:
    """The camera's attitude before and after a roll, and the turn since the first that our odometry makes of it."""
    from algorithms.localisation.paper import PaperSettings, attitude_now

    rig, first = preset_rig(), Rotation.from_euler("x", -90, degrees=True)
    rolled = first * Rotation.from_euler("z", TURN_DEG, degrees=True)
    frame = _frame(rolled, [0.0], 0, rig)
    R, _ = attitude_now(np.eye(3), first.as_matrix(), frame, rig, np.array([0.0, 0.0, 1.0]), None, PaperSettings())
    return first, rolled, Rotation.from_matrix(R)


def eq23() -> Found:
    """What the printed product makes of a roll, and what ours does."""
    _, rolled, turn = _rolled()
    printed, ours = (np.degrees(one.magnitude()) for one in (rolled.inv() * rolled, turn))
    said = f"as printed {printed:.1f} deg for a roll of {TURN_DEG:g}; with R_c1 on the left {ours:.1f} deg"
    held = printed < 1e-6 and abs(ours - TURN_DEG) < 1e-6
    return Found(said, "a slip of the pen: taken as R_c1^T R_ci" if held else verdict(False))


def eq24() -> Found:
    """What is left of a roll when data are turned back by it."""
    first, rolled, turn = _rolled()
    left = np.degrees((turn.inv() * first.inv() * rolled).magnitude())
    return Found(f"{left:.1e} deg left of a roll of {TURN_DEG:g} deg", verdict(left < 1e-6))


def eq25() -> Found:
    """One turn of each wheel is pi times its diameter."""
    from algorithms.localisation.wheels import wheel_distances_mm

    rig = preset_rig()
    wheels = rig.wheels
    rolled = wheel_distances_mm(np.full(len(wheels.diameters_mm), float(wheels.counts_per_turn)), rig)
    return difference(np.abs(rolled - np.pi * np.array(wheels.diameters_mm)).max(), "mm", ROUNDING)


def eq26() -> Found:
    """The step between frames when one of three wheels slips by half."""
    from algorithms.localisation.paper import PaperSettings, launch, median_step_mm

    rig = preset_rig()
    level, step_mm = Rotation.from_euler("x", -90, degrees=True), 3.0
    pipe = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)
    counts = step_mm / (np.pi * rig.wheels.diameters_mm[0]) * rig.wheels.counts_per_turn
    start = launch(_frame(level, [0.0, 0.0, 0.0], 0, rig), rig, pipe, np.array([0.0, 0.0, 1.0]), PaperSettings())
    said = median_step_mm(start, _frame(level, [counts, counts, counts / 2], 1, rig), rig)
    return Found(
        f"{said:.3f} mm of {step_mm:g} mm with one of three wheels at half", verdict(abs(said - step_mm) < 1e-9)
    )


def eq27() -> Found:
    """The line of a robot that slips by 3 %, found from noisy drives."""
    from algorithms.localisation.slip import fit_line

    rng, slope = np.random.default_rng(6), 0.97
    rolled = rng.uniform(20, 60, 500)
    line = fit_line(rolled, slope * rolled + rng.normal(0, 0.5, rolled.size))
    held = abs(line.slope - slope) < 3 * line.slope_std
    return Found(f"slope {line.slope:.4f} +- {line.slope_std:.4f} of a true {slope:g}", verdict(held))
