"""Mutates files of every kind, and holds each reader to a result or one clear line: no traceback, hang or flood."""

from __future__ import annotations

import argparse
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import zlib
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np

from campaigns.fuzz_kinds import Kind, every_kind
from campaigns.mutated_arrays import npy, npz, ply
from campaigns.mutated_bags import cdr, mcap, sqlite
from campaigns.mutated_pictures import png
from campaigns.mutated_text import Mutation, Rng, nested, pick, raw, table
from scenarios.document import BadInput
from sensor_model.recording import BadRecording, open_recording

ROOT = Path(__file__).resolve().parents[1]
LONGEST_S, MOST_MB = 2.0, 400  # of processor time and of memory, by one case
MUTATIONS: dict[str, Mutation] = {
    **dict.fromkeys((".csv", ".tum", ".asc", ".txt"), table),
    **dict.fromkeys((".yaml", ".json"), nested),
    ".png": png,
    ".npy": npy,
    ".npz": npz,
    ".ply": ply,
    ".mcap": mcap,
    ".db3": sqlite(cdr),
    ".sqlite": sqlite(lambda cell, rng: nested(cell, rng) if cell[:1] in b"[{" else raw(cell, rng)),
}
RAW_SHARE, ODD_SHARE = 0.1, 0.02  # of cases: bytes changed without regard to the kind; a file gone, linked or a folder
BAD = ("TRACEBACK", "HANGS", "SLOW", "FLOOD", "refused without a word")
PLACES = re.compile(r"/\S*|'[^']*'|\d+|\[.*?\]")


class Late(BaseException):
    """A case took too long; no reader's own handling of errors may keep it."""


class Outcomes(NamedTuple):
    """How often each thing became of a kind's cases, and how often each thing was said."""

    what: Counter[str]
    said: Counter[str]
    bad: Counter[str]


def mutate(sound: Path, case: Path, rng: Rng) -> Path:
    """Change one of a case's files, the small ones as often as the large; returns which."""
    files = [sound] if sound.is_file() else sorted(file for file in sound.rglob("*") if file.is_file())
    source = pick(files, rng)
    target = case / source.relative_to(sound) if sound.is_dir() else case
    target.unlink()  # the sound one is linked here
    if sound.is_dir() and rng.random() < ODD_SHARE:
        odd(target, rng)
        return target
    change = raw if rng.random() < RAW_SHARE else MUTATIONS.get(source.suffix, raw)
    target.write_bytes(change(source.read_bytes(), rng))
    return target


def odd(file: Path, rng: Rng) -> None:
    """Something in a file's place that is none, or nothing."""
    makers = (
        Path.mkdir,
        os.mkfifo,
        lambda _: None,
        lambda path: path.symlink_to(path),
        lambda path: path.symlink_to("/"),
    )
    pick(makers, rng)(file)


def one_case(kind: Kind, case: Path) -> tuple[str, str]:
    """Read one mutated file or folder; what became of it, and in which words."""
    signal.setitimer(signal.ITIMER_REAL, 10 * LONGEST_S)
    began, held_kb = time.process_time(), most_kb()
    try:
        kind.read(case)
        what, words = "read", ""
    except (BadInput, BadRecording) as error:
        words = PLACES.sub("#", (str(error).strip().splitlines() or [""])[0])[:80]
        what = "refused" if words else "refused without a word"
    except (Exception, Late) as error:
        what, words = {MemoryError: "FLOOD", Late: "HANGS"}.get(type(error), "TRACEBACK"), what_raised(error)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    if most_kb() - held_kb > MOST_MB * 1024:
        what = "FLOOD"
    return ("SLOW" if time.process_time() - began > LONGEST_S else what), words


def what_raised(error: BaseException) -> str:
    """Its kind, its words, and the last line of ours that it passed."""
    ours = [frame for frame in traceback.extract_tb(error.__traceback__) if frame.filename.startswith(str(ROOT))]
    ours = ours[:-1] if isinstance(error, Late) else ours  # the last is the alarm
    return f"{type(error).__name__} at {Path(ours[-1].filename).relative_to(ROOT)}:{ours[-1].lineno}: {str(error)[:80]}"


def most_kb() -> int:
    """The most memory that this process has held."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss


def lay_out(sound: Path, case: Path) -> None:
    """The sound files in a case's place, linked."""
    os.link(sound, case) if sound.is_file() else shutil.copytree(sound, case, copy_function=os.link)


def fuzz_kind(name: str, kind: Kind, cases: range, seed: int, folder: Path, bad: Path) -> Outcomes:
    """So many cases of one kind; what ends badly is kept, with the numbers that make it again."""
    found = Outcomes(Counter(), Counter(), Counter())
    work = folder / f"case {name}"
    work.mkdir()
    case = work / kind.sound.name
    lay_out(kind.sound, case)
    kind.read(case)  # or nothing would be said of those that are not sound
    for number in cases:
        if number % 50 == 0:  # readers write beside what they read
            shutil.rmtree(work)
            work.mkdir()
            lay_out(kind.sound, case)
        changed = mutate(kind.sound, case, np.random.default_rng([seed, number, zlib.crc32(name.encode())]))
        what, words = one_case(kind, case)
        if what == "SLOW":  # the first may have had something to compile
            what, words = one_case(kind, case)
        found.what[what] += 1
        found.said[words] += what == "refused"
        found.bad[words] += what in BAD
        if what in BAD and found.bad[words] == 1:  # of those alike, the first
            kept = bad / f"{name.replace(' ', '-')}-seed{seed}-case{number}" / case.name
            shutil.rmtree(kept.parent, ignore_errors=True)
            kept.parent.mkdir(parents=True)
            shutil.copytree(case, kept, symlinks=True, ignore=pipes) if case.is_dir() else shutil.copyfile(case, kept)
            print(f"{what}: --only '{name}' --seed {seed} --first {number}: {words}; kept as {kept}", flush=True)
        restore(kind.sound, case, changed)
    return found


def pipes(folder: str, names: list[str]) -> list[str]:
    """What cannot be copied."""
    return [name for name in names if (Path(folder) / name).is_fifo()]


def restore(sound: Path, case: Path, changed: Path) -> None:
    """The sound file put back."""
    if changed.is_dir() and not changed.is_symlink():
        shutil.rmtree(changed)
    changed.unlink(missing_ok=True)
    os.link(sound / changed.relative_to(case) if sound.is_dir() else sound, changed)


def fuzz(
    recording: Path, cases: int, seed: int, only: str = "", first: int = 0, bad: Path = Path("fuzz-bad")
) -> dict[str, Outcomes]:
    """So many cases of every kind, as its weight says, or of those whose name holds a text."""

    def late(*_: object) -> None:
        raise Late

    signal.signal(signal.SIGALRM, late)
    tally: dict[str, Outcomes] = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, kind in every_kind(recording, Path(folder)).items():
            if only not in name:
                continue
            began, count = time.process_time(), max(1, round(kind.weight * cases))
            tally[name] = fuzz_kind(name, kind, range(first, first + count), seed, Path(folder), bad)
            each_ms = 1e3 * (time.process_time() - began) / count
            print(f"{line(name, tally[name], each_ms)}; at most {most_kb() / 1024:.0f} MB", flush=True)
    return tally


def line(name: str, found: Outcomes, each_ms: float) -> str:
    """A kind's row: how deep its cases went is seen from what was read, and how many different things were said."""
    cases, read = found.what.total(), found.what["read"]
    common = max(found.said.values()) / cases
    ends = ", ".join(f"{what} {n}" for what, n in sorted(found.what.items()) if what in BAD) or "all well"
    depth = f"{100 * read / cases:5.1f} % read, {len(+found.said):4d} refusals, the commonest {100 * common:5.1f} %"
    return f"{name:<14} {cases:6d} cases, {depth}, {each_ms:5.1f} ms each; {ends}"


def main() -> None:
    """Every kind; a bad end is an exit status."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, help="a recording of slit pixels")
    parser.add_argument("--cases", type=int, default=3000, help="of a kind, times its weight")
    parser.add_argument("--seed", type=int, default=0, help="another gives other cases")
    parser.add_argument("--first", type=int, default=0, help="the first case's number")
    parser.add_argument("--only", default="", help="kinds that hold this text")
    parser.add_argument("--bad", type=Path, default=Path("fuzz-bad"), help="where cases that end badly are kept")
    given = parser.parse_args()
    open_recording(given.recording)
    tally = fuzz(given.recording, given.cases, given.seed, given.only, given.first, given.bad)
    total, bad = (
        sum(counts.what[w] for counts in tally.values() for w in counts.what if w in BAD or all_) for all_ in (1, 0)
    )
    print(f"{total} cases of {len(tally)} kinds, {bad} ended badly; at most {most_kb() / 1024:.0f} MB")
    sys.exit(bool(bad))


if __name__ == "__main__":
    main()
