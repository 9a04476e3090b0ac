"""The tutorial, block by block: its files are written, and its commands run, as a reader would."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from typer.testing import CliRunner

from scenarios.cli import app

TUTORIAL = Path(__file__).resolve().parents[1] / "docs" / "tutorial.md"
BLOCK = re.compile(r"^```(yaml|sh)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FILE_OF = {"client-pipe": "pipe.yaml", "client-job": "plan.yaml"}


def test_every_command_of_the_tutorial_works(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PIPETWIN_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr("scenarios.plan.studies.CAUSES", {})  # the same scans again, which take most of the time
    ran = []
    for kind, text in BLOCK.findall(TUTORIAL.read_text()):
        if kind == "yaml":
            name = re.match(r"name: (\S+)", text)
            assert name is not None
            few = "scans: 4\n" if name[1] == "client-job" else ""  # enough to see it work, not to promise anything
            Path(FILE_OF[name[1]]).write_text(text + few)
            continue
        for line in text.splitlines():
            words = shlex.split(line)
            assert words[0] == "pipetwin"
            done = CliRunner().invoke(app, words[1:], catch_exceptions=False)
            assert done.exit_code == 0, done.output
            ran.append(words[1])
    assert ran == ["check", "run", "twin-page", "export", "plan"]
    score = json.loads(Path("runs/client-pipe/score.json").read_text())
    assert score["defects_found"] == 2
    assert json.loads(Path("plans/client-job/plan.json").read_text())["decision"] == "open"
    assert Path("runs/client-pipe/twin.html").stat().st_size > 10_000


@pytest.mark.parametrize("page", ["field", "identify"])
def test_pages_that_the_tutorial_names_are_there(page):
    assert (TUTORIAL.parent / f"{page}.md").is_file()
    assert f"docs/{page}.md" in TUTORIAL.read_text()
