"""Damaged files are refused in words, or read: never a traceback."""

from __future__ import annotations

import io
import random
import shutil
import zipfile

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.field.export_tally import tally
from scenarios.field.match import matched
from scenarios.field.scan_file import read_scan
from scenarios.found_run import read_arrays, read_found

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


def _headed(text: str) -> bytes:
    """An .npy of three numbers under a header."""
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode() + bytes(24)


HEAD = "{{'descr': '{}', 'fortran_order': False, 'shape': ({},), }}"


@pytest.mark.parametrize(
    ("member", "said"),
    [
        (b"no array", "the magic string is not correct"),
        (_headed(HEAD.format("<f8", 10**12)), r"shape \(1000000000000,\) of float64 is promised, 24 bytes are held"),
        (_headed(HEAD.format("|O", 3)), "got object; numbers are expected"),
        (_headed(HEAD.format("<U6", 1)), "got <U6; numbers are expected"),
        (_headed("-" * 5000 + "1"), "cannot be read"),
        (_headed("[(\n"), "cannot be read"),
    ],
)
def test_an_array_is_looked_at_before_it_is_believed(member, said, tmp_path):
    file = tmp_path / "arrays.npz"
    with zipfile.ZipFile(file, "w") as parts:
        parts.writestr("a.npy", member)
    with pytest.raises(BadInput, match=said):
        read_arrays(file, ("a",), 10**6)


def test_an_archive_for_another_program_is_refused_in_words(tmp_path):
    """Its member is encrypted, by the flag in the central directory."""
    packed = io.BytesIO()
    np.savez(packed, a=np.arange(3))
    data = bytearray(packed.getvalue())
    data[data.find(b"PK\x01\x02") + 8] |= 1
    (tmp_path / "arrays.npz").write_bytes(data)
    with pytest.raises(BadInput, match=r"arrays\.npz: cannot be read: .*encrypted"):
        read_arrays(tmp_path / "arrays.npz", ("a",), 10**6)
