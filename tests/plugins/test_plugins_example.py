"""The example of a plug-in, installed as a package is, in processes of their own and in this one."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plugin_packages import EXAMPLE
from typer.testing import CliRunner

from foretouch.cli.app import app
from foretouch.errors import ForetouchError
from foretouch.plugins import all_plugins
from foretouch.session import SessionSettings

ROOT = EXAMPLE.parents[1]


@pytest.fixture(scope="session")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the example in it, as `pip install` leaves it."""
    folder = tmp_path_factory.mktemp("installed")
    source = shutil.copytree(EXAMPLE, folder / "source")
    target = folder / "site"
    pip = [sys.executable, "-m", "pip", "install", "-q", "--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run([*pip, "--target", str(target), str(source)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return target


def run(installed: Path, *words: str, folder: Path) -> Any:
    """What a command prints as JSON, in a process where the example is installed."""
    environment = os.environ | {"PYTHONPATH": os.pathsep.join([str(installed), os.environ.get("PYTHONPATH", "")])}
    command = [sys.executable, "-m", "foretouch", *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=environment, timeout=120)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.fixture
def here(installed: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., Any]]:
    """The same in this process, as if the example had just been installed beside it."""
    for name in [name for name in sys.modules if name.partition(".")[0] == "foretouch_plugin_example"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(str(installed))
    monkeypatch.chdir(tmp_path)
    all_plugins.cache_clear()

    def call(*words: str) -> Any:
        result = CliRunner().invoke(app, [*words, "--json"])
        assert result.exit_code == 0, result.exception
        return json.loads(result.stdout)

    yield call
    all_plugins.cache_clear()


def press(path: Path) -> Path:
    """Presses of a Kelvin-Voigt material, 600 N/m and 2 N s/m."""
    time = np.arange(0.0, 6.0, 1e-3)
    position = 0.010 + 0.006 * np.sin(2.0 * math.pi * 0.9 * time - 1.5)
    depth, velocity = np.maximum(position - 0.010, 0.0), np.gradient(position, time)
    force = np.where(depth > 0.0, np.maximum(600.0 * depth + 2.0 * velocity, 0.0), 0.0) + 0.5
    force += 0.005 * np.random.default_rng(3).standard_normal(time.size)
    rows = (f"{t:.4f},{x:.7f},{f:.6f}" for t, x, f in zip(time, position, force, strict=True))
    path.write_text("time_s,position_m,force_N\n" + "\n".join(rows) + "\n")
    return path


def test_files_are_short() -> None:
    assert max(len(path.read_text().splitlines()) for path in EXAMPLE.rglob("*.py")) < 80


@pytest.mark.long
def test_it_is_listed_with_its_package_and_passes_the_checks(
    installed: Path, here: Callable[..., Any], tmp_path: Path
) -> None:
    rows = run(installed, "plugins", folder=tmp_path)["plugins"]
    assert here("plugins")["plugins"] == rows
    own = [row for row in rows if row["package"] == "foretouch-plugin-example"]
    assert [(row["kind"], row["name"], row["version"], row["status"]) for row in own] == [
        ("device", "swing", "0.1.0", "ok"),
        ("estimator", "windowed", "0.1.0", "ok"),
    ]
    assert here("plugins", "check", "windowed")["passed"]
    assert Path(sys.modules["foretouch_plugin_example.windowed"].__file__ or "").is_relative_to(installed)


@pytest.mark.long
def test_its_estimator_is_compared_identified_and_simulated(here: Callable[..., Any], tmp_path: Path) -> None:
    press(tmp_path / "press.csv")
    chosen = ("--models", "kelvin-voigt", "--estimators", "windowed", "--jobs", "1")
    results = {row["estimator"]: row for row in here("compare", "press.csv", *chosen)["results"]}
    assert results["windowed"]["status"] == "ok"
    assert results["windowed"]["predictions"][0]["prediction_error_percent"] < 5.0
    result = here("identify", "press.csv", "--model", "kelvin-voigt", "--estimator", "windowed")
    assert result["parameters"]["stiffness"] == pytest.approx(600.0, rel=0.03)


@pytest.mark.long
def test_its_device_moves_a_simulated_session(here: Callable[..., Any], installed: Path) -> None:
    words = ("simulate", "--operator", "swing", "--material", "hunt-crossley", "--duration", "4")
    report = here(*words, "--recording", "s.mcap")
    assert report["settings"]["operator"] == "swing"
    assert report["contact_force_rms_N"] > 1.0
    refused = CliRunner().invoke(app, ["simulate", "--operator", "swin", "--duration", "1"]).exception
    choices = ", ".join(sorted(SessionSettings().operators()))
    assert isinstance(refused, ForetouchError)  # one line and exit code 2
    assert str(refused) == f"unknown operator 'swin': choose one of {choices}"
    # Who has the recording and not the package reads it all the same.
    sys.path.remove(str(installed))
    all_plugins.cache_clear()
    assert "swing" not in {row["name"] for row in here("plugins")["plugins"]}
    assert here("report", "s.mcap")["settings"]["operator"] == "swing"


@pytest.mark.live
@pytest.mark.long  # in a simulated session its device is tried just above
def test_its_device_and_estimator_are_found_by_the_processes_of_a_session(installed: Path, tmp_path: Path) -> None:
    law = ("--model", "kelvin-voigt", "--estimator", "windowed", "--material", "kelvin-voigt")
    words = ("teleop", "--headless", "--operator", "swing", *law, "--duration", "6")
    report = run(installed, *words, "--recording", "s.mcap", folder=tmp_path)
    assert report["settings"]["operator"] == "swing"
    assert report["settings"]["estimator"] == "windowed"
    assert report["contact_force_rms_N"] > 0.5
    assert report["prediction_error_percent"] < report["delayed_force_error_percent"]
