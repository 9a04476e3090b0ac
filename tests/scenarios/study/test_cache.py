"""The cache: made once, checked before it is used, never removed from under somebody, and within its limit."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from scenarios.document import BadInput
from scenarios.study import cache as module
from scenarios.study.cache import Cache, default_limit_bytes, entry_key


@pytest.fixture
def cache(tmp_path: Path) -> Cache:
    return Cache(tmp_path / "cache", 1e9)


class Maker:
    """Makes arrays and counts how often."""

    def __init__(self, size: int = 1000) -> None:
        self.size, self.times = size, 0

    def __call__(self) -> dict[str, np.ndarray]:
        """Some numbers and words."""
        self.times += 1
        return {"x": np.arange(self.size), "words": np.array(["a", "bc"])}


KEY = entry_key("one")


def test_an_entry_is_made_once(cache: Cache):
    make = Maker()
    for _ in range(3):
        found = cache.arrays("map", KEY, make)
    assert make.times == 1
    np.testing.assert_array_equal(found["x"], np.arange(1000))
    assert list(found["words"]) == ["a", "bc"]
    cache.arrays("map", entry_key("other"), make)
    cache.arrays("drive", KEY, make)
    assert make.times == 3


HARMS = {
    "a changed byte": lambda e: (e / "arrays.npz").write_bytes((e / "arrays.npz").read_bytes()[:-900] + b"\0" * 900),
    "half a file": lambda e: os.truncate(e / "arrays.npz", 500),
    "a lost file": lambda e: (e / "arrays.npz").unlink(),
    "a file too many": lambda e: (e / "more").write_text(""),
    "no list": lambda e: (e / "contents").unlink(),
    "half a list": lambda e: os.truncate(e / "contents", 20),
    "a list of elsewhere": lambda e: (e / "contents").write_text("0\n00000000 0 ../../x\n00000000\n"),
    "a list of bytes": lambda e: (e / "contents").write_bytes(b"\xff\xfe"),
}


@pytest.mark.parametrize("harm", HARMS)
def test_a_damaged_entry_is_made_again(cache: Cache, harm):
    make = Maker()
    cache.arrays("map", KEY, make)
    HARMS[harm](cache.folder / "map" / KEY)
    np.testing.assert_array_equal(cache.arrays("map", KEY, make)["x"], np.arange(1000))
    cache.arrays("map", KEY, make)
    assert make.times == 2


def test_a_failed_make_leaves_nothing(cache: Cache):
    def broken() -> dict[str, np.ndarray]:
        raise RuntimeError("no")

    with pytest.raises(RuntimeError, match="no"):
        cache.arrays("map", KEY, broken)
    assert list((cache.folder / "map").iterdir()) == []


def test_the_longest_unused_go_first_and_the_limit_holds(cache: Cache):
    make, keys = Maker(10_000), [entry_key(k) for k in range(4)]
    for age, key in enumerate(keys):
        cache.arrays("map", key, make)
        os.utime(cache.folder / "map" / key, (time.time() - 100 + age,) * 2)
    cache.arrays("map", keys[0], make)  # used again
    assert [size.entries for size in cache.sizes()] == [0, 0, 0, 4]
    assert cache.prune(2.5 * 80_000) > 0
    assert {path.name for path in (cache.folder / "map").iterdir()} == {keys[0], keys[3]}
    cache.prune(0.0)
    assert cache.sizes()[3] == ("map", 0, 0)


def test_an_entry_in_use_is_not_removed(cache: Cache):
    with cache.entry("map", KEY, lambda folder: (folder / "file").write_text("kept") and None) as place:
        assert cache.prune(0.0) == 0
        assert (place / "file").read_text() == "kept"
    assert cache.prune(0.0) > 0
    assert not place.exists()


def test_a_cache_of_no_size_keeps_nothing_but_works(tmp_path: Path):
    cache, make = Cache(tmp_path, 0.0), Maker()
    for _ in range(2):
        assert cache.arrays("map", KEY, make)["x"].size == 1000
    assert make.times == 2
    assert list((tmp_path / "map").iterdir()) == []


def test_what_dead_builders_left_is_cleared_away(cache: Cache, monkeypatch: pytest.MonkeyPatch):
    cache.arrays("map", KEY, Maker())
    left = cache.folder / "map" / ".partial-12345678-abcdef"
    left.mkdir()
    (cache.folder / "map" / ".trash-abc").mkdir()
    cache.prune()
    assert left.exists()  # its builder may have just begun
    monkeypatch.setattr(module, "DEAD_AFTER_S", -1.0)
    cache.prune()
    assert [path.name for path in (cache.folder / "map").iterdir()] == [KEY]


BUILD = """
import sys, time
from pathlib import Path
import numpy as np
from scenarios.study.cache import Cache
def make():
    with open(sys.argv[2], "a") as log:
        log.write("made\\n")
    time.sleep(0.2)
    return {"x": np.arange(1000)}
for _ in range(20):
    assert Cache(Path(sys.argv[1]), 1e9).arrays("map", sys.argv[3], make)["x"].sum() == 499500
"""


def test_processes_at_once_make_an_entry_once(tmp_path: Path):
    words = [sys.executable, "-c", BUILD, str(tmp_path / "cache"), str(tmp_path / "log"), KEY]
    builders = [subprocess.Popen(words) for _ in range(3)]
    assert [builder.wait(timeout=60) for builder in builders] == [0, 0, 0]
    assert (tmp_path / "log").read_text() == "made\n"


def test_no_pickle_is_ever_loaded(cache: Cache):
    with pytest.raises(ValueError, match="pickle"):
        cache.arrays("map", KEY, lambda: {"x": np.array([{}], dtype=object)})


@pytest.mark.parametrize("given", ["many", "-1", "inf", "nan"])
def test_a_limit_that_is_no_number_is_said(monkeypatch: pytest.MonkeyPatch, given: str):
    monkeypatch.setenv("PIPETWIN_CACHE_GB", given)
    with pytest.raises(BadInput, match="PIPETWIN_CACHE_GB"):
        default_limit_bytes()
