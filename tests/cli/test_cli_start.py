"""What a command costs before it does anything: what it imports, and the threads that libraries would start."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = ("numpy", "scipy", "numba", "matplotlib", "mujoco", "zenoh", "viser", "cv2", "joblib")


def run(script: str, **environment: str) -> str:
    unset = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    return subprocess.run(
        [sys.executable, "-c", script], env=unset | environment, capture_output=True, text=True, check=True
    ).stdout


@pytest.mark.parametrize("module", ["foretouch", "foretouch.cli.app"])
def test_help_and_import_load_nothing_heavy(module: str) -> None:
    loaded = json.loads(run(f"import {module}, sys, json; print(json.dumps(list(sys.modules)))"))
    assert not set(HEAVY) & set(loaded)


def test_pools_of_threads_are_bounded_unless_somebody_says_otherwise() -> None:
    script = (
        "import sys, os; sys.argv = ['foretouch', '--version']\n"
        "from foretouch.cli import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "import numpy; (numpy.ones((300, 300)) @ numpy.ones((300, 300))).sum()\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], len(os.listdir('/proc/self/task')))"
    )
    assert run(script).split()[-2:] == ["1", "1"]
    assert run(script, OPENBLAS_NUM_THREADS="2").split()[-2] == "2"


def test_ctrl_c_while_something_is_imported_is_no_error_of_it() -> None:
    script = (
        "import sys, foretouch.cli.app as app\n"
        "from foretouch.cli import main\n"
        "def importing(**options):\n"
        "    try: raise KeyboardInterrupt\n"
        "    except KeyboardInterrupt as error: raise ImportError('initialization failed') from error\n"
        "app.app = importing\n"
        "main()"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (130, "foretouch: interrupted\n")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
@pytest.mark.long
def test_an_output_that_is_full_is_said_in_one_line() -> None:
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [sys.executable, "-m", "foretouch", "plugins", "--json"], stdout=full, stderr=subprocess.PIPE, text=True
        )
    assert (done.returncode, done.stderr) == (2, "foretouch: the output cannot be written: No space left on device\n")
