"""The campaign of what sizing keeps, on as few scans as show that its parts still fit together."""

from __future__ import annotations

import sys


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
