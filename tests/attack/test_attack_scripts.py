"""Each attack that `make attack` tries gets nowhere."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
SCRIPTS = sorted(HERE.glob("attack_*.py"))


def test_make_attack_runs_them_all() -> None:
    makefile = (HERE.parents[1] / "Makefile").read_text()
    recipe = re.search(r"^attack: setup  ## .*\n((?:\t.*\n)+)", makefile, re.MULTILINE)
    assert recipe
    assert "tests/attack/attack_*.py" in recipe[1]
    assert {"attack_control.py", "attack_door.py", "attack_peers.py"} <= {script.name for script in SCRIPTS}


@pytest.mark.long
@pytest.mark.live
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda script: script.stem)
def test_an_attack_gets_nowhere(script: Path, tmp_path: Path) -> None:
    environment = os.environ | {"TMPDIR": str(tmp_path)}
    done = subprocess.run(
        [sys.executable, str(script)], cwd=HERE.parents[1], env=environment, capture_output=True, text=True, timeout=600
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout


# --- hostile files, in a process of its own ---------------------------------------------------------------------------


ATTACK = Path(__file__).with_name("attack_files.py")


def attack(*options: str) -> str:
    pytest.importorskip("trimesh")
    done = subprocess.run([sys.executable, str(ATTACK), *options], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.mark.long  # tests/recordings damages files in small
def test_some_damaged_files_and_small_bombs() -> None:
    output = attack("--files", "8", "--quick")
    assert "20 honest files, 8 damaged ones" in output
    assert "nothing failed" in output


@pytest.mark.long
@pytest.mark.parametrize("seed", ["1", "2"])
def test_four_hundred_damaged_files_and_all_bombs(seed: str) -> None:
    attack("--files", "400", "--seed", seed, *(["--commands"] if seed == "1" else []))
