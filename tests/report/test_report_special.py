"""Recordings out of the ordinary: each is predicted, finite, and described in text, in JSON and on the page."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from typer.testing import CliRunner, Result

from foretouch.cli.app import app
from foretouch.errors import ForetouchError
from foretouch.models import HuntCrossley
from foretouch.recordings import write_columns

Array = NDArray[np.float64]

LAW = HuntCrossley(3000.0, 300.0, 1.4)


def presses(time: Array) -> Array:
    """Depth [m]: a second in free air, then presses with free air in between."""
    t = np.maximum(time - 1.0, 0.0)
    return 0.01 * (np.sin(2 * np.pi * 0.8 * t) * (0.7 + 0.3 * np.sin(2 * np.pi * 0.31 * t)) - 0.05)


def once(begin: float) -> Callable[[Array], Array]:
    """A single press of 0.4 s."""
    return lambda t: np.where((t > begin) & (t < begin + 0.4), 0.008 * np.sin(np.pi * (t - begin) / 0.4), -1e-3)


def even(seconds: float, rate: float) -> Array:
    return np.arange(0.0, seconds, 1.0 / rate)


def with_gaps() -> Array:
    time = even(6.0, 1000.0)
    return time[~((time > 2.2) & (time < 3.1)) & ~((time > 4.5) & (time < 4.62))]


RECORDINGS: dict[str, tuple[Array, Callable[[Array], Array], float]] = {
    "never": (even(4.0, 1000.0), lambda t: -0.005 + 0.003 * np.sin(t), 0.0),
    "once": (even(5.0, 1000.0), once(3.0), 0.0),
    "once-before": (even(3.0, 1000.0), once(0.9), 0.0),
    "stays": (even(5.0, 1000.0), lambda t: 0.006 + 0.003 * np.sin(4.4 * t) + 0.001 * np.sin(10.7 * t), 0.0),
    "inside": (even(5.0, 1000.0), lambda t: 0.006 + 0.008 * np.sin(4.4 * t), 0.0),
    "held": (even(3.0, 1000.0), lambda t: np.full(t.size, 0.005), 0.0),
    "gaps": (with_gaps(), presses, 0.0),
    "slow": (even(10.0, 50.0), presses, 0.0),
    "fast": (even(3.5, 10000.0), presses, 0.0),
    "drifts-up": (even(6.0, 1000.0), presses, 0.1),
    "drifts-down": (even(6.0, 1000.0), presses, -0.1),
    "short": (1.0 + even(0.4, 1000.0), presses, 0.0),
    "two": (np.array([0.0, 0.4]), presses, 0.0),
}
"""Time [s], depth from the time [m], and drift of the force sensor [N/s]."""

EXPECTED: dict[str, tuple[str, tuple[str, ...]]] = {
    "never": ("no_contact", ("no_contact: the measured force never rises above the contact floor",)),
    "once": ("ok", ("It touches once, from 3.0",)),
    "once-before": ("no_contact", ("no_contact: ", "It touches outside of the scoring window only")),
    "stays": ("offset_unobservable", ("offset_unobservable: the probe never leaves contact",)),
    "inside": ("ok", ("It begins in contact: surface and zero of the force are only known from 0.8",)),
    "held": ("no_contact", ("no_contact: ", "The probe never moves")),
    "gaps": ("ok", ("Time has 2 gaps, up to 0.90 s long",)),
    "slow": ("ok", ("It has 50 samples a second",)),
    "fast": ("ok", ()),
    "drifts-up": ("ok", ("The force in free air drifts by +0.1 N/s",)),
    "drifts-down": ("ok", ("The force in free air drifts by -0.",)),
    "short": ("nothing_to_score", ("nothing_to_score: the recording ends after ",)),
    "two": ("nothing_to_score", ("nothing_to_score: ", "It has 2 samples a second", "The probe never moves")),
}
"""Status, and how the remarks begin."""

LARGEST_ERRORS = {"gaps": 10.0, "slow": 10.0, "fast": 15.0, "inside": 35.0, "stays": 20.0}
"""Prediction errors that learning reaches in spite of it [%]."""


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, ["predict", *map(str, arguments)])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("special")
    random = np.random.default_rng(0)
    for name, (time, depth_of, drift) in RECORDINGS.items():
        depth = depth_of(time)
        force = LAW.force(depth, np.gradient(depth, time)) + 0.3 + drift * time + random.normal(0.0, 0.02, time.size)
        write_columns(made / f"{name}.csv", {"time_s": time, "position_m": depth + 0.01, "force_N": force})
    return made


@pytest.mark.parametrize("name", RECORDINGS)
@pytest.mark.first
def test_it_is_handled_and_described(folder: Path, tmp_path: Path, name: str) -> None:
    forces = tmp_path / "forces.csv"
    result = run(folder / f"{name}.csv", "--json", "--out", forces)
    assert result.exit_code == 0, result.exception
    content: dict[str, Any] = json.loads(result.stdout, parse_constant=lambda text: pytest.fail(text))
    status, beginnings = EXPECTED[name]
    assert content["status"] == status
    output = content["remarks"]
    assert len(output) == len(beginnings), output
    for sentence, beginning in zip(output, beginnings, strict=False):
        assert sentence.startswith(beginning)
    with forces.open() as rows:
        predicted = [float(row["predicted_force_N"]) for row in csv.DictReader(rows)]
    assert len(predicted) == RECORDINGS[name][0].size
    assert all(math.isfinite(force) and 0.0 <= force < 1e3 for force in predicted)
    if name in LARGEST_ERRORS:
        assert content["prediction_error_percent"] < LARGEST_ERRORS[name]


def test_the_text_says_it_too(folder: Path) -> None:
    result = run(folder / "stays.csv")
    assert result.exit_code == 0
    assert result.stdout.splitlines()[-1].strip().startswith("offset_unobservable: the probe never leaves contact")
    assert "--force-offset" in result.stdout


@pytest.mark.long
def test_the_page_says_it_too(folder: Path, tmp_path: Path) -> None:
    assert run(folder / "once-before.csv", "--report", tmp_path).exit_code == 0
    page = (tmp_path / "index.html").read_text()
    assert page.count("It touches outside of the scoring window only") == 1
    assert page.count("no_contact: the measured force never rises") == 1


def test_the_zero_that_is_given_is_taken(folder: Path) -> None:
    """What never leaves contact is predicted as it is felt, if its zero is known: scored with its own convention."""
    lowest = json.loads(run(folder / "stays.csv", "--json").stdout)["prediction_error_percent"]
    path = folder / "stays.csv"
    with path.open() as rows:
        felt = np.array([float(row["force_N"]) for row in csv.DictReader(rows)])
    zero = float(np.convolve(felt, np.full(50, 1 / 50), "valid").min())
    given = json.loads(run(path, "--json", "--force-offset", zero).stdout)["prediction_error_percent"]
    assert given < lowest


@pytest.mark.parametrize("rows", [1, 0])
def test_what_is_no_recording_is_refused_in_one_line(tmp_path: Path, rows: int) -> None:
    path = tmp_path / "press.csv"
    path.write_text("time_s,position_m,force_N\n" + "0,0,0\n" * rows)
    refusal = run(path).exception
    assert isinstance(refusal, ForetouchError)
    assert f"{rows} sample{'' if rows == 1 else 's'}: at least 2 are needed" in str(refusal)
    assert "\n" not in str(refusal)


@pytest.mark.long
def test_measured_presses_are_nothing_special_but_for_what_is_known_of_them(measured: Callable[[str], Path]) -> None:
    for name in ("tue/a-foam", "tue/b-foam3", "tue/d-foam2", "tue/a-rigid"):
        assert json.loads(run(measured(name), "--json").stdout)["remarks"] == [], name
    (spring,) = json.loads(run(measured("tue/d-spring"), "--json").stdout)["remarks"]
    assert spring.startswith("offset_unobservable: ")
    skin = run(measured("aurora/600-mN"), "--json", "--delay", 0.02, "--score-from", 0.5, "--score-to", 1.6)
    (once,) = json.loads(skin.stdout)["remarks"]
    assert once.startswith("It touches once, from 0.9")


@pytest.mark.parametrize("name", ["once", "two"])
@pytest.mark.first
def test_a_recording_that_ends_before_scoring_begins_is_said_to(folder: Path, tmp_path: Path, name: str) -> None:
    output = run(folder / f"{name}.csv", "--score-from", 100, "--report", tmp_path).stdout
    page = (tmp_path / "index.html").read_text()
    for text in (output, page):
        assert "nothing_to_score: the recording ends after" in text
        assert "before --score-from 100." in text
        assert "guarded" not in text
