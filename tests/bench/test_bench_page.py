"""The page of the documentation that the benchmarks fill."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from foretouch.bench import BENCHMARKS

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_every_benchmark_has_its_block_and_figures() -> None:
    text = (DOCS / "speed.md").read_text()
    blocks = dict(re.findall(r"<!-- measured: ([a-z-]+) of \w+ -->\n(.*?)<!-- end -->", text, re.DOTALL))
    assert list(blocks) == ["machine", *[name for name in blocks if name != "machine"]]
    assert set(blocks) == {"machine", *BENCHMARKS}
    for name in BENCHMARKS:
        assert f"`foretouch bench --only {name}`" in blocks[name]
        assert re.search(r"\n(- |\| .+\n\| )", blocks[name]), f"{name} has no rows"


ASKED = """
import json
import measure_speed
import numba
from foretouch.bench import Row
rows = [Row("a time", 2.0, "us", 1.0), Row("a ratio", 3.0, "x", 2.0, True, (2.5, 3.5), 7), Row("a detail", 4.0, "x")]
print(json.dumps({
    "block": measure_speed.block("call", rows, "2026-01-02, commit abc"),
    "unasked": measure_speed.block("mesh", [Row("a time", 5.0, "us"), rows[-1]], "2026-01-02"),
    "machine": measure_speed.machine(),
    "circumstances": measure_speed.circumstances(),
    "threads": numba.config.NUMBA_NUM_THREADS,
}))
"""


@pytest.fixture(scope="module")
def said() -> dict[str, Any]:
    """What the script says in a process of its own."""
    pytest.importorskip("matplotlib")
    done = subprocess.run([sys.executable, "-c", ASKED], cwd=DOCS, capture_output=True, text=True, check=True)
    answer: dict[str, Any] = json.loads(done.stdout)
    return answer


@pytest.mark.long
def test_a_block_is_a_list_with_ratios_first(said: dict[str, Any]) -> None:
    lines = said["block"].splitlines()
    assert lines[0] == "`foretouch bench --only call`, 2026-01-02, commit abc:"
    assert lines[2:] == ["- a ratio: 3 x (asked: ≥ 2)", "- a time: **2 us** (asked: ≤ 1, missed)"]
    assert said["unasked"].splitlines()[2:] == ["- a detail: 4 x"]
    assert said["machine"].startswith("Measured on ")
    assert re.match(r"\d{4}-\d\d-\d\d(, [0-9a-f]+)?(, load \d+\.\d|$)", said["circumstances"])


@pytest.mark.long
def test_plots_are_measured_on_one_core(said: dict[str, Any]) -> None:
    assert said["threads"] == 1
