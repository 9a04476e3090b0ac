"""Everything that a twin needs of a log, quantity by quantity; the truth has no part in it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from algorithms.identification import inertial, picture_noise, slits
from algorithms.identification.bore import bore
from algorithms.identification.estimate import Estimate, Quantity, Unknown, about, of_blocks, of_share
from algorithms.identification.inertial import Imu
from algorithms.identification.scan import COMMON_PRIOR_PCT, Walk
from algorithms.identification.shaking import Band, vibration
from algorithms.identification.slits import SlitFigures
from algorithms.identification.way import Way, path_quantities, rows_by_wheels, rows_of
from algorithms.identification.wheels import WheelFigures, consensus_mm, rolled_mm, wheel_figures
from algorithms.localisation.wheels import count_mm
from algorithms.types import Defect, Trajectory
from sensor_model.recording import Recording
from sensor_model.rig import ImuMount

FORCE_BIAS_STD_M_S2 = 0.02  # what an accelerometer may be off by along the pipe, which a slope hides
TOLD_PCT = 0.5  # a common scale less sure than this is not told
LEAST_FRAMES = 10
USUAL_WALK = 5e-5  # rad/s/sqrt(s), of a usual MEMS gyroscope
DEG = float(np.degrees(1.0))


@dataclass(frozen=True)
class Identified:
    """Quantities by name (units in the names), bands of shaking, the way, the defects, and what is wrong."""

    quantities: dict[str, Quantity]
    bands: list[Band] = field(default_factory=list)
    way: Way | None = None
    defects: tuple[Defect, ...] = ()
    said: tuple[str, ...] = ()


def identify_log(recording: Recording, walked: Walk) -> Identified:
    """All but what pictures alone tell, which `identify_pictures` does."""
    rolled = rolled_mm(recording)
    step_s = float(np.median(np.diff(recording.encoder_stamps_ns))) / 1e9
    wheels = wheel_figures(rolled, step_s, count_mm(recording.rig))
    imu = imu_of(recording, rolled)
    way = walked.found.trajectory if walked.found else None
    out = _rates(recording)
    agreed = consensus_mm(rolled, wheels, step_s)
    # encoders speak before the first frame and after the last
    at_frames_mm = np.interp(recording.frame_stamps_ns, recording.encoder_stamps_ns, agreed)
    out |= _wheel_quantities(wheels, at_frames_mm, walked)
    out |= _inertial_quantities(imu, recording, way)
    out |= _frame_quantities(recording, walked)
    if isinstance(doubt := out["wheel_common_scale_pct"], Unknown) and "no scale" in doubt.reason:
        out["travel_mm"] = doubt
    bands = shaking(imu, recording.rig.imu, out)
    return Identified(
        out,
        bands,
        _way(recording, rolled, agreed, wheels, out, way),
        walked.found.defects if walked.found else (),
        _said(recording, imu, walked, wheels),
    )


def imu_of(recording: Recording, rolled_mm: Float[np.ndarray, "k wheels"]) -> Imu:
    """The IMU's samples, and where the wheels say that it is at rest."""
    time_s = (recording.imu_stamps_ns - recording.imu_stamps_ns[0]) / 1e9
    stamps = recording.imu_stamps_ns, recording.encoder_stamps_ns
    rest, moving = inertial.rest_by_wheels(*stamps, rolled_mm), inertial.motion_by_wheels(*stamps, rolled_mm)
    return Imu(time_s, recording.imu[:, :3], recording.imu[:, 3:], rest, moving)


def shaking(imu: Imu, mount: ImuMount, known: dict[str, Quantity]) -> list[Band]:
    """Bands of shaking beyond the white noise; that which was not told apart from shaking counts as shaking."""
    none = Estimate(0.0, 0.0, 0.0, 0, "not told apart")
    noise = []
    for name in ("gyroscope_noise_density", "accelerometer_noise_density"):
        density = known[name]
        noise.append(density if isinstance(density, Estimate) and density.low > 0 else none)
    return vibration(imu, mount, *noise)


def identify_imu(imu: Imu) -> dict[str, Quantity]:
    """What an IMU's log by itself tells."""
    out: dict[str, Quantity] = {}
    for name, of in (("gyroscope", "gyro"), ("accelerometer", "force")):
        out[f"{name}_noise_density"] = inertial.noise_density(imu, of)
        out[f"{name}_random_walk"] = inertial.random_walk(imu, of)
    out["accelerometer_bias_down_m_s2"] = inertial.force_bias_down(imu)
    return out


def identify_pictures(pictures: list[UInt8[np.ndarray, "height width 3"]], gamma: float) -> dict[str, Quantity]:
    """Photon and read noise of pictures."""
    parts = [picture_noise.noise_of(part, gamma) for one in pictures for part in picture_noise.quarters(one)]
    if not parts:
        nothing = Unknown("the log has no pictures")
        return {"shot_noise": nothing, "read_noise": nothing}
    shot, read = picture_noise.photon_and_read(np.array(parts), gamma)
    return {"shot_noise": shot, "read_noise": read}


def _rates(recording: Recording) -> dict[str, Quantity]:
    """How often each sensor speaks, and the share of frames that are lost between others."""
    out: dict[str, Quantity] = {}
    logs = {
        "frame_rate_hz": recording.frame_stamps_ns,
        "imu_rate_hz": recording.imu_stamps_ns,
        "encoder_rate_hz": recording.encoder_stamps_ns,
    }
    for name, stamps in logs.items():
        steps = np.diff(stamps) / 1e9
        if steps.size < 3:
            out[name] = Unknown(f"{stamps.size} stamps")
            continue
        usual = float(np.median(steps))
        whole = steps / np.maximum(np.round(steps / usual), 1)
        near = whole[np.abs(whole / usual - 1) < 0.2]
        out[name] = about(
            1 / float(near.mean()), float(near.std() / near.mean() ** 2 / np.sqrt(near.size)), near.size, "stamps"
        )
    steps = np.diff(recording.frame_stamps_ns)
    lost = np.maximum(np.round(steps / np.median(steps)) - 1, 0) if steps.size else np.zeros(0)
    out["dropped_share"] = of_share(
        np.array([lost.sum()]), np.array([lost.sum() + len(recording)]), "gaps between stamps"
    )
    return out


def _wheel_quantities(
    wheels: WheelFigures, at_frames_mm: Float[np.ndarray, "frames"], walked: Walk
) -> dict[str, Quantity]:
    """Scales in per cent: beside each other by the encoders, all together by what several rings saw of the wall."""
    out: dict[str, Quantity] = {}
    for k, one in enumerate(wheels.scale):
        out[f"wheel{k}_scale_beside_mean_pct"] = one.scaled(100.0)
    out["wheel_common_scale_pct"] = _common_scale(at_frames_mm, walked)
    out["encoder_disagreement_mm"] = wheels.disagreement_mm
    if walked.found is None:
        out["slip_episodes_mm"] = Unknown(walked.failure)
    else:
        slips = np.array([one.amount for one in walked.found.episodes if one.kind == "slip"])
        total = float(np.abs(slips).sum())
        out["slip_episodes_mm"] = about(total, 0.05 * total, slips.size, "slips that the filter named, summed")
    return out


def _common_scale(at_frames_mm: Float[np.ndarray, "frames"], walked: Walk) -> Quantity:
    """How much further the robot went than its wheels say, scale and slip that all share in one (%)."""
    if walked.found is None:
        return Unknown(walked.failure)
    way, counted_mm = walked.found.trajectory, max(float(np.ptp(at_frames_mm)), 1e-9)
    went_mm = float(np.ptp(way.T_pipe_camera[:, 2, 3]))
    std_pct = 100 * float(np.sqrt(way.covariance[-1, 2, 2])) / counted_mm
    off_pct = 100 * (went_mm / counted_mm - 1)
    if abs(off_pct) > COMMON_PRIOR_PCT:
        return Unknown(f"the filter puts the way {off_pct:+.1f} % off the wheels, which no scale of theirs explains")
    if std_pct > TOLD_PCT:
        return Unknown(f"what several rings saw of the same wall tells it to {std_pct:.1f} % only, encoders not at all")
    words = "what several rings saw of the same wall, against the wheels; slip that all share is in it"
    return about(off_pct, std_pct, int(np.count_nonzero(way.registered)), words)


def _inertial_quantities(imu: Imu, recording: Recording, way: Trajectory | None) -> dict[str, Quantity]:
    out = identify_imu(imu)
    gyro = out["gyroscope_noise_density"]
    density = gyro.high if isinstance(gyro, Estimate) else 0.0
    R_camera_imu = recording.rig.imu.R_camera_imu
    frame_s, turned, pose_std = np.zeros(0), np.zeros((0, 3)), 0.0
    if way is not None and np.count_nonzero(way.registered) >= LEAST_FRAMES:
        seen = way.registered
        frame_s = (way.stamp_ns[seen] - recording.imu_stamps_ns[0]) / 1e9
        R_pipe_imu = Rotation.from_matrix(way.T_pipe_camera[seen][:, :3, :3] @ R_camera_imu)
        turned = (R_pipe_imu[:-1].inv() * R_pipe_imu[1:]).as_rotvec()
        # roll is the gyroscope's own, but for gravity: its error is the largest
        pose_std = float(np.sqrt(np.median(np.diagonal(way.covariance[seen], axis1=1, axis2=2)[:, 3:].max(axis=1))))
    biases = inertial.gyro_bias(imu, frame_s, turned, pose_std, density, USUAL_WALK)
    for axis, bias in zip("xyz", biases, strict=True):
        out[f"gyroscope_bias_{axis}_deg_s"] = bias.scaled(DEG)
    size = inertial.size_of(biases, "the three axes' own biases, as draws")
    out["gyroscope_bias_deg_s"] = size.scaled(DEG)
    out["attitude_noise_deg"] = _attitude(recording, imu)
    out["inclination_deg"] = Unknown("no frame was registered, so the pipe's axis is not known")
    if way is not None and way.registered.any():
        axis = np.median(way.T_pipe_camera[way.registered][:, 2, :3], axis=0)
        sloped = inertial.inclination(
            imu.force_m_s2 @ R_camera_imu.T @ (axis / np.linalg.norm(axis)), FORCE_BIAS_STD_M_S2
        )
        out["inclination_deg"] = sloped.scaled(DEG)
    return out


def _attitude(recording: Recording, imu: Imu) -> Quantity:
    """Noise of the device's attitude against its own gyroscope, where both share their stamps."""
    if not np.array_equal(recording.orientation_stamps_ns, recording.imu_stamps_ns):
        return Unknown("attitude and gyroscope have stamps of their own")
    q = Rotation.from_quat(recording.q_world_imu_wxyz[:, [1, 2, 3, 0]])
    middle = 0.5 * (imu.gyro_rad_s[1:] + imu.gyro_rad_s[:-1])
    told = middle * np.diff(imu.time_s)[:, None]
    found = inertial.attitude_noise(
        (q[:-1].inv() * q[1:]).as_rotvec(), told, "steps of the attitude less the gyroscope's"
    )
    return found.scaled(DEG)


def _frame_quantities(recording: Recording, walked: Walk) -> dict[str, Quantity]:
    """Slit pixels, the slide's edges, residual, yield, bore and the way across the pipe."""
    out: dict[str, Quantity] = {}
    out |= edge_quantities(walked.slits)
    out["residual_mm"] = _by_blocks(walked.residual_mm, "scatter about each frame's cylinder")
    out["decode_yield"] = _by_blocks(walked.yields, "slit pixels found, of all slits times azimuths")
    names = ("diameter_mm", "ovality_pct", "widest_deg")
    if walked.found is None:
        return out | dict.fromkeys(names, Unknown(walked.failure))
    rough = float(np.median(walked.residual_mm)) if walked.residual_mm.size else 0.0
    way, slits_seen = walked.found.trajectory, len(recording.rig.projector.slits)
    diameter, ovality, widest = bore(walked.found.wall, way.radius_mm[way.registered], rough, slits_seen)
    widest = widest.scaled(DEG)
    out |= dict(zip(names, (diameter, ovality, widest), strict=True))
    return out | path_quantities(way, rough)


def edge_quantities(figures: list[SlitFigures]) -> dict[str, Quantity]:
    """Noise, drop-outs and edges of the slits of some frames."""
    rms, cells = slits.edge_jitter(figures) if figures else (Unknown("no frame was registered"),) * 2
    return {
        "pixel_noise_px": slits.pixel_noise_px(figures),
        "drop_out_share": slits.drop_out_share(figures),
        "edge_jitter_deg": rms.scaled(DEG),
        "edge_jitter_cells": cells,
    }


def _by_blocks(values: Float[np.ndarray, "n"], source: str) -> Quantity:
    return of_blocks(np.array([part.mean() for part in np.array_split(values, 8) if part.size]), source)


def _way(
    recording: Recording,
    rolled: Float[np.ndarray, "k wheels"],
    agreed: Float[np.ndarray, "k"],
    wheels: WheelFigures,
    known: dict[str, Quantity],
    way: Trajectory | None,
) -> Way:
    """The rows of the drive."""
    start = int(recording.encoder_stamps_ns[0])
    encoder_s = (recording.encoder_stamps_ns - start) / 1e9
    common = known["wheel_common_scale_pct"]
    factor = 1 + (common.value / 100 if isinstance(common, Estimate) else 0.0)
    scales = np.array([getattr(one, "value", 0.0) for one in wheels.scale])
    agreed, scaled = factor * agreed, factor * rolled * (1 + scales)
    if way is None or np.count_nonzero(way.registered) < LEAST_FRAMES:
        return rows_by_wheels(recording.pipe.launch_mm, encoder_s, agreed, scaled)
    told = isinstance(common, Estimate)
    return rows_of(way, start, encoder_s, agreed, scaled, None if told else recording.pipe.launch_mm)


def _said(recording: Recording, imu: Imu, walked: Walk, wheels: WheelFigures) -> tuple[str, ...]:
    """What is wrong with the log, in words."""
    out = []
    if not imu.at_rest.any():
        out.append("The log has no rest of a second: the IMU's noise is taken from the motion.")
    if not walked.slits:
        out.append(
            f"No frame was registered ({walked.failure}): nothing is known of the pipe and of the way across it."
        )
    for k in np.flatnonzero(wheels.dead):
        out.append(f"Wheel {k + 1} stands while the others roll: it is left out, and slips in the replay as it did.")
    nominal, found = recording.pipe.inner_radius_mm, walked.found
    if found is not None:
        radius = float(np.nanmedian(found.trajectory.radius_mm))
        if abs(radius / nominal - 1) > 0.03:
            out.append(
                f"The bore measures {2 * radius:.1f} mm, and {2 * nominal:.1f} mm are written down: "
                "another pipe, or a rig of another size."
            )
    unseen = 1 - len(walked.slits) / max(len(recording), 1)
    if walked.slits and unseen > 0.2:
        out.append(f"{100 * unseen:.0f} % of the frames were not registered.")
    return tuple(out)
