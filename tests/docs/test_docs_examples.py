"""Every example runs, is short, and says something.

All but one run in this process, which has imported already what they import.
"""

from __future__ import annotations

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from foretouch.cli.app import app

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
PRESS = str(ROOT / "docs" / "examples" / "spring.csv")
WORDS = {
    "identify_a_press.py": [PRESS],
    "predict_behind_a_delay.py": [PRESS, "0.3"],
    "compare_laws.py": [PRESS],
    "read_a_session.py": ["session.mcap"],
}
LONG = ("compare_laws.py", "walk_through.py")
WRITTEN = {
    "identify_a_press.py": "identified.png",
    "compare_laws.py": "compared.png",
    "simulate_a_session.py": "session.png",
    "walk_through.py": "walk-through-session.png",
}
LONGEST = 80
NAMES = sorted(path.name for path in EXAMPLES.glob("*.py"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("examples")
    words = ["simulate", "--duration", "3", "--recording", str(folder / "session.mcap"), "--json"]
    assert CliRunner().invoke(app, words).exit_code == 0
    return folder


def test_each_example_is_short_and_says_what_it_shows() -> None:
    result = sorted(EXAMPLES.glob("*.py"))
    assert len(result) >= 8
    for path in result:
        lines = path.read_text().splitlines()
        assert len(lines) <= LONGEST, path.name
        assert lines[0].startswith('"""'), path.name
        assert f"examples/{path.name}" in path.read_text(), path.name


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name in LONG else name for name in NAMES]
)
@pytest.mark.first
def test_it_runs(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(folder)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.setattr(sys, "argv", [str(EXAMPLES / name), *WORDS.get(name, [])])
    runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    output = capsys.readouterr().out
    assert output.strip()
    assert "nan" not in output.lower().split()
    if name in WRITTEN:
        assert (folder / WRITTEN[name]).read_bytes().startswith(b"\x89PNG")


def test_the_walk_through_is_a_notebook_of_five_steps() -> None:
    """Cells of the percent format: a text with a heading and then code, five times."""
    _, *cells = (EXAMPLES / "walk_through.py").read_text().split("\n# %%")
    texts, codes = cells[0::2], cells[1::2]
    headings = [re.search(r"^ \[markdown\]\n# ## (\w+)\n", text) for text in texts]
    assert [result and result[1] for result in headings] == ["Read", "Identify", "Predict", "Simulate", "Plot"]
    for code in codes:
        compile(code, "cell", "exec")


@pytest.mark.long
def test_one_runs_in_a_process_of_its_own(folder: Path) -> None:
    words = [sys.executable, str(EXAMPLES / "read_a_session.py"), *WORDS["read_a_session.py"]]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.strip()


@pytest.mark.long
def test_a_type_checker_knows_what_the_examples_use() -> None:
    """Under --strict, so that every name at the top of the package is typed, and no result is Any by accident."""
    paths = sorted(EXAMPLES.glob("*.py"))
    options = ["--strict", "--cache-dir", str(ROOT / ".mypy_cache")]
    command = [sys.executable, "-m", "mypy", *options, *map(str, paths)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=600)
    assert (done.returncode, done.stderr) == (0, ""), done.stdout
