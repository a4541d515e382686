"""Sessions whose sensors failed: what was recorded reads back, and is learnt from and scored as in the session."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner, Result

from foretouch.cli.app import app
from foretouch.identification import SENSOR_SENTENCES, SensorState
from foretouch.messages.session_log import believable
from foretouch.recordings import read_recording, read_session
from foretouch.robot import SENSOR_FAULTS

FOUND = {
    "nan": SensorState.NOT_FINITE,
    "dropout": SensorState.DROPOUT,
    "stuck": SensorState.STUCK,
    "saturated": SensorState.SATURATED,
    "offset-step": SensorState.FORCE_DISAGREES,  # in contact the drive's own force shows it first
    "spikes": SensorState.SPIKE,
    "encoder-jump": SensorState.ENCODER_JUMP,
}


def run(*arguments: object) -> Result:
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result


def printed(result: Result) -> dict[str, Any]:
    content: dict[str, Any] = json.loads(result.stdout, parse_constant=lambda text: pytest.fail(text))
    return content


def test_every_fault_is_tried() -> None:
    assert FOUND.keys() == SENSOR_FAULTS.keys()


QUICK = ("nan",)
"""The others take longer than all tests may."""


@pytest.mark.parametrize(
    "kind", [kind if kind in QUICK else pytest.param(kind, marks=pytest.mark.long) for kind in FOUND]
)
@pytest.mark.long
def test_a_session_with_a_fault_reads_back(kind: str, tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    fault = f"{kind}:5:5.6"
    options = ("--duration", 6.5, "--material", "hunt-crossley", "--sensor-fault", fault, "--recording", path, "--json")
    report = printed(run("simulate", *options))
    state = FOUND[kind]

    follower = read_session(path).follower
    failed = follower["validity"] > 0
    assert set(follower["validity"][failed].tolist()) == {state}
    told = report["safety"]["sensor_faults"]
    assert list(told) == [state.name.lower()]
    assert told[state.name.lower()]["sentence"] == SENSOR_SENTENCES[state]
    assert told[state.name.lower()]["seconds"] == pytest.approx(1e-3 * failed.sum())
    assert report["faulty_samples"] == failed.sum() > 0
    assert report["status"] == "ok"
    # What was wrong is no true force: it moves neither the error nor the zero.
    assert report["prediction_error_percent"] < 30.0
    assert report["phantom_force_rms_N"] < 0.1

    recording = read_recording(path)
    believed = follower[believable(follower)]
    assert not believed["validity"].any()
    assert len(recording) == believed.size < follower.size
    np.testing.assert_array_equal(recording.force, believed["sensor_force"])

    again = run("predict", path, "--delay", 0.3, "--json")
    figures = printed(again)
    assert f"{failed.sum():,} samples were left out" in again.stderr
    for name in ("samples", "scored_samples", "prediction_error_percent", "delayed_force_error_percent"):
        assert figures[name] == pytest.approx(report[name], rel=1e-9)
    if kind == "nan":
        assert printed(run("identify", path, "--json"))["samples"] == believed.size
        results = printed(
            run("compare", path, "--models", "hunt-crossley", "--estimators", "exact", "--jobs", 1, "--json")
        )["results"]
        assert results
        assert all(result["status"] == "ok" for result in results)
