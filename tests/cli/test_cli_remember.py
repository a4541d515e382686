"""`--remember`: a material from one run to the next."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typed_commands import good, output_of, refusal_of


@pytest.fixture(autouse=True)
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("FORETOUCH_MATERIALS", str(tmp_path / "materials"))
    return tmp_path / "materials"


def recording(path: Path, duration: float = 8.0) -> Path:
    time = np.arange(0.0, duration, 2e-3)
    depth = 1e-3 * (2.0 + 0.4 * time) * np.sin(np.pi * time - 0.5 * np.pi)
    noise = np.random.default_rng(1).normal(0.0, 0.01, time.size)
    force = 4e4 * np.maximum(depth, 0.0) ** 2 + noise
    table = np.column_stack((time, 0.01 + depth, force))
    np.savetxt(path, table, delimiter=",", header="time_s,position_m,force_N", comments="")
    return path


@pytest.mark.long
def test_the_second_time_is_foreseen(tmp_path: Path, home: Path) -> None:
    path = recording(tmp_path / "press.csv")
    plain = output_of("predict", path)
    assert not home.exists()
    assert "memory" not in plain
    first, second = (output_of("predict", path, "--remember", "foam") for _ in range(2))
    assert (first["memory"], second["memory"]) == ("none", "held")
    assert first["prediction_error_percent"] == plain["prediction_error_percent"]
    assert second["prediction_error_percent"] < plain["prediction_error_percent"]


def test_less_than_a_second_in_contact_is_not_kept(tmp_path: Path, home: Path) -> None:
    result = good("identify", recording(tmp_path / "a.csv", 1.2), "--remember", "foam")
    assert "nothing new is kept of foam" in result.stderr
    assert not home.exists()


def test_what_cannot_be_remembered_is_refused(tmp_path: Path, home: Path) -> None:
    path = recording(tmp_path / "a.csv", 1.2)
    home.mkdir()
    (home / "bad.json").write_text("{")
    assert "letters, digits" in refusal_of("predict", path, "--remember", "a/b")
    assert "damaged" in refusal_of("predict", path, "--remember", "bad")
    assert "contact maps" in refusal_of("predict", path, "--remember", "a", "--model", "kelvin-voigt")
    shadow = ("follower", "--shadow", "--duration", 5, "--listen", "tcp/127.0.0.1:7447", "--remember", "a")
    assert "--estimator bank" in refusal_of(*shadow, "--estimator", "offline")
    assert [one.name for one in home.iterdir()] == ["bad.json"]


@pytest.mark.long
def test_a_replay_needs_no_file(tmp_path: Path, home: Path) -> None:
    session = ("simulate", "--duration", 6, "--material", "hunt-crossley", "--remember", "soft")
    good(*session)
    path = tmp_path / "second.mcap"
    second = output_of(*session, "--seed", 1, "--recording", path)
    (home / "soft.json").unlink()
    again = output_of("predict", path)
    assert again["prediction_error_percent"] == pytest.approx(second["prediction_error_percent"], rel=1e-9)
