"""Laws that every registration method keeps, those of the registry and the one of docs/adding-a-registration.md."""

from __future__ import annotations

import importlib.util
import re
import sys
from dataclasses import dataclass, fields, replace
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from algorithms.registration import REGISTRATIONS, Registration
from algorithms.registration.first_frame import place_first
from algorithms.registration.fusion import SCALE, covariance, fuse
from algorithms.registration.gicp import to_their_motion
from algorithms.triangulate import triangulate
from algorithms.types import Alignment, RingPoints, Wall
from sensor_model.geometry import apply, inverse, transform, twist_about_z_rad
from sensor_model.points import PointNoise, see_slits
from sensor_model.recording import NominalPipe
from sensor_model.rig import preset_rig
from twin.pipe import Pipe

NOMINAL = NominalPipe(inner_radius_mm=76.2, wall_thickness_mm=7.5)


class Limit(NamedTuple):
    """How far a method may be off on exact points of a clean wall, and between two tellings of one thing."""

    center_mm: float = 1e-5
    tilt_deg: float = 1e-5
    retold_mm: float = 1e-5
    why: str = "a fit to points is exact where they are"


# A plane through a voxel's mean touches the wall; half a voxel aside the wall has left it by s^2 / 8 R: 0.015 mm for
# voxels of 3 mm, 0.026 mm for 4 mm, 0.04 mm for 5 mm. All around a full circle most of that falls out.
# What rounds alike is told alike, but which of two points is the nearer may turn on the last bit.
LIMITS = {
    "icp": Limit(0.015, 0.01, 0.02, "planes of 3 mm voxels"),
    "icp-axis": Limit(0.01, 1e-5, 0.05, "tilt is the cylinder's; the centre turns with the ICP's roll"),
    "gicp": Limit(0.03, 0.02, 0.05, "planes of 4 mm voxels on both sides; small_gicp rests at 0.01 mm"),
    "vgicp": Limit(0.08, 0.05, 0.05, "one distribution in 5 mm of a curved wall; small_gicp rests at 0.01 mm"),
}

PAGE = Path(__file__).resolve().parents[2] / "docs" / "adding-a-registration.md"
EXAMPLE = "plain"
METHODS = [*sorted(REGISTRATIONS), EXAMPLE]
OF_SMALL_GICP = ("gicp", "vgicp")


def _example(folder: Path) -> Registration:
    """The page's method, as a file beside the others would have it."""
    code = re.findall(r"```python\n(.*?)```", PAGE.read_text(), flags=re.S)
    assert len(code) == 1
    (folder / "plain.py").write_text(code[0])
    spec = importlib.util.spec_from_file_location("plain", folder / "plain.py")
    sys.modules["plain"] = module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return Registration(module.PlainSettings, module.align)


@pytest.fixture(scope="module", autouse=True)
def _with_the_example(tmp_path_factory):
    REGISTRATIONS[EXAMPLE] = _example(tmp_path_factory.mktemp("example"))
    yield
    del REGISTRATIONS[EXAMPLE], sys.modules["plain"]


# ---- frames of a wall


def _pose(x=4.0, y=-3.0, tilt=(2.0, -1.5), roll=0.4, z=5.0):
    R = Rotation.from_rotvec([0, 0, roll]) * Rotation.from_euler("xy", tilt, degrees=True)
    return transform(R.as_matrix(), np.array([x, y, z]))


@cache
def _rig():
    rig = preset_rig()
    return rig.model_copy(update={"projector": rig.projector.model_copy(update={"strut_width_deg": 0.0})})


def _look(T, noise_px=0.0, seed=0):
    """A frame of a wall without a feature, seen all around."""
    pipe = Pipe(inner_radius_mm=NOMINAL.inner_radius_mm, wall_thickness_mm=NOMINAL.wall_thickness_mm)
    noise = PointNoise(pixel_noise_px=noise_px, drop_out_share=0.0, azimuths=360)
    return triangulate(see_slits(pipe, T, _rig(), noise, np.random.default_rng(seed)), _rig())


def _prior(T, information=(0.0, 0, 0, 0, 0, 0)):
    """Travel and roll as they are; centre and tilt unknown."""
    roll = Rotation.from_rotvec([0, 0, float(twist_about_z_rad(T[:3, :3]))]).as_matrix()
    return Alignment(transform(roll, np.array([0.0, 0.0, T[2, 3]])), np.diag(np.array(information, dtype=float)))


ODOMETRY = (0.0, 0, 400, 0, 0, 3e4)
KNOWN = [_pose(z=5.0 - 3.3 * k) for k in range(1, 9)]  # the frames before, which a map is made of


def _each(points, **changes):
    return replace(points, **changes)


def _rows(points, rows):
    return RingPoints(*(getattr(points, part.name)[rows] for part in fields(points)))


# ---- a method at work, and the ways to tell it the same thing


@dataclass(frozen=True)
class Method:
    """A registered method, with what it has seen of the wall before the frame in question."""

    kind: str

    @property
    def limit(self):
        """What the table says of it."""
        return LIMITS.get(self.kind, Limit())

    def settings(self, factor=1.0):
        """The defaults, with all lengths among them multiplied: their names say which they are."""
        defaults = REGISTRATIONS[self.kind].settings()
        return type(defaults).model_validate(_scaled(defaults.model_dump(), factor))

    def seen(self, tell=lambda points, T: (points, T), factor=1.0):
        """The method's own map of the frames before, as told; None for a method without one."""
        method = REGISTRATIONS[self.kind]
        if method.begin is None:
            return None
        seen = method.begin(self.settings(factor))
        for T in KNOWN:
            points, T_told = tell(_look(T), T)
            method.grow(seen, points, Alignment(T_told, np.eye(6)))
        return seen

    def align(self, points, prior, seen=None, factor=1.0):
        """Its verb, in the nominal pipe or one that much larger."""
        pipe = NominalPipe(inner_radius_mm=factor * NOMINAL.inner_radius_mm, wall_thickness_mm=factor * 7.5)
        return REGISTRATIONS[self.kind].align(points, Wall(pipe, seen), prior, self.settings(factor))


def _scaled(values, factor):
    if not isinstance(values, dict):
        return values
    return {name: value * factor if name.endswith("_mm") else _scaled(value, factor) for name, value in values.items()}


@pytest.fixture(params=METHODS)
def method(request):
    if request.param in OF_SMALL_GICP:
        pytest.importorskip("small_gicp")
    return Method(request.param)


@cache
def _seen(kind):
    return Method(kind).seen()  # `align` must not change it, so that one does for all


def _error(found, T):
    tilt = np.degrees(np.linalg.norm(np.cross(found.T_pipe_camera[2, :3], T[2, :3])))
    return np.linalg.norm(found.T_pipe_camera[:2, 3] - T[:2, 3]), tilt


def _told_alike(method, points, a, b, factor=1.0):
    """Two alignments put the same points in the same place."""
    off = apply(a, points.xyz_mm) - b
    assert np.abs(off).max() < method.limit.retold_mm * factor


# ---- the laws


def test_exact_points_give_the_exact_pose(method):
    for move in ({}, {"x": -3.0, "y": 5.0}, {"tilt": (-1.0, 3.0)}, {"roll": -2.5}):
        T = _pose(**move)
        prior = replace(_prior(T, ODOMETRY), T_pipe_camera=_nudged(T))
        found = method.align(_look(T), prior, _seen(method.kind))
        assert found.converged, found.reason
        center, tilt = _error(found, T)
        assert center < method.limit.center_mm
        assert tilt < method.limit.tilt_deg


def _nudged(T):
    """A first guess that is off across the pipe by what a robot moves from frame to frame; its roll is right."""
    R = Rotation.from_rotvec([0.4, -0.3, 0.0], degrees=True).as_matrix() @ T[:3, :3]
    return transform(R, T[:3, 3] + np.array([0.3, -0.4, 0.0]))


def test_a_first_frame_is_placed_without_a_map(method):
    T, begin = _pose(), REGISTRATIONS[method.kind].begin
    points = _look(T)
    for seen in (None, begin(method.settings()) if begin else None):
        found = method.align(points, _prior(T, ODOMETRY), seen)
        assert found.converged, found.reason
        assert max(_error(found, T)) < 1e-5


def test_a_frame_beyond_what_was_seen_is_placed_like_a_first_one(method):
    T = _pose(z=900.0)
    found = method.align(_look(_pose(z=0.0)), _prior(T, ODOMETRY), _seen(method.kind))
    assert found.converged, found.reason
    assert max(_error(found, T)) < 1e-5


@pytest.mark.parametrize(
    "motion",
    [
        transform(Rotation.from_euler("xyz", [12, -9, 25], degrees=True).as_matrix(), np.zeros(3)),
        transform(np.eye(3), np.array([30.0, -20.0, 40.0])),
    ],
    ids=["turned", "moved"],
)
def test_moving_the_input_moves_the_answer(method, motion):
    T = _pose()
    points, prior, seen = _look(T, 0.2), replace(_prior(T), T_pipe_camera=_nudged(T)), _seen(method.kind)
    told = _each(points, xyz_mm=apply(motion, points.xyz_mm), direction=points.direction @ motion[:3, :3].T)
    a = method.align(points, prior, seen)
    b = method.align(told, replace(prior, T_pipe_camera=prior.T_pipe_camera @ inverse(motion)), seen)
    assert a.converged
    assert b.converged
    off = apply(a.T_pipe_camera, points.xyz_mm) - apply(b.T_pipe_camera, told.xyz_mm)
    if motion[:3, 3].any():
        # the prior's z is that of the camera's centre, which is another now: its tilt, being off, tells another z
        off[:, 2] -= off[:, 2].mean()
    assert np.abs(off).max() < method.limit.retold_mm


def test_a_mirrored_wall_has_the_mirrored_pose(method):
    def mirrored(points, T):
        return _each(points, xyz_mm=points.xyz_mm @ M, direction=points.direction @ M), M4 @ T @ M4

    M, M4 = np.diag([-1.0, 1, 1]), np.diag([-1.0, 1, 1, 1])
    T = _pose()
    points, prior = _look(T, 0.2), replace(_prior(T), T_pipe_camera=_nudged(T))
    a = method.align(points, prior, _seen(method.kind))
    told, T_prior = mirrored(points, prior.T_pipe_camera)
    b = method.align(told, replace(prior, T_pipe_camera=T_prior), method.seen(mirrored))
    assert a.converged
    assert b.converged
    _told_alike(method, points, a.T_pipe_camera, apply(b.T_pipe_camera, told.xyz_mm) @ M)


def test_the_order_of_points_says_nothing(method):
    T = _pose()
    points, prior, seen = _look(T, 0.2), _prior(T, ODOMETRY), _seen(method.kind)
    order = np.random.default_rng(0).permutation(points.sigma_mm.size)
    a, b = method.align(points, prior, seen), method.align(_rows(points, order), prior, seen)
    assert a.converged
    _told_alike(method, points, a.T_pipe_camera, apply(b.T_pipe_camera, points.xyz_mm))


def test_points_told_twice_give_the_same_pose(method):
    T = _pose()
    points, prior, seen = _look(T, 0.2), _prior(T), _seen(method.kind)
    twice = np.repeat(np.arange(points.sigma_mm.size), 2)
    a, b = method.align(points, prior, seen), method.align(_rows(points, twice), prior, seen)
    assert a.converged
    _told_alike(method, points, a.T_pipe_camera, apply(b.T_pipe_camera, points.xyz_mm))


def test_twice_the_pipe_has_twice_the_pose(method):
    def doubled(points, T):
        larger = T.copy()
        larger[:3, 3] *= 2
        return _each(points, xyz_mm=2 * points.xyz_mm, sigma_mm=2 * points.sigma_mm), larger

    T = _pose()
    points, prior = _look(T, 0.2), replace(_prior(T), T_pipe_camera=_nudged(T))
    a = method.align(points, prior, _seen(method.kind))
    told, T_prior = doubled(points, prior.T_pipe_camera)
    b = method.align(told, replace(prior, T_pipe_camera=T_prior), method.seen(doubled, 2.0), 2.0)
    assert a.converged
    assert b.converged
    _told_alike(method, points, a.T_pipe_camera, apply(b.T_pipe_camera, told.xyz_mm) / 2)


def test_the_same_frame_gives_the_same_pose_and_leaves_the_map_alone(method):
    T, seen = _pose(), _seen(method.kind)
    points = _look(T, 0.2)
    first, second = (method.align(points, _prior(T, ODOMETRY), seen).T_pipe_camera for _ in range(2))
    assert np.array_equal(first, second)


def test_the_information_is_one_and_holds_the_prior_s(method):
    T = _pose()
    prior = _prior(T, ODOMETRY)
    found = method.align(_look(T, 0.2), prior, _seen(method.kind))
    own = (found.information - prior.information) / np.outer(SCALE, SCALE)
    values = np.linalg.eigvalsh(own)
    assert np.allclose(own, own.T, atol=1e-9 * values[-1])
    assert values[0] > -1e-9 * values[-1]
    assert values[2] > 1  # centre and tilt at the least: better than 1 mm and 0.6 degrees
    assert found.inliers.sum() > 0.5 * found.inliers.size


@pytest.mark.parametrize("kind", [kind for kind in METHODS if kind == EXAMPLE or not REGISTRATIONS[kind].begin])
def test_what_keeps_no_map_leaves_travel_and_roll_to_the_prior(kind):
    T, method = _pose(), Method(kind)
    found = method.align(_look(T, 0.2), _prior(T))
    values = np.linalg.eigvalsh(found.information / np.outer(SCALE, SCALE))
    assert (np.abs(values[:2]) < 1e-9 * values[-1]).all()
    assert found.T_pipe_camera[2, 3] == T[2, 3]


def _bad(kind):
    points = _look(_pose())
    n, rng = points.sigma_mm.size, np.random.default_rng(0)
    xyz = points.xyz_mm.copy()
    if kind == "empty":
        n = 0
    elif kind == "two points":
        n = 2
    elif kind == "NaN":
        xyz[7] = np.nan
    elif kind == "collinear":
        xyz = np.outer(np.linspace(0, 100, n), [0, 0, 1.0])
    elif kind == "coplanar":
        xyz[:, 0] = 50.0
    elif kind == "one ring":
        square_on = _look(_pose(x=0.0, y=0.0, tilt=(0.0, 0.0)))
        return _rows(square_on, square_on.ring == 3)
    elif kind == "all outliers":
        xyz = rng.uniform(-150, 150, size=(n, 3))
    return _rows(_each(points, xyz_mm=xyz), slice(n))


@pytest.mark.parametrize("with_map", [False, True], ids=["first", "later"])
@pytest.mark.parametrize("kind", ["empty", "two points", "NaN", "collinear", "coplanar", "one ring", "all outliers"])
def test_what_cannot_be_fitted_fails_with_a_reason(method, kind, with_map):
    points, prior = _bad(kind), _prior(_pose(), ODOMETRY)
    found = method.align(points, prior, _seen(method.kind) if with_map else None)
    assert not found.converged
    assert found.verdict == "failed"
    assert found.reason
    assert not found.information.any()
    assert found.inliers.shape == points.sigma_mm.shape
    assert not found.inliers.any()


# ---- what is not a law of all


def test_the_registry_and_the_settings_agree():
    for kind in METHODS:
        assert REGISTRATIONS[kind].settings().kind == kind


def test_the_paper_s_first_frame_is_placed_by_a_plane():
    T = _pose(x=0.5, y=-0.5, tilt=(0.3, -0.2))
    found = place_first(_look(T), Wall(NOMINAL), _prior(T), "plane")
    assert found.converged
    center, tilt = _error(found, T)
    assert 1e-3 < center < 10  # rings on cones make the plane's normal follow their slant
    assert 1e-3 < tilt < 10


@pytest.mark.parametrize("kind", OF_SMALL_GICP)
def test_without_small_gicp_its_methods_say_how_to_get_it(kind, monkeypatch):
    monkeypatch.setattr("algorithms.registration.gicp.find_spec", lambda _name: None)
    found = Method(kind).align(_look(_pose()), _prior(_pose()), None)
    assert not found.converged
    assert found.reason == "small_gicp is not installed: pip install 'pipetwin[gicp]'"


@pytest.mark.parametrize("kind", [kind for kind, method in REGISTRATIONS.items() if method.begin])
def test_a_map_does_not_grow_with_the_pipe(kind):
    if kind in OF_SMALL_GICP:
        pytest.importorskip("small_gicp")
    method = REGISTRATIONS[kind]
    settings = method.settings(**({"forget_after_frames": 20} if kind == "vgicp" else {}))
    seen, sizes, points = method.begin(settings), [], _rows(_look(_pose()), slice(None, None, 3))
    for k in range(50):
        method.grow(seen, points, Alignment(_pose(z=25.0 * k), np.eye(6)))
        sizes.append(_size(seen))
    assert sizes[-1] < 1.1 * sizes[30]


def _size(seen):
    if hasattr(seen, "voxels"):
        return len(seen.voxels)
    return len(getattr(seen, "cloud", seen).points_mm)


def test_fusing_adds_information_and_weighs_by_it():
    T = np.eye(4)
    moved = T.copy()
    moved[0, 3] = 1.0
    prior = Alignment(moved, np.diag([3.0, 0, 4.0, 0, 0, 9.0]))
    measured = Alignment(T, np.diag([1.0, 2.0, 0, 1e4, 1e4, 0]))
    both = fuse(prior, measured)
    assert both.T_pipe_camera[0, 3] == pytest.approx(0.75)
    assert np.allclose(both.information, prior.information + measured.information)
    variances = np.diag(covariance(measured.information))
    assert variances[1] == pytest.approx(0.5)
    assert np.isinf(variances[[2, 5]]).all()


def test_small_gicp_s_motions_are_ours_seen_from_the_source():
    rng = np.random.default_rng(1)
    T, camera, xyz = _pose(), rng.uniform(-50, 50, 3), rng.uniform(-100, 100, (20, 3))
    ours = 1e-6 * rng.normal(size=6)
    turn, move = np.split(to_their_motion(T, camera) @ ours, 2)
    theirs = apply(T, apply(transform(Rotation.from_rotvec(turn).as_matrix(), move), xyz))
    moved = camera + ours[:3] + Rotation.from_rotvec(ours[3:]).apply(apply(T, xyz) - camera)
    assert np.allclose(theirs, moved, atol=1e-9)
