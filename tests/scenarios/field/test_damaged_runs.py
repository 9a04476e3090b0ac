"""Damaged files are refused in words, or read: never a traceback."""

from __future__ import annotations

import random
import shutil

import pytest

from scenarios.document import BadInput
from scenarios.field.export_tally import tally
from scenarios.field.match import matched
from scenarios.field.scan_file import read_scan
from scenarios.found_run import read_found

CASES = 25
TOKENS = [b"nan", b"inf", b"-1", b"1e308", b"0", b"9" * 20, b"\xff", b"\0", b",", b"\n", b'"', b"-"]


def damaged(data: bytes, rng: random.Random) -> bytes:
    """A few bytes changed, put in, taken out or doubled, mostly near the beginning."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 4)):
        at = rng.randrange(len(out) + 1 if rng.random() < 0.5 else min(len(out), 400) + 1)
        what = rng.randrange(4)
        if what == 0:
            out[at : at + 1] = rng.choice([b"7", b".", b" ", b"e", b"\x80"])
        elif what == 1:
            out[at:at] = rng.choice(TOKENS)
        elif what == 2:
            del out[at : at + rng.randint(1, 40)]
        else:
            out[at:at] = out[at : at + 30]
    return bytes(out)


@pytest.mark.parametrize("name", ["defects.csv", "episodes.csv", "trajectory.tum", "wall_map.npz", "cloud.ply"])
def test_damaged_files_are_refused_in_words(found_folder, tmp_path, name):
    rng, good = random.Random(name), read_found(found_folder)
    shutil.copytree(found_folder, tmp_path / "run")
    file = tmp_path / "run" / "reconstruction" / name
    data, refused = file.read_bytes(), []
    for _ in range(CASES):
        file.write_bytes(damaged(data, rng))
        try:
            if name == "cloud.ply":
                read_scan(file, name)
            else:
                run = read_found(tmp_path / "run")
                tally(run)
                matched(good, run)
        except BadInput as error:
            refused.append(str(error))
    assert refused
    assert all(str(file) in words for words in refused)
