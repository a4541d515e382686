"""The example of a plug-in, installed as a package is, in processes of their own."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from plugin_packages import EXAMPLE
from typer.testing import CliRunner

from foretouch.cli.app import app

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


def run(installed: Path, *words: str, folder: Path, code: int = 0) -> subprocess.CompletedProcess[str]:
    """A command where the example is installed."""
    environment = os.environ | {"PYTHONPATH": str(installed)}
    done = subprocess.run(
        [sys.executable, "-m", "foretouch", *words],
        capture_output=True,
        text=True,
        cwd=folder,
        env=environment,
        timeout=120,
    )
    assert done.returncode == code, done.stderr
    return done


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


def test_it_is_listed_with_its_package_and_passes_the_checks(installed: Path, tmp_path: Path) -> None:
    rows = json.loads(run(installed, "plugins", "--json", folder=tmp_path).stdout)["plugins"]
    own = [row for row in rows if row["package"] == "foretouch-plugin-example"]
    assert [(row["kind"], row["name"], row["version"], row["status"]) for row in own] == [
        ("device", "swing", "0.1.0", "ok"),
        ("estimator", "windowed", "0.1.0", "ok"),
    ]
    checked = run(installed, "plugins", "check", "windowed", "--json", folder=tmp_path)
    assert json.loads(checked.stdout)["passed"]


def test_its_estimator_is_compared_identified_and_simulated(installed: Path, tmp_path: Path) -> None:
    press(tmp_path / "press.csv")
    chosen = ("--models", "kelvin-voigt", "--estimators", "windowed", "--jobs", "1")
    done = run(installed, "compare", "press.csv", *chosen, "--json", folder=tmp_path)
    results = {row["estimator"]: row for row in json.loads(done.stdout)["results"]}
    assert results["windowed"]["status"] == "ok"
    assert results["windowed"]["predictions"][0]["prediction_error_percent"] < 5.0
    law = ("--model", "kelvin-voigt", "--estimator", "windowed")
    found = json.loads(run(installed, "identify", "press.csv", *law, "--json", folder=tmp_path).stdout)
    assert found["parameters"]["stiffness"] == pytest.approx(600.0, rel=0.03)


def test_its_device_moves_a_simulated_session(installed: Path, tmp_path: Path) -> None:
    words = ("simulate", "--operator", "swing", "--material", "hunt-crossley", "--duration", "4", "--json")
    report = json.loads(run(installed, *words, "--recording", "s.mcap", folder=tmp_path).stdout)
    assert report["settings"]["operator"] == "swing"
    assert report["contact_force_rms_N"] > 1.0
    # Who has the recording and not the package reads it all the same.
    again = CliRunner().invoke(app, ["report", str(tmp_path / "s.mcap"), "--json"])
    assert json.loads(again.stdout)["settings"]["operator"] == "swing"
    refused = run(installed, "simulate", "--operator", "swin", "--duration", "1", folder=tmp_path, code=2)
    choices = "browser, force-dimension, gamepad, recorded, scripted, swing"
    assert refused.stderr == f"foretouch: unknown operator 'swin': choose one of {choices}\n"


@pytest.mark.live
def test_its_device_and_estimator_are_found_by_the_processes_of_a_session(installed: Path, tmp_path: Path) -> None:
    law = ("--model", "kelvin-voigt", "--estimator", "windowed", "--material", "kelvin-voigt")
    words = ("teleop", "--headless", "--operator", "swing", *law, "--duration", "6", "--json")
    done = run(installed, *words, "--recording", "s.mcap", folder=tmp_path)
    report = json.loads(done.stdout)
    assert report["settings"]["operator"] == "swing"
    assert report["settings"]["estimator"] == "windowed"
    assert report["contact_force_rms_N"] > 0.5
    assert report["prediction_error_percent"] < report["delayed_force_error_percent"]
