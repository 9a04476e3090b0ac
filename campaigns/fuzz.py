"""Mutates logs of every kind, and holds each reader to a result or one clear line: no traceback, no hang, no flood."""

from __future__ import annotations

import argparse
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np

from scenarios.document import BadInput
from scenarios.field.export import export
from scenarios.field.live_log import next_due, open_live, read_more
from scenarios.field.read import read_log
from scenarios.field.told import Told
from sensor_model.recording import BadRecording, open_recording

LONGEST_S, MOST_MB = 2.0, 1500
Rng = np.random.Generator
INTERESTING = (
    b"\x00",
    b"\xff" * 8,
    b"-1",
    b"1e999",
    b"nan",
    b"\n",
    b",",
    b"9" * 30,
    b"\x89PNG",
    b"#",
    b"../",
    b"*a",
    b"&a",
    b"!!python",
)


def mutated(data: bytes, rng: Rng) -> bytes:
    """Some bytes changed, cut out, doubled, swapped or replaced by what often breaks a reader."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 6))):
        at = int(rng.integers(0, max(len(out), 1)))
        length = int(min(rng.geometric(0.05), len(out) - at)) if out else 0
        match int(rng.integers(0, 6)):
            case 0 if out:
                out[at] ^= 1 << int(rng.integers(0, 8))
            case 1:
                del out[at : at + length]
            case 2:
                out[at:at] = out[at : at + length]
            case 3:
                out[at : at + length] = bytes(rng.integers(0, 256, length, dtype=np.uint8))
            case 4:
                out[at:at] = INTERESTING[int(rng.integers(0, len(INTERESTING)))]
            case 5:
                del out[at:]
    return bytes(out)


def mutate(log: Path, rng: Rng) -> None:
    """Mutate one of a log's files, the small ones as often as the large."""
    files = sorted(file for file in ([log] if log.is_file() else log.rglob("*")) if file.is_file())
    file = files[int(rng.integers(0, len(files)))]
    data = file.read_bytes()
    file.unlink()
    file.write_bytes(mutated(data, rng))


def by_reader(log: Path, work: Path) -> None:
    """The log as a recording, and every frame of it."""
    recording, _ = read_log(log, Told(), work, lambda *_: None)
    for index in range(len(recording)):
        recording[index]


def by_live(log: Path, _: Path) -> None:
    """The log as it is followed."""
    live = open_live(log)
    if live is None:
        raise BadInput(["nothing to follow"])
    while read_more(live):
        pass
    while next_due(live, at_end=True) is not None:
        pass


def sound_logs(
    recording: Path, video: Path | None, folder: Path
) -> dict[str, tuple[Path, Callable[[Path, Path], None]]]:
    """One of each kind."""
    logs = {"recording": (recording, by_reader), "live": (recording, by_live)}
    for to in ("mcap", "rosbag2"):
        logs[to] = (export(recording, to, folder / f"log.{to}")[0], by_reader)
    if video is not None:
        logs["video"] = (export(video, "video", folder / "video")[0], by_reader)
    return logs


def one_case(log: Path, read: Callable[[Path, Path], None], folder: Path, rng: Rng) -> str:
    """Read one mutated log; what became of it."""
    target = folder / f"case{log.suffix}"
    shutil.copyfile(log, target) if log.is_file() else shutil.copytree(log, target)
    mutate(target, rng)
    signal.setitimer(signal.ITIMER_REAL, 5 * LONGEST_S)
    began = time.process_time()
    try:
        read(target, folder / "work")
        what = "read"
    except (BadInput, BadRecording) as error:
        what = "refused" if str(error).strip() else "refused without a word"
    except TimeoutError:
        what = "HANGS"
    except Exception:
        traceback.print_exc()
        what = "TRACEBACK"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    return "SLOW" if time.process_time() - began > LONGEST_S else what


def fuzz(recording: Path, video: Path | None, cases: int, seed: int) -> dict[str, Counter[str]]:
    """So many cases of every kind of log."""

    def late(*_: object) -> None:
        raise TimeoutError

    signal.signal(signal.SIGALRM, late)
    tally: dict[str, Counter[str]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, (log, read) in sound_logs(recording, video, Path(folder)).items():
            tally[name] = Counter()
            for case in range(cases):
                with tempfile.TemporaryDirectory(dir=folder) as own:
                    what = one_case(log, read, Path(own), np.random.default_rng([seed, case, len(name)]))
                tally[name][what] += 1
                if what not in ("read", "refused"):
                    print(f"{what}: {name}, seed {seed}, case {case}", flush=True)
    return tally


def main() -> None:
    """Every kind of log; a bad end is an exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="a short recording of slit pixels")
    parser.add_argument("--video", type=Path, help="a short recording of pictures")
    parser.add_argument("--cases", type=int, default=20_000)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    open_recording(given.recording)
    tally = fuzz(given.recording, given.video, given.cases, given.seed)
    memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    for name, counts in tally.items():
        print(f"{name:<10} {', '.join(f'{what} {n}' for what, n in sorted(counts.items()))}")
    print(f"at most {memory_mb:.0f} MB")
    bad = sum(n for counts in tally.values() for what, n in counts.items() if what not in ("read", "refused"))
    sys.exit(bool(bad) or memory_mb > MOST_MB)


if __name__ == "__main__":
    main()
