"""Damaged files of a run are refused in words; `test_fuzz.py` has a sample of far more."""

from __future__ import annotations

import io
import os
import shutil
import zipfile

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.found_run import read_arrays, read_found


@pytest.mark.parametrize("name", ["trajectory.tum", "wall_map.npz"])
def test_a_pipe_in_a_file_s_place_is_not_waited_for(found_folder, tmp_path, name):
    shutil.copytree(found_folder, tmp_path / "run")
    (tmp_path / "run" / "reconstruction" / name).unlink()
    os.mkfifo(tmp_path / "run" / "reconstruction" / name)
    with pytest.raises(BadInput, match=f"{name}: is no plain file"):
        read_found(tmp_path / "run")


def test_a_map_whose_depths_leave_no_bore_is_refused(found_folder, tmp_path):
    shutil.copytree(found_folder, tmp_path / "run")
    file = tmp_path / "run" / "reconstruction" / "wall_map.npz"
    with np.load(file) as held:
        arrays = dict(held)
    np.savez(file, **{**arrays, "wall_dev_mm": arrays["radius_mm"]})
    with pytest.raises(BadInput, match="wall_dev_mm: must be less than radius_mm"):
        read_found(tmp_path / "run")


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
