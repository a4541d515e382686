"""Every page of the command line says what made it, and that command makes it again."""

from __future__ import annotations

import html
import shlex
import shutil
import sys
from pathlib import Path

import pytest

from foretouch import __version__
from foretouch.cli.app import app

ROOT = Path(__file__).parents[2]
SPRING = str(ROOT / "docs" / "examples" / "spring.csv")
POSES = str(ROOT / "docs" / "examples" / "poses.csv")
SHORT = ["--duration", "1.3", "--recording", "s.mcap", "--report"]
SAID = {
    "simulate": (["simulate", *SHORT, "page"], ["SHA-256"]),
    "report": (["report", "s.mcap", "--report", "page"], ["s.mcap (SHA-256 "]),
    "replay": (["replay", "s.mcap", "--report", "page"], ["s.mcap (SHA-256 "]),
    "predict": (
        ["predict", SPRING, "--model", "kelvin-voigt", "--delay", "0.2", "--report", "page"],
        ["kelvin-voigt", "0.2 s", "spring.csv (SHA-256 ", "estimator", "contact floor"],
    ),
    "compare": (
        ["compare", SPRING, "--models", "kelvin-voigt", "--jobs", "1", "--report", "page"],
        ["kelvin-voigt", "0.3 s", "spring.csv (SHA-256 "],
    ),
    "calibrate": (["calibrate", "sensor", POSES, "--report", "page"], ["poses.csv (SHA-256 ", "0,0,1"]),
    "sweep": (
        ["sweep", "--sessions", "1", "--baselines", "0", "--duration", "2", "--jobs", "1", "--out", "page"],
        ["sessions 1, baselines 0, duration 2, seed 0"],
    ),
    "reproduce": (["reproduce", "--only", "fig2", "--out", "page"], ["10.1007/s40747-021-00464-0", "fig2"]),
}


def run(words: list[str], folder: Path) -> None:
    with pytest.MonkeyPatch.context() as monkeypatch:
        monkeypatch.chdir(folder)
        monkeypatch.setattr(sys, "argv", ["foretouch", *words])
        with pytest.raises(SystemExit) as end:
            app(words)
    assert end.value.code == 0


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a session was simulated, with its page."""
    folder = tmp_path_factory.mktemp("simulated")
    run(SAID["simulate"][0], folder)
    return folder


LONG = ("replay", "sweep", "reproduce")
"""The others are made in the same way, and take less long."""


@pytest.mark.parametrize("name", [pytest.param(one, marks=pytest.mark.long) if one in LONG else one for one in SAID])
@pytest.mark.first
def test_it_says_version_date_command_and_what_it_is_of(name: str, simulated: Path, tmp_path: Path) -> None:
    words, output = SAID[name]
    folder = simulated
    if name != "simulate":
        folder = tmp_path
        shutil.copy(simulated / "s.mcap", folder)
        run(words, folder)
    page = (folder / "page" / "index.html").read_text()
    if name == "simulate":
        assert "yes; in an open loop no force moves the hand" in page
    made = html.unescape(page.partition('<footer class="made">')[2])
    assert f"foretouch {__version__}" in made
    assert " UTC" in made
    assert f"<code>{shlex.join(['foretouch', *words])}</code>" in made
    for part in output:
        assert part in made, part
