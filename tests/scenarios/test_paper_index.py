"""The index of the paper: no empty row, names that import, commands that exist, values that come from results."""

from __future__ import annotations

import json

import pytest
import typer
from typer.testing import CliRunner

from scenarios.cli import app
from scenarios.document import BadInput
from scenarios.paper import index, made
from scenarios.paper.checked import DOES_NOT, named
from scenarios.paper.entries import ENTRIES


@pytest.fixture(scope="module")
def rows(tmp_path_factory):
    return index.rows_of(tmp_path_factory.mktemp("nothing"))


def test_every_equation_figure_and_table_has_one_full_row(rows):
    items = [f"Eq. {n}" for n in range(1, 33)] + [f"Fig. {n}" for n in range(1, 19)]
    assert [row["item"] for row in rows] == items + [f"Table {n}" for n in range(1, 5)]
    for row in rows:
        assert set(row) == set(index.COLUMNS)
        assert all(cell.strip() for cell in row.values()), row["item"]


def test_what_needs_no_run_is_there_and_holds(rows):
    unmade = {row["item"] for row in rows if row["ours"] == made.NOT_MADE.ours}
    assert unmade == {entry.item for entry in ENTRIES if entry.check is None}
    assert not [row["item"] for row in rows if row["verdict"] == DOES_NOT]
    values = {row["item"]: row["ours"] for row in rows}
    assert values["Eq. 31"].startswith("1.62 / 0.68 / 0.82 mm")
    assert "16884 counts" in values["Fig. 8"]


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.item)
def test_names_import_and_commands_exist(entry):
    assert callable(named(entry.where))
    command = typer.main.get_command(app)
    for word in entry.command.split():
        if not hasattr(command, "commands"):
            break
        assert word in command.commands
        command = command.commands[word]
    assert not hasattr(command, "commands")


def test_a_broken_equation_shows(monkeypatch):
    monkeypatch.setattr("scenarios.paper.merit_checks.err_pct", lambda *_: 1.0)
    row = index._row(next(entry for entry in ENTRIES if entry.item == "Eq. 29"), made.Path())
    assert row["verdict"] == DOES_NOT


def test_a_result_is_read_and_judged(tmp_path):
    def table4(*qualities):
        folder = tmp_path / "paper" / "table4"
        folder.mkdir(parents=True, exist_ok=True)
        losses = zip((75.0, 50.0, 25.0), qualities, strict=True)
        (folder / "table4.json").write_text(json.dumps([{"wall_loss_pct": a, "quality_pct": b} for a, b in losses]))
        return made.table4(tmp_path)

    assert table4(99.0, 98.0, 97.5) == ("99.0 / 98.0 / 97.5 %", "better")
    assert table4(99.0, 98.0, 60.0).verdict == DOES_NOT
    (tmp_path / "paper" / "table4" / "scenario.yaml").write_text("sensing:\n  fidelity: points\n")
    row = index._row(next(entry for entry in ENTRIES if entry.item == "Table 4"), tmp_path)
    assert row["ours"] == "99.0 / 98.0 / 60.0 % (points)"
    (tmp_path / "paper" / "table4" / "table4.json").write_text("{")
    with pytest.raises(BadInput, match=r"table4\.json: is no JSON"):
        made.table4(tmp_path)


def test_alone_the_command_prints_the_index_and_writes_a_page(tmp_path, monkeypatch, rows):
    monkeypatch.setattr(index, "rows_of", lambda _: rows)
    said = CliRunner().invoke(app, ["paper", "--json"])
    assert said.exit_code == 0, said.exception
    assert json.loads(said.stdout) == rows
    page = tmp_path / "index.html"
    assert "36 of 54 made" in CliRunner().invoke(app, ["paper", "index", "-o", str(page)]).stdout
    assert page.read_text().count("<tr>") == 54 + 3
