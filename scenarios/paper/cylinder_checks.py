"""Eqs 1 to 10 on points whose answer is known: rigid motion, radii about an axis, and the fits of a cylinder."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from scenarios.paper.checked import Found, difference, named, verdict

ROUNDING = 1e-9
VARIANCE = "algorithms.registration.cylinder_variance"
RADIUS_MM = 76.2
GOOD_MM = 0.1


def _drawn() -> tuple[Rotation, np.ndarray, np.ndarray]:
    """A rotation, a translation and points."""
    rng = np.random.default_rng(1)
    return Rotation.random(random_state=2), rng.uniform(-50, 50, 3), rng.uniform(-100, 100, (1000, 3))


def _moved_cylinder() -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "4"]]:
    """Points that phi_x, phi_y, Tx, Ty carry onto a cylinder about z, and those four."""
    rng = np.random.default_rng(3)
    parameters = np.array([0.02, -0.03, 4.0, -3.0])
    turn, z = rng.uniform(0, 2 * np.pi, 2000), rng.uniform(-60, 60, 2000)
    upright = np.column_stack([RADIUS_MM * np.cos(turn), RADIUS_MM * np.sin(turn), z])
    R_x, R_y, *_ = named(f"{VARIANCE}:_turns")(parameters)
    return (upright - np.append(parameters[2:], 0.0)) @ (R_x @ R_y), parameters


def eq1() -> Found:
    """`apply` against the printed sum."""
    from sensor_model.geometry import apply, transform

    turn, shift, points = _drawn()
    printed = np.array([turn.as_matrix() @ point + shift for point in points])
    return difference(np.abs(apply(transform(turn.as_matrix(), shift), points) - printed).max(), "mm", ROUNDING)


def eq2() -> Found:
    """R_x and R_y of the fit with a turn about z against a library's turn about x, y and z."""
    phi = np.array([0.3, -0.2, 0.5])
    R_x, R_y, *_ = named(f"{VARIANCE}:_turns")(np.append(phi[:2], [0.0, 0.0]))
    R_z = Rotation.from_euler("z", phi[2]).as_matrix()
    return difference(np.abs(R_x @ R_y @ R_z - Rotation.from_euler("XYZ", phi).as_matrix()).max(), "", 1e-12)


def eq3() -> Found:
    """The translation goes in and comes out again."""
    from sensor_model.geometry import apply, inverse, transform

    turn, shift, points = _drawn()
    T = transform(turn.as_matrix(), shift)
    return difference(np.abs(apply(inverse(T), apply(T, points)) - points).max(), "mm", ROUNDING)


def eq4() -> Found:
    """A turned and shifted cylinder, brought back: all radii are the cylinder's."""
    points, parameters = _moved_cylinder()
    radii, _ = named(f"{VARIANCE}:_radii")(points, parameters)
    return difference(np.abs(radii - RADIUS_MM).max(), "mm", ROUNDING)


def eq5() -> Found:
    """R_x R_y against a library's turn about x and y."""
    R_x, R_y, *_ = named(f"{VARIANCE}:_turns")(np.array([0.3, -0.2, 0.0, 0.0]))
    return difference(np.abs(R_x @ R_y - Rotation.from_euler("XY", [0.3, -0.2]).as_matrix()).max(), "", 1e-12)


def eq6() -> Found:
    """Tx and Ty found again from points without noise."""
    points, parameters = _moved_cylinder()
    found = named(f"{VARIANCE}:least_variance")(points, np.zeros(2))
    return difference(np.abs(found[2:] - parameters[2:]).max(), "mm", 1e-6)


def eq8() -> Found:
    """The radii of the fit against the printed root."""
    points, _ = _moved_cylinder()
    radii, _ = named(f"{VARIANCE}:_radii")(points, np.zeros(4))
    return difference(np.abs(radii - np.sqrt(points[:, 0] ** 2 + points[:, 1] ** 2)).max(), "mm", ROUNDING)


def eq9() -> Found:
    """The mean of all radii about the fitted axis, in a frame without noise."""
    from algorithms.registration import REGISTRATIONS
    from scenarios.bench.frame_bench import frame_errors
    from scenarios.bench.frames import FrameCase

    settings = {"cylinder-variance": REGISTRATIONS["cylinder-variance"].settings()}
    (error,) = frame_errors({"exact": FrameCase(noise_mm=0)}, settings, 1, 1)
    return difference(abs(error.radius_mm), "mm", 1e-4)


def eq7() -> Found:
    """Least variance on clean wall, and what a defect does to it."""
    clean, dug = _fitted("cylinder-variance")
    held = clean < GOOD_MM < dug
    return Found(_words(clean, dug), "holds on clean wall; a defect pulls it" if held else verdict(False))


def eq10() -> Found:
    """Distance to the cylinder, with RANSAC: a defect leaves it where it is."""
    clean, dug = _fitted("cylinder")
    return Found(_words(clean, dug), verdict(max(clean, dug) < GOOD_MM))


def _fitted(method: str) -> tuple[float, float]:
    """How far one fit puts the axis beside its true place on clean wall, and with 30 % of the points on a defect."""
    from algorithms.registration import REGISTRATIONS
    from scenarios.bench.frame_bench import frame_errors
    from scenarios.bench.frames import CASES

    cases = {name: CASES[name] for name in ("clean", "defect-30")}
    clean, dug = frame_errors(cases, {method: REGISTRATIONS[method].settings()}, 1, 1)
    return clean.center_mm, dug.center_mm


def _words(clean_mm: float, dug_mm: float) -> str:
    return f"axis off by {clean_mm:.3f} mm, with 30 % of the points on a defect by {dug_mm:.3f} mm"
