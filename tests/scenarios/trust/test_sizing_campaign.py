"""The campaign of what sizing keeps, on as few scans as show that its parts still fit together."""

from __future__ import annotations

import sys

import numpy as np


def test_two_scans_of_mixed_defects_are_judged(campaign, monkeypatch, capsys, tmp_path):
    sizing = campaign("sizing")
    asked = ["sizing", "sheets", "--scans", "2", "--first", "3000", "--maps", str(tmp_path)]
    monkeypatch.setattr(sys, "argv", asked)
    sizing.main()
    said = capsys.readouterr().out
    assert "Detected, on all wall: 18 of 18" in said
    assert "0 false calls on" in said
    assert "length_mm, odd scans, as stated: held" in said
    assert len(list(tmp_path.glob("*.npz"))) == 2
    sizing.main()  # from the kept maps
    assert capsys.readouterr().out == said


def test_what_is_asked_holds_or_falls_short_by_its_worst(campaign, monkeypatch, capsys):
    asked = campaign("sizing_asked")
    # depth; errors of length, width and depth; Eq. 29, the oracle's, Eq. 30
    rows = [[loss * 7.5, 0.3, -0.2, 0.02, 0.5, 5.0, 0.4] for loss in (1.0, 0.75, 0.5, 0.25)]
    worse = [7.5, 1.6, -0.2, 0.02, 2.4, 5.0, 1.6]
    monkeypatch.setattr(asked, "paper", lambda _: np.array([*rows, *rows, worse]))
    monkeypatch.setattr(sys, "argv", ["sizing_asked", "--only", "paper"])
    asked.main()
    said = capsys.readouterr().out.splitlines()
    assert [line.split("  ")[0] for line in said if line.endswith("FALLS SHORT")] == [
        "70 x 35 x 7.5 mm: length",
        "Eq. 29, every scan",
    ]
    assert sum(line.endswith("holds") for line in said) == 10
