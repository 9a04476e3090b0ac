"""Plays a recording to and fro into a growing log, follows it live, kills the follower, and measures how it kept up."""

from __future__ import annotations

import argparse
import filecmp
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from sensor_model.recording import Recording, open_recording

SAMPLE_EVERY_S = 1.0
ATTITUDE, IMU = "orientation0", "imu0"


def play(source: Recording, target: Path, seconds: float, rate_hz: float) -> None:
    """Write frames as they would have come; backwards the rates of turn change their sign, and nothing else does."""
    (target / "cam0" / "data").mkdir(parents=True)
    tables = {name: table(target / name / "data.csv") for name in (IMU, ATTITUDE, "encoders0", "cam0")}
    last, way = len(source) - 1, 1
    index, stamp_ns, began = 0, 0, time.monotonic()
    period_ns = round(1e9 / rate_hz)
    for number in range(int(seconds * rate_hz)):
        time.sleep(max(began + number / rate_hz - time.monotonic(), 0))
        frame = source.frame(index)
        name = f"{stamp_ns}{Path(source.frame_files[index]).suffix}"
        os.link(source.folder / source.frame_files[index], target / "cam0" / "data" / name)
        os.utime(target / "cam0" / "data" / name)
        samples = frame.imu[-8:] * np.array([way] * 3 + [1] * 3)
        stamps = stamp_ns + np.linspace(-period_ns, 0, len(samples) + 1)[1:].astype(np.int64)
        rows = {
            IMU: list(zip(np.maximum(stamps, 0).tolist(), samples.tolist(), strict=True))
            if number
            else [(0, samples[-1].tolist())],
            ATTITUDE: [(stamp_ns, frame.q_world_imu_wxyz.tolist())],
            "encoders0": [(stamp_ns, np.rint(frame.counts).astype(int).tolist())],
        }
        for sensor, lines in rows.items():
            tables[sensor].write(
                "".join(
                    f"{stamp},{','.join(f'{v:.9g}' if sensor != 'encoders0' else str(v) for v in row)}\n"
                    for stamp, row in lines
                )
            )
            tables[sensor].flush()
        tables["cam0"].write(f"{stamp_ns},{name}\n")
        tables["cam0"].flush()
        if not 0 <= index + way <= last:
            way = -way
        index, stamp_ns = index + way, stamp_ns + period_ns
    tables["cam0"].write("# end\n")
    for file in tables.values():
        file.close()


def table(file: Path):
    """One growing table."""
    file.parent.mkdir(parents=True, exist_ok=True)
    return file.open("w", buffering=1)


def memory_mb(pid: int) -> float:
    """Resident memory of a process, which is not its workers'."""
    pages = int(Path(f"/proc/{pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 2**20


def cpu_s(pid: int) -> float:
    """Time that a process and its workers have had of the processors."""
    total = 0.0
    for one in [pid, *children(pid)]:
        try:
            fields = Path(f"/proc/{one}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        total += (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return total


def children(pid: int) -> list[int]:
    """The processes that a process started."""
    try:
        return [
            int(one) for task in Path(f"/proc/{pid}/task").iterdir() for one in (task / "children").read_text().split()
        ]
    except OSError:
        return []


def free_port() -> int:
    """A port that nobody uses at the moment."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return one.getsockname()[1]


def wait_for(port: int) -> None:
    """Until the follower has loaded, and shows its page."""
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return
        except OSError:
            time.sleep(0.1)


def main() -> None:
    """Follow, kill once, follow on, and hold the end against a replay of the finished log."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("source", type=Path, help="a run or a recording, of 200 frames if it can be")
    parser.add_argument("--seconds", type=float, default=600)
    parser.add_argument("--rate-hz", type=float, default=15)
    parser.add_argument("--kill-at-s", type=float, help="when to kill the follower; never, if it is left out")
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_args()
    inside = given.source / "recording"
    source = open_recording(inside if inside.is_dir() else given.source)
    with tempfile.TemporaryDirectory(dir=source.folder.parent) as folder:
        log, out = Path(folder) / "log", Path(folder) / "live"
        log.mkdir()
        for name in ("rig.yaml", "pipe.yaml"):
            (log / name).write_bytes((source.folder / name).read_bytes())
        port = free_port()
        command = [
            sys.executable,
            "-m",
            "scenarios.cli",
            "replay",
            "--live",
            str(log),
            "-o",
            str(out),
            "-j",
            str(given.jobs),
            "--port",
            str(port),
        ]
        follower = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        wait_for(port)
        loaded_s = cpu_s(follower.pid)
        player = os.fork()
        if player == 0:
            play(source, log, given.seconds, given.rate_hz)
            os._exit(0)
        memory: list[float] = []
        used, began, killed, playing = 0.0, time.monotonic(), False, True
        while follower.poll() is None:
            time.sleep(SAMPLE_EVERY_S)
            playing = playing and os.waitpid(player, os.WNOHANG)[0] == 0
            try:
                if playing:  # the pages of the end need time and memory of their own
                    seen = len(list((out.with_name("live.live") / "slits").glob("*.json")))
                    used = 1e3 * (cpu_s(follower.pid) - loaded_s) / max(seen, 1)
                    memory.append(memory_mb(follower.pid) or memory[-1])
            except (OSError, IndexError):
                continue
            if given.kill_at_s and not killed and time.monotonic() - began > given.kill_at_s:
                follower.send_signal(signal.SIGKILL)
                follower.wait()
                kept = len(list((out.with_name("live.live") / "slits").glob("*.json")))
                print(f"killed after {given.kill_at_s:g} s, {kept} frames kept")
                memory, killed, loaded_s = [], True, 0.0
                follower = subprocess.Popen(command, stdout=subprocess.DEVNULL)
        if playing:
            os.waitpid(player, 0)
        if follower.returncode:
            sys.exit(f"the follower failed: {follower.returncode}")
        about = json.loads((out / "run.json").read_text())["live"]
        frames = len(open_recording(log))
        print(f"{frames} frames, {about}, late {100 * about['late'] / max(about['frames'], 1):.2f} %")
        fifths = [f"{np.median(part):.0f}" for part in np.array_split(np.array(memory), 5)]
        print(f"memory over the fifths of the time: {', '.join(fifths)} MB, at most {max(memory):.0f}")
        print(f"processor {used:.0f} ms a frame", flush=True)
        again = Path(folder) / "replay"
        subprocess.run(
            [*command[:4], str(log), "-o", str(again), "-j", str(given.jobs)], check=True, stdout=subprocess.DEVNULL
        )
        same = filecmp.cmp(
            again / "reconstruction" / "wall_map.npz", out / "reconstruction" / "wall_map.npz", shallow=False
        )
        print(f"the same as a replay: {same}")
        sys.exit(not same)


if __name__ == "__main__":
    main()
