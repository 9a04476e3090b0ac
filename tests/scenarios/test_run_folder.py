"""A run's folder is whole or not there at all, and nothing of anybody else's is ever replaced."""

from __future__ import annotations

import io
import json
from pathlib import Path

import pytest

from scenarios import run_folder as module
from scenarios.document import BadInput
from scenarios.progress import Progress
from scenarios.run_folder import run_folder, whole_file


def write_run(folder: Path, text: str) -> None:
    (folder / "truth").mkdir()
    (folder / "truth" / "pose.csv").write_text(text)
    (folder / "run.json").write_text(json.dumps({"pipetwin": text}))


OLD = '{"pipetwin": "old"}'


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_appears_only_when_whole(tmp_path: Path) -> None:
    target = tmp_path / "runs" / "one"
    with run_folder(target) as work:
        write_run(work, "new")
        assert work.parent == target.parent
        assert not target.exists()
    assert names(tmp_path / "runs") == ["one"]
    assert names(target) == ["run.json", "truth"]


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_failure_leaves_nothing_and_keeps_the_older_run(tmp_path: Path, error: type[BaseException]) -> None:
    target = tmp_path / "one"
    for _ in range(2):
        with pytest.raises(error), run_folder(target) as work:  # noqa: PT012  the block is what is tested
            write_run(work, "half")
            raise error
        assert names(tmp_path) == (["one"] if target.exists() else [])
        target.mkdir(exist_ok=True)
        (target / "run.json").write_text(OLD)
    assert (target / "run.json").read_text() == OLD


@pytest.mark.parametrize("atomic", [True, False])
def test_an_older_run_is_replaced_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, atomic: bool) -> None:
    if not atomic:
        monkeypatch.setattr(module, "_exchange", lambda *_: False)
    target = tmp_path / "one"
    target.mkdir()
    (target / "run.json").write_text(OLD)
    (target / "score.json").write_text("old")
    with run_folder(target) as work:
        write_run(work, "new")
    assert names(tmp_path) == ["one"]
    assert names(target) == ["run.json", "truth"]


def test_the_exchange_is_atomic_here(tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / name).write_text("")
    if not module._exchange(tmp_path / "one", tmp_path / "other"):
        pytest.skip("this file system cannot exchange names")
    assert names(tmp_path / "one") == ["other"]
    assert names(tmp_path / "other") == ["one"]


def test_a_run_without_its_mark_is_a_failure(tmp_path: Path) -> None:
    with pytest.raises(RuntimeError, match=r"without writing run\.json"), run_folder(tmp_path / "one") as work:
        (work / "score.json").write_text("{}")
    assert names(tmp_path) == []


def test_refuses_what_is_no_run(tmp_path: Path) -> None:
    mine = tmp_path / "thesis"
    mine.mkdir()
    (mine / "chapter1.tex").write_text("dear")
    with pytest.raises(BadInput, match="no pipetwin run"), run_folder(mine):
        pytest.fail("must not begin")
    assert names(mine) == ["chapter1.tex"]


def test_refuses_what_became_no_run_meanwhile(tmp_path: Path) -> None:
    target = tmp_path / "one"
    with pytest.raises(BadInput, match="no pipetwin run"), run_folder(target) as work:  # noqa: PT012
        write_run(work, "new")
        target.mkdir()
        (target / "note.txt").write_text("dear")
    assert names(tmp_path) == ["one"]
    assert names(target) == ["note.txt"]


def test_refuses_files_links_and_the_folder_you_are_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("dear")
    (tmp_path / "link").symlink_to(tmp_path)
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    for target, why in [("../file", "no folder"), ("../link", "no folder"), (".", "you are in"), ("/", "no place")]:
        with pytest.raises(BadInput, match=why), run_folder(Path(target)):
            pytest.fail("must not begin")
    assert (tmp_path / "file").read_text() == "dear"


@pytest.mark.parametrize("target", ["file/below", "/proc/nothing/here", "x" * 300, "nul\0"])
def test_an_unwritable_place_is_one_clear_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, target: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "file").write_text("")
    with pytest.raises(BadInput) as caught, run_folder(Path(target)):
        pytest.fail("must not begin")
    assert len(caught.value.lines) == 1
    assert "cannot be written" in caught.value.lines[0]
    assert "-o" in caught.value.lines[0]
    assert names(tmp_path) == ["file"]


def test_whole_file(tmp_path: Path) -> None:
    target = tmp_path / "pipe.stl"
    target.write_text("old")
    with pytest.raises(ValueError, match="no"), whole_file(target) as work:  # noqa: PT012
        work.write_text("half")
        raise ValueError("no")
    assert (names(tmp_path), target.read_text()) == (["pipe.stl"], "old")
    with whole_file(target) as work:
        assert work.suffix == ".stl"
        work.write_text("new")
    assert (names(tmp_path), target.read_text()) == (["pipe.stl"], "new")
    with pytest.raises(BadInput, match="cannot be written"), whole_file(tmp_path / "none" / "pipe.stl"):
        pytest.fail("must not begin")


class Screen(io.StringIO):
    """A terminal, as far as anyone can tell."""

    def isatty(self) -> bool:  # noqa: D102
        return True


def follow(out: io.StringIO, step_s: float) -> str:
    now = [0.0]
    progress = Progress(out, clock=lambda: now[0])
    for done in range(41):
        progress("draw", done, 40)
        now[0] += step_s
    progress("score", 1, 1)
    return out.getvalue()


def test_progress_when_piped_is_a_line_every_few_seconds() -> None:
    lines = follow(io.StringIO(), 0.5).splitlines()
    assert lines[0] == "draw: 10 of 40, 2 a second, 15 s left"
    assert lines[-2:] == ["draw: 40 of 40, 2 a second, took 20 s", "score: 1 of 1"]
    assert len(lines) == 5


def test_progress_on_a_terminal_is_a_bar_on_one_line() -> None:
    text = follow(Screen(), 0.5)
    assert text.count("\n") == 2
    assert "\r\x1b[Kdraw: 20 of 40, 2 a second, 10 s left  [############............]" in text


@pytest.mark.parametrize("foreign", [("run.json", "{}"), ("run.json", "old"), ("thesis.tex", "dear")])
def test_what_is_no_run_of_ours_is_left_alone(tmp_path: Path, foreign: tuple[str, str]) -> None:
    target = tmp_path / "one"
    target.mkdir()
    (target / "run.json").write_text(OLD)
    (target / foreign[0]).write_text(foreign[1])
    with pytest.raises(BadInput, match="no pipetwin run"), run_folder(target):
        pass
    assert (target / foreign[0]).read_text() == foreign[1]
