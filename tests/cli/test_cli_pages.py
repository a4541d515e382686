"""Every page of the command line says what made it, and that command makes it again."""

from __future__ import annotations

import html
import shlex
import sys
from pathlib import Path

import pytest

from foretouch import __version__
from foretouch.cli.app import app

ROOT = Path(__file__).parents[2]
SPRING = str(ROOT / "docs" / "examples" / "spring.csv")
POSES = str(ROOT / "docs" / "examples" / "poses.csv")
SHORT = ["--duration", "2", "--recording", "s.mcap", "--report"]
WITH_A_SESSION = ("report", "replay")
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


def run(words: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["foretouch", *words])
    with pytest.raises(SystemExit) as end:
        app(words)
    assert end.value.code == 0


@pytest.mark.parametrize("name", SAID)
def test_it_says_version_date_command_and_what_it_is_of(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    words, said = SAID[name]
    monkeypatch.chdir(tmp_path)
    if name in WITH_A_SESSION:
        run(["simulate", *SHORT, "first"], monkeypatch)
    run(words, monkeypatch)
    page = (tmp_path / "page" / "index.html").read_text()
    if name == "simulate":
        assert "yes; in an open loop no force moves the hand" in page
    made = html.unescape(page.partition('<footer class="made">')[2])
    assert f"foretouch {__version__}" in made
    assert " UTC" in made
    assert f"<code>{shlex.join(['foretouch', *words])}</code>" in made
    for part in said:
        assert part in made, part
