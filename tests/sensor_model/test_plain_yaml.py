"""Plain data out of YAML: what YAML 1.2 says of scalars, and nothing that makes an object or unfolds."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from sensor_model.plain_yaml import plain_data

ROOT = Path(__file__).resolve().parents[2]
TIMED = """
import time
from sensor_model.plain_yaml import plain_data
text = "jag_deg: [" + "-0.12345, " * 100_000 + "0]"
began = time.process_time()
assert len(plain_data(text)["jag_deg"]) == 100_001
print(time.process_time() - began)
"""


@pytest.mark.parametrize(
    "text",
    [
        "a: 1\nb: [1e-5, -0.5, .5, +3, 010, 1_000, 12:30, 2026-11-23]\nc: {on: yes, off: ~, '': null}\n",
        "- 'it''s'\n- \"a\\tb\"\n- |\n  two\n  lines\n- >-\n  folded\n  text\n-\n",
        "{a: {b: [], c: {}}, d: [[1, 2], [3]]} # said\n",
        "---\ntrue\n...\n",
        "",
    ],
)
def test_it_is_what_another_reader_of_yaml_1_2_reads(text):
    def loosely(value):  # that one knows dates, and underscores in numbers
        if isinstance(value, dict):
            return {str(key): loosely(item) for key, item in value.items()}
        return [loosely(item) for item in value] if isinstance(value, list) else str(value).replace("_", "")

    assert loosely(plain_data(text)) == loosely(YAML(typ="safe", pure=True).load(text))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\nb: ]", "line 2: not YAML: did not find expected node content"),
        ("a: &x [1]\nb: *x", r"line 2: aliases \(\*x\) are not taken"),
        ("a: !!python/name:os.system x", r"line 1: tags \(.*\) are not taken"),
        ("a: 1\na: 2", "line 2: key a is there twice"),
        ("? [1]\n: 2", "line 1: key .* no plain text"),
        ("--- 1\n--- 2", "second document"),
        ("a: \0", "not YAML"),
        ("a: \udcff", "not YAML"),
        ("[" * 300_000, "nested more than 32 deep"),
        ("- " * 300_000, "nested more than 32 deep"),
    ],
)
def test_what_it_does_not_take_is_named_with_its_line(text, said):
    with pytest.raises(ValueError, match=said):
        plain_data(text)


def test_a_megabyte_is_read_within_two_seconds():
    # by itself, as a user has it: here every call's types are checked, which takes three times as long
    done = subprocess.run([sys.executable, "-c", TIMED], cwd=ROOT, capture_output=True, text=True, check=True)
    assert float(done.stdout) < 2
