"""Hostile files: see `attack_files`, which this runs in a process of its own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("trimesh")

ATTACK = Path(__file__).with_name("attack_files.py")


def attack(*options: str) -> str:
    done = subprocess.run([sys.executable, str(ATTACK), *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_some_damaged_files_and_small_bombs() -> None:
    said = attack("--files", "8", "--quick")
    assert "20 honest files, 8 damaged ones" in said
    assert "nothing failed" in said


@pytest.mark.long
@pytest.mark.parametrize("seed", ["1", "2"])
def test_four_hundred_damaged_files_and_all_bombs(seed: str) -> None:
    attack("--files", "400", "--seed", seed, *(["--commands"] if seed == "1" else []))
