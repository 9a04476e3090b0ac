"""One small sound file or folder of every kind that is read, and the reader that is held to it."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import NamedTuple

import numpy as np

from algorithms.method import Method
from algorithms.reconstruct import ReconstructionFailed, reconstruct
from campaigns.mutated_arrays import packed_array
from scenarios.artefacts import DEFECT_COLUMNS, EPISODE_COLUMNS
from scenarios.bench.reference import fit_references
from scenarios.calibration.covariance_file import covariance_file, read_covariance, write_covariance
from scenarios.calibration.imu import read_log as read_attitudes
from scenarios.calibration.imu import read_poses
from scenarios.calibration.pictures import read_picture
from scenarios.calibration.rig_file import read_rig, read_settings
from scenarios.document import BadInput
from scenarios.field.export import export
from scenarios.field.export_tally import tally
from scenarios.field.live_log import next_due, open_live, read_more
from scenarios.field.match import matched
from scenarios.field.partial_logs import read_device_log
from scenarios.field.read import read_log
from scenarios.field.read_bag import Topics
from scenarios.field.scan_file import read_scan
from scenarios.field.spool import read_spool
from scenarios.field.told import Told
from scenarios.field.verify import check_of
from scenarios.field.wall_points import wall_points
from scenarios.found_run import read_found, recording_of
from scenarios.load import load_scenario
from scenarios.plan.plan_file import load_plan
from scenarios.run import scenario_and_truth
from scenarios.run_folder import run_folder
from scenarios.settings_yaml import settings_yaml
from scenarios.study.conduct import facts_of, opened
from scenarios.study.export import defects_table, runs_table
from scenarios.study.ledger import Ledger, Outcome
from scenarios.study.plan import identity, planned_runs, recipe_of
from scenarios.study.study import load_study
from scenarios.study.tune_file import load_tuning
from scenarios.trust.columns import read_table
from scenarios.trust.gauge import gauge_of
from scenarios.trust.looks import PodQuestion, read_looks
from scenarios.trust.runs import read_scan as read_judged
from scenarios.view.drive import read_run
from sensor_model.points import NOISES, PointNoise
from sensor_model.recording import NominalPipe, open_recording, read_frame, write_frame_list
from sensor_model.rig import preset_rig, save_settings
from twin.truth import ARRAYS

FRAMES, LONGER_S = 3, 0.03  # of the log that is mutated, and how much longer its other tables are
PICTURE_PX, EVERY = 64, 8
Reader = Callable[[Path], object]


class Enough(Exception):
    """Ends a command before it writes anything."""


class Kind(NamedTuple):
    """What is mutated, a file or a folder; its reader; and how many cases it gets beside the others."""

    sound: Path
    read: Reader
    weight: float = 1.0


SCENARIO = """name: fuzzed
why: A pit.
pipe:
  standard: {material: PE, series: SDR 11, nominal_size_in: 6}
  features: [{kind: pit, distance_mm: 250, clock_deg: "5:00", diameter_mm: 20, depth_mm: 4, shape: conical},
    {kind: pocket, distance_mm: 300, clock_deg: 120, length_mm: 40, width_mm: 30, depth_mm: 5}]
drive: {kind: gantry, stages: [{to_mm: 400}]}
robot: {wheel_radius_mm: 19}
rig: {imu: {position_camera_mm: [0, 0, -60], q_camera_imu_wxyz: [0.7071, 0, 0, 0.7071]}}
sensing: {fidelity: points, frame_rate_hz: 10, points: {pixel_noise_px: 0.2}}
method: {map: {cell_z_mm: 4}}
seed: 1
"""
SPOOL = """name: fuzzed
inner_radius_mm: 76.2
inner_radius_u95_mm: 0.01
wall_thickness_mm: 7.5
axis_deg: [1.5, 2.0]
defects:
  - {name: A, distance_mm: 50, clock_deg: "3:00", length_mm: 40, length_u95_mm: 0.05, width_mm: 30,
     width_u95_mm: 0.05, depth_mm: 3, depth_u95_mm: 0.02}
"""
STUDY = """name: fuzzed
base: paper-gantry
set: {sensing.fidelity: points, sensing.frame_rate_hz: 5, pipe.end_mm: 600, drive.stages: [{to_mm: 100}]}
factors:
  pipe.features.0.depth_mm: [1, 2, 3]
  sensing.points.pixel_noise_px: {low: 0.1, high: 0.4, steps: 2}
  sensing.points.drop_out_share: {distribution: log-uniform, low: 0.001, high: 0.1}
design: {kind: latin-hypercube, points: 4, seeds: 2}
methods: {default: {}, coarse: {map.cell_z_mm: 5}}
record: [defects_found, depth_error_mm_max]
time_limit_s: 60
"""
SENSITIVITY = """name: fuzzed
base: paper-gantry
set: {sensing.fidelity: points}
factors:
  sensing.points.pixel_noise_px: {distribution: normal, mean: 0.2, std: 0.05, low: 0.05, high: 0.5}
  pipe.ovality_pct: {distribution: triangular, low: 0, mode: 1, high: 3}
design: {kind: saltelli, points: 4}
"""
TUNING = """name: fuzzed
base: paper-gantry
tuning: {factors: {sensing.points.pixel_noise_px: [0.1, 0.2]}, design: {kind: grid, seeds: 2}}
hold_out: {factors: {sensing.points.pixel_noise_px: [0.15, 0.25]}, design: {kind: grid, seeds: [10, 11]}}
search:
  method.sizing.threshold.rule: [noise, otsu]
  method.map.cell_z_mm: {low: 0.5, high: 4}
objectives: [depth_error_mm, misses_and_false_calls]
trials: 24
confirm: {scans: 0}
"""
PLAN = """name: fuzzed
base: paper-gantry
set: {pipe.end_mm: 600, drive.stages: [{to_mm: 250}]}
vary: {pipe.ovality_pct: {distribution: uniform, low: 0, high: 0.3}}
defects:
  pocket: {kind: pocket, length_mm: [25, 50], width_mm: [15, 30], depth_pct: [2, 80]}
  pit: {kind: pit, diameter_mm: [12, 20], depth_pct: [2, 60]}
stretch_mm: [110, 330]
per_scan: 2
speeds_mm_s: [50, 100]
confirm: 20
limits: {a90_95_pct: 60, depth_error_pct: 10, seen_share_pct: 80, false_calls_per_m: 2, minutes_per_m: 5}
"""
TOPICS = "{picture: null, slit_pixels: /slits, imu: /imu, wheels: [w0, w1, w2], rig: /rig, pipe: /pipe}\n"
METHOD = "{map: {cell_z_mm: 4, cell_theta_deg: 2}, sizing: {threshold: {rule: otsu}}, decode: {azimuths: 360}}\n"
MEASURED = "150.25,130.28,4:00,119.78,39.9,0.9,29.7,0.4,5.0,0.02,67.0,2.3,0.17,0,1,5.0,4175.5,pitting,reject,682"


def by_reader(log: Path) -> None:
    """The log as a recording, and every frame of it."""
    work = log.parent / "work"
    shutil.rmtree(work, ignore_errors=True)
    recording, _ = read_log(log, Told(), work, lambda *_: None)
    for index in range(len(recording)):
        recording[index]


def by_measurement(log: Path) -> None:
    """The log as it is measured, by the default method."""
    recording = open_recording(log)
    try:
        reconstruct((recording[k] for k in range(len(recording))), recording.rig, recording.pipe, Method())
    except ReconstructionFailed as error:
        raise BadInput([str(error)]) from error


def by_live(log: Path) -> None:
    """The log as it is followed."""
    live = open_live(log)
    if live is None:
        raise BadInput(["nothing to follow"])
    while read_more(live):
        pass
    while next_due(live, at_end=True) is not None:
        pass


def by_run(run: Path) -> None:
    """A run as `export`, `match`, `verify` and the pages read it."""
    found = read_found(run)
    tally(found)
    list(wall_points(found))
    matched(found, found)
    check_of(found, read_spool(run.parent.parent / "spool.yaml"))
    recording_of(run)


def by_study(folder: Path) -> None:
    """A study's folder as `status` and `export` read it."""
    facts_of(folder)
    with opened(folder) as ledger:
        for _, rows in (runs_table(ledger), defects_table(ledger)):
            list(rows)


def by_replaced(folder: Path) -> None:
    """A folder as a command looks at it that is told to write a run there."""
    with suppress(Enough), run_folder(folder):
        raise Enough


def by_looks(file: Path) -> None:
    """A table as `pod` reads it."""
    read_looks(read_table(file), PodQuestion(size="size", hit=("first", "second"), target="target"))
    read_looks(read_table(file), PodQuestion(size="size", signal=("signal",), decision=1.0))


def short(recording: Path, target: Path, pictures: bool = False) -> Path:
    """The first frames of a log, and little more of its other tables; as small pictures where asked for."""
    import cv2

    opened_log = open_recording(recording)
    stamps = opened_log.frame_stamps_ns[:FRAMES]
    last_ns, suffix = int(stamps[-1] + LONGER_S * 1e9), ".png" if pictures else Path(opened_log.frame_files[0]).suffix
    for name in ("imu0", "orientation0", "encoders0"):
        (target / name).mkdir(parents=True)
        header, *lines = (recording / name / "data.csv").read_text().splitlines()
        kept = [line for line in lines if int(line.split(",")[0]) <= last_ns]
        (target / name / "data.csv").write_text("\n".join([header, *kept]) + "\n")
    for source, name in zip(opened_log.frame_files, write_frame_list(target, stamps, suffix), strict=False):
        if pictures:
            cv2.imwrite(str(target / name), smooth_picture())
        else:
            np.save(target / name, np.load(recording / source)[::EVERY], allow_pickle=False)
    save_settings(small_rig() if pictures else opened_log.rig, target / "rig.yaml")
    save_settings(opened_log.pipe, target / "pipe.yaml")
    return target


def smooth_picture() -> np.ndarray:
    """Colours that change slowly."""
    return (np.add.outer(*[np.arange(PICTURE_PX)] * 2)[..., None] * [0.5, 1, 1.5]).astype(np.uint8)


def small_rig():
    """A rig whose pictures are small."""
    size = dict.fromkeys(("height_px", "width_px"), PICTURE_PX)
    rig = preset_rig()
    return rig.model_copy(update={"camera": rig.camera.model_copy(update=size)})


def small_run(folder: Path, recording: Path) -> Path:
    """A run's folder with a small wall, one defect and a short truth."""
    made, truth = folder / "reconstruction", folder / "truth"
    made.mkdir(parents=True)
    truth.mkdir()
    shutil.copytree(recording, folder / "recording")
    (folder / "run.json").write_text('{"pipetwin": "0.1.0", "seconds": {"drive": 0.1}, "seed": 0}\n')
    (folder / "scenario.yaml").write_text(SCENARIO.replace("250", "100").replace("300", "160").replace("400", "200"))
    theta, z = (np.arange(90) + 0.5) * np.pi / 45, np.arange(0.0, 240, 4)
    radius = 76 + np.random.default_rng(0).normal(0, 0.05, (theta.size, z.size)).astype(np.float32)
    grid = {name: np.full_like(radius, 0.05) for name in ("spread_mm", "sigma_mm")}
    count = np.full(radius.shape, 30, dtype=np.int32)
    np.savez(
        made / "wall_map.npz", theta_rad=theta, z_mm=z, radius_mm=radius, count=count, wall_dev_mm=radius - 76, **grid
    )
    head = ("defect", *(name for name in DEFECT_COLUMNS if name != "defect"))
    (made / "defects.csv").write_text(f"{','.join(head)}\n1,{MEASURED}\n2,{MEASURED.replace('150.25', '90')}\n")
    (made / "episodes.csv").write_text(f"{','.join(EPISODE_COLUMNS)}\ngap,imu0,0.5,0.7,0.2\n")
    poses = [f"{k / 10} 0.004 -0.003 {k / 100} 0.01 0.02 0.03 0.9993" for k in range(24)]
    (made / "trajectory.tum").write_text("\n".join(["# time x y z qx qy qz qw", *poses]) + "\n")
    scenario = load_scenario(str(folder / "scenario.yaml"))
    (truth / "pipe.json").write_text(scenario.pipe.model_dump_json())
    shapes = dict(zip(ARRAYS, [(), (3,), (4,), (3,), (3,), (3,), (3,)], strict=True))
    arrays = {name: np.full((24, *shape), 0.5) for name, shape in shapes.items()}
    arrays["time_s"], arrays["position_mm"][:] = np.arange(24) / 10, np.arange(24)[:, None] * [0, 0, 8.0]
    np.savez_compressed(truth / "truth.npz", **arrays)
    return folder


def small_study(folder: Path, file: Path) -> Path:
    """A study's folder with some runs done, one failed, and one still planned."""
    folder.mkdir()
    study = load_study(file)
    recipe = recipe_of(study, "code")
    runs = list(islice(planned_runs(study, recipe), 6))
    with Ledger(folder) as ledger:
        facts = {"identity": identity(study, "code"), "name": "fuzzed", "why": "", "planned": 6, "pace": {"done": 4}}
        ledger.plan(runs, {**facts, "methods": ["default", "coarse"]})
        done = [Outcome(run.key, 1.0, [1, 0.5], [[40.0, 30.0, 5.0, 39.0, 29.0, 5.1]]) for run in runs[:4]]
        ledger.finished([*done, Outcome(runs[4].key, 1.0, cause="error", error="ValueError: x")])
        ledger.base.execute("PRAGMA journal_mode = DELETE")
    return folder


def tables(folder: Path) -> dict[str, Kind]:
    """Tables of looks, gauges, attitudes and poses."""
    looks = ["target,size,first,second,signal", *(f"t{k},{k / 4},{k % 2},{k // 3 % 2},{k / 5}" for k in range(12))]
    gauge = [
        "part,operator,value",
        *(f"p{p},o{o},{p + o / 10 + t / 100}" for p in range(3) for o in range(2) for t in range(2)),
    ]
    clock = [f"12:30:{k:02d},{k * 1000},1,2,3,0.1,0.2,9.8,1,2,3,0.5,0.5,0.5,0.5" for k in range(12)]
    poses = ["rx,ry,rz", *(f"{k / 10},0.1,{k / 20}" for k in range(8))]
    texts = {"looks.csv": looks, "gauge.csv": gauge, "device.csv": ["clock", *clock], "poses.csv": poses}
    for name, lines in texts.items():
        (folder / name).write_text("\n".join(lines) + "\n")
    references = folder / "references"
    references.mkdir()
    turn = np.linspace(0, 6, 12)
    (references / "A.asc").write_text("\n".join(f"{5 * np.cos(a)} {5 * np.sin(a)} {a}" for a in turn) + "\n")
    (references / "A.answer.txt").write_text("\n".join(["0", "0", "0", "0", "0", "1", "5"]) + "\n")
    return {
        "looks": Kind(folder / "looks.csv", by_looks),
        "gauge": Kind(folder / "gauge.csv", lambda file: gauge_of(file, "part", "operator", "value")),
        "attitudes": Kind(folder / "device.csv", read_attitudes),
        "device log": Kind(folder / "device.csv", read_device_log),
        "poses": Kind(folder / "poses.csv", read_poses),
        "references": Kind(references, fit_references, 0.02),
    }


def settings(folder: Path) -> dict[str, Kind]:
    """Every kind of YAML and JSON."""
    texts = {"scenario": SCENARIO, "spool": SPOOL, "study": STUDY, "sensitivity": SENSITIVITY, "tuning": TUNING}
    for name, text in {**texts, "plan": PLAN, "topics": TOPICS, "method": METHOD}.items():
        (folder / f"{name}.yaml").write_text(text)
    rig = preset_rig()
    (folder / "rig.yaml").write_text(settings_yaml(rig))
    (folder / "pipe.yaml").write_text(
        "{inner_radius_mm: 76.2, wall_thickness_mm: 7.5, launch_mm: 0, joints_mm: [100.5, 900]}\n"
    )
    shutil.copyfile(NOISES / "default.yaml", folder / "noise.yaml")
    (folder / "covariance").mkdir()
    write_covariance(rig.projector, np.eye(5 + len(rig.projector.slits)) / 100, folder / "covariance" / "rig.yaml")
    covariance = covariance_file(folder / "covariance" / "rig.yaml")

    def kind(name: str, read: Reader, weight: float = 1.0) -> Kind:
        return Kind(folder / f"{name}.yaml", read, weight)

    return {
        "scenario": kind("scenario", lambda file: load_scenario(str(file)), 2),
        "method": kind("method", lambda file: load_scenario("paper-gantry", method=file)),
        "spool": kind("spool", read_spool),
        "study": kind("study", load_study, 0.3),
        "sensitivity": kind("sensitivity", load_study, 0.3),
        "tuning": kind("tuning", load_tuning, 0.3),
        "plan": kind("plan", load_plan, 0.3),
        "topics": kind("topics", lambda file: read_settings(Topics, file)),
        "rig": kind("rig", lambda file: read_rig(str(file)), 0.7),
        "pipe": kind("pipe", lambda file: read_settings(NominalPipe, file)),
        "noise": kind("noise", lambda file: read_settings(PointNoise, file)),
        "covariance": Kind(covariance, lambda file: read_covariance(rig.projector, file.with_name("rig.yaml")), 0.3),
    }


def packed(folder: Path) -> dict[str, Kind]:
    """Pictures, scans, arrays."""
    import cv2
    from scipy.io import savemat

    for ending in ("png", "jpg"):
        cv2.imwrite(str(folder / f"picture.{ending}"), smooth_picture())
    savemat(folder / "poses.mat", {"rvecs": np.arange(24.0).reshape(8, 3) / 10})
    theta, z = np.arange(0.5, 36) * np.pi / 18, np.arange(0.5, 20)
    radius = 76 + 0.1 * np.random.default_rng(0).random((theta.size, z.size))
    np.savez(folder / "scan.npz", theta_rad=theta, z_mm=z, radius_mm=radius)
    t, along = np.meshgrid(np.radians(np.arange(0.5, 360, 2)), z[:3], indexing="ij")
    xyz = np.stack([76 * np.sin(t), -76 * np.cos(t), along], axis=-1).reshape(-1, 3)
    for name, form in (("scan.ply", "binary_little_endian"), ("scan-text.ply", "ascii")):
        head = f"ply\nformat {form} 1.0\nelement vertex {len(xyz)}\n"
        head += "".join(f"property float {axis}\n" for axis in "xyz") + "end_header\n"
        text = "".join("{:.3f} {:.3f} {:.3f}\n".format(*row) for row in xyz).encode()
        (folder / name).write_bytes(head.encode() + (text if form == "ascii" else xyz.astype("<f4").tobytes()))
    rig = small_rig()
    kinds = {
        name: Kind(folder / name, lambda file: read_scan(file, file.name))
        for name in ("scan.npz", "scan.ply", "scan-text.ply")
    }
    return {
        **kinds,
        "frame.png": Kind(folder / "picture.png", lambda file: read_frame(file, rig), 3),
        "picture.png": Kind(folder / "picture.png", read_picture, 3),
        "picture.jpg": Kind(folder / "picture.jpg", read_picture),
        "poses.mat": Kind(folder / "poses.mat", read_poses, 0.01),
    }


def every_kind(recording: Path, folder: Path) -> dict[str, Kind]:
    """All that is read, made small and sound, in a folder."""
    log = short(recording, folder / "log")
    kinds = settings(folder) | packed(folder) | tables(folder)
    np_frame = folder / "frame.npy"
    first = next((log / "cam0" / "data").glob("*.npy"))
    np_frame.write_bytes(packed_array(np.load(first)))
    run = small_run(folder / "run", log)
    pictures = short(recording, folder / "pictures", pictures=True)
    return {
        "recording": Kind(log, by_reader, 1),
        "measured": Kind(log, by_measurement, 0.3),
        "pictures": Kind(pictures, by_reader, 0.5),
        "live": Kind(log, by_live, 1),
        "frame.npy": Kind(np_frame, lambda file: read_frame(file, preset_rig()), 2),
        "mcap": Kind(export(log, "mcap", folder / "log.mcap")[0], by_reader, 0.5),
        "rosbag2": Kind(export(log, "rosbag2", folder / "log.rosbag2")[0], by_reader, 0.5),
        "video": Kind(export(pictures, "video", folder / "video")[0], by_reader, 0.3),
        "run": Kind(run, by_run, 1),
        "judged run": Kind(run, read_judged, 0.5),
        "viewed run": Kind(run, read_run, 0.1),
        "true run": Kind(run, scenario_and_truth, 0.5),
        "old run": Kind(run, by_replaced, 0.3),
        "study folder": Kind(small_study(folder / "studied", folder / "study.yaml"), by_study, 1),
        **kinds,
    }
