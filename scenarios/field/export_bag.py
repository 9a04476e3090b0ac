"""A run as an MCAP file or a ROS 2 bag: its log, every number exact, rig and pipe as text, and what was measured."""

from __future__ import annotations

import heapq
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from scenarios.document import BadInput
from scenarios.field import ros
from scenarios.field.measured_messages import measured
from scenarios.field.place import recording_in
from scenarios.found_run import MADE, FoundRun, read_found
from sensor_model.recording import SLIT_PIXELS_SUFFIX, Recording, open_recording

Storage = Literal["mcap", "sqlite3"]
UNKNOWN = -1.0  # first of a covariance: the message does not state this quantity


class Message(NamedTuple):
    """One message and where it goes; ordered by its stamp."""

    stamp_ns: int
    order: int
    topic: str
    content: Any


def export_mcap(run: Path, target: Path) -> None:
    """Write a run as one MCAP file.

    Raises:
        BadInput: when there is no recording, the package for bags is not there, or the file cannot be written.
    """
    with tempfile.TemporaryDirectory(dir=target.parent, prefix=".mcap-") as folder:
        _write(run, Path(folder) / "bag", "mcap")
        (Path(folder) / "bag" / "bag.mcap").replace(target)


def export_rosbag2(run: Path, target: Path) -> None:
    """Write a run as the folder of a ROS 2 bag.

    Raises:
        BadInput: when there is no recording, the package for bags is not there, or the folder cannot be written.
    """
    _write(run, target / "bag", "sqlite3")  # the file's name is its folder's, and stands in the metadata
    for file in (target / "bag").iterdir():
        file.rename(target / file.name)
    (target / "bag").rmdir()


def _write(run: Path, folder: Path, storage: Storage) -> None:
    types, recording = ros.types(), open_recording(recording_in(run))
    found = read_found(run) if (run / MADE).is_dir() else None
    from rosbags.rosbag2 import StoragePlugin, Writer

    latest = max(recording.frame_stamps_ns[-1], recording.imu_stamps_ns[-1], recording.encoder_stamps_ns[-1])
    if latest > ros.LARGEST_STAMP_NS:
        raise BadInput([f"{recording.folder}: stamp {latest}; a ROS stamp ends at {ros.LARGEST_STAMP_NS} ns"])
    with Writer(folder, version=9, storage_plugin=StoragePlugin[storage.upper()]) as bag:
        topics: dict[str, Any] = {}
        for message in messages(recording, found):
            if message.topic not in topics:
                kind = ros.TOPICS[message.topic]
                topics[message.topic] = bag.add_connection(message.topic, kind, typestore=types)
            content = types.serialize_cdr(message.content, ros.TOPICS[message.topic])
            bag.write(topics[message.topic], message.stamp_ns, content)


def messages(recording: Recording, found: FoundRun | None) -> Iterator[Message]:
    """All of a recording, and of what was measured, in order of time; of pictures no more than one is held."""
    logs = [_settings(recording), _imu(recording), _wheels(recording), _frames(recording)]
    if not _one_clock(recording):
        logs.append(_attitudes(recording))
    if found is not None:
        logs.append(Message(stamp, 6, topic, content) for stamp, topic, content in measured(found))
    return heapq.merge(*logs, key=lambda message: message[:2])


def _settings(recording: Recording) -> Iterator[Message]:
    """Rig and pipe, as text, at the log's first stamp."""
    first = min(recording.imu_stamps_ns[0], recording.encoder_stamps_ns[0], recording.frame_stamps_ns[0])
    for order, name in enumerate(("rig", "pipe")):
        text = ros.types().types[ros.TEXT]((recording.folder / f"{name}.yaml").read_text())
        yield Message(int(first), order, f"/{name}", text)


def _one_clock(recording: Recording) -> bool:
    """Whether every sample of the IMU has the attitude of the same time."""
    return np.array_equal(recording.imu_stamps_ns, recording.orientation_stamps_ns)


def _imu(recording: Recording) -> Iterator[Message]:
    known, nothing, with_attitude = ros.types().types, np.zeros(9), _one_clock(recording)
    vector, quaternion = known["geometry_msgs/msg/Vector3"], known["geometry_msgs/msg/Quaternion"]
    unknown = np.append(UNKNOWN, np.zeros(8))
    for k, (stamp, row) in enumerate(zip(recording.imu_stamps_ns.tolist(), recording.imu.tolist(), strict=True)):
        w, x, y, z = recording.q_world_imu_wxyz[k].tolist() if with_attitude else (1.0, 0.0, 0.0, 0.0)
        content = known[ros.IMU](
            ros.header(stamp, "imu0"),
            quaternion(x, y, z, w),
            nothing if with_attitude else unknown,
            vector(*row[:3]),
            nothing,
            vector(*row[3:]),
            nothing,
        )
        yield Message(stamp, 2, "/imu0", content)


def _attitudes(recording: Recording) -> Iterator[Message]:
    known = ros.types().types
    rows = zip(recording.orientation_stamps_ns.tolist(), recording.q_world_imu_wxyz.tolist(), strict=True)
    for stamp, (w, x, y, z) in rows:
        quaternion = known["geometry_msgs/msg/Quaternion"](x, y, z, w)
        yield Message(stamp, 3, "/orientation0", known[ros.ATTITUDE](ros.header(stamp, "imu0"), quaternion))


def _wheels(recording: Recording) -> Iterator[Message]:
    joints, none = ros.types().types[ros.WHEELS], np.zeros(0)
    names = [f"wheel{k}" for k in range(recording.counts.shape[1])]
    angles = ros.angles_rad(recording.counts, recording.rig.wheels.counts_per_turn)
    for stamp, angle in zip(recording.encoder_stamps_ns.tolist(), angles, strict=True):
        yield Message(stamp, 4, "/encoders0", joints(ros.header(stamp, "robot"), names, angle, none, none))


def _frames(recording: Recording) -> Iterator[Message]:
    known = ros.types().types
    for index, (stamp, name) in enumerate(zip(recording.frame_stamps_ns.tolist(), recording.frame_files, strict=True)):
        head = ros.header(stamp, "cam0")
        if name.endswith(SLIT_PIXELS_SUFFIX):
            yield Message(stamp, 5, "/cam0/slit_pixels", _cloud(recording, index, head))
        else:
            data = np.frombuffer((recording.folder / name).read_bytes(), dtype=np.uint8)
            yield Message(stamp, 5, "/cam0/image/compressed", known[ros.PICTURE](head, "rgb8; png compressed", data))


def _cloud(recording: Recording, index: int, head: Any) -> Any:
    """The slit pixels of one frame, in pixels, as a cloud of points."""
    seen = recording[index].slit_pixels
    if seen is None:
        raise BadInput([f"{recording.folder / recording.frame_files[index]}: no slit pixels"])
    rows = np.zeros(seen.slit.size, dtype=ros.SLIT_POINT)
    rows["pixel"], rows["slit"], rows["sigma_px"] = seen.pixel, seen.slit, seen.sigma_px
    return ros.cloud(rows, ros.SLIT_FIELDS, head)
