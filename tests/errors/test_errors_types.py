"""What is given to an entry and is of another type is refused in one line, and not by what it meets further in."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import foretouch
from foretouch.comparison import file_case
from foretouch.errors import ArgumentTypeError, RecordingError, SettingError
from foretouch.identification import make_estimator
from foretouch.models import make_model

TIME = np.arange(10) * 1e-3
RECORDING = foretouch.Recording(TIME, TIME, TIME)
LEARNER = foretouch.Learner(foretouch.KelvinVoigtRLS())
SETTINGS = foretouch.SessionSettings()


@pytest.mark.parametrize(
    ("entry", "arguments", "options", "begins", "tells"),
    [
        (foretouch.predict, ("a.csv", LEARNER), {"delay": 0.3}, "recording is 'a.csv' (str)", "read_recording gives"),
        (foretouch.predict, (RECORDING, LEARNER), {"delay": "0.3"}, "delay is '0.3' (str)", "must be a number"),
        (foretouch.identify, (RECORDING, "rls"), {}, "learner is 'rls' (str)", "such as ContactMap()"),
        (foretouch.identify, (None, LEARNER), {}, "recording is None", "read_recording gives"),
        (foretouch.Learner, ("rls",), {}, "estimator is 'rls' (str)", "such as ContactMap()"),
        (foretouch.Learner, (LEARNER.estimator,), {"surface": "0"}, "surface is '0' (str)", "None to find it"),
        (foretouch.session_report, ("x.mcap",), {}, "log is 'x.mcap' (str)", "read_session gives"),
        (foretouch.simulate, (None,), {"duration": 1.0}, "settings is None", "SessionSettings()"),
        (foretouch.simulate, (SETTINGS,), {"duration": 1.0, "operator": 3}, "operator is 3 (int)", "make_operator"),
        (foretouch.simulate, (SETTINGS,), {"duration": 1.0, "robot": "arm"}, "robot is 'arm' (str)", "make_robot"),
        (foretouch.simulate, (SETTINGS,), {"duration": 1.0, "description": 3}, "description is 3 (int)", "by name"),
        (foretouch.warm_up, (3,), {}, "settings is 3 (int)", "None for the defaults"),
        (foretouch.read_recording, (3,), {}, "path is 3 (int)", "a Path"),
        (foretouch.read_recording, ("a.csv",), {"map_file": 3}, "map_file is 3 (int)", "a Path"),
        (foretouch.read_recording, ("a.csv",), {"force_unit": ["N"]}, "force_unit is ['N'] (list)", "of a unit"),
        (foretouch.read_with_notes, (None,), {}, "path is None", "a Path"),
        (foretouch.read_session, (3,), {}, "path is 3 (int)", "a Path"),
        (file_case, (3,), {}, "path is 3 (int)", "a Path"),
        (file_case, ("a.csv",), {"map_file": 3}, "map_file is 3 (int)", "a Path"),
        (foretouch.compare, (3,), {}, "recordings is 3 (int)", "a list of paths"),
        (foretouch.compare, ("a.csv",), {}, "recordings is 'a.csv' (str)", "a list of paths"),
        (foretouch.compare, ([3],), {}, "path is 3 (int)", "a Path"),
        (foretouch.compare, ([],), {"models": 3}, "models is 3 (int)", "a list of names"),
        (foretouch.compare, ([],), {"processes": "2"}, "processes is '2' (str)", "a number"),
        (foretouch.excerpt, (["a"],), {}, "name is ['a'] (list)", "tue/b-foam"),
        (foretouch.fetch_dataset, (["a"],), {}, "name is ['a'] (list)", "tue/b-foam"),
        (make_estimator, (["a"],), {}, "model is ['a'] (list)", "the name of a law"),
        (make_estimator, ("kelvin-voigt", 3), {}, "estimator is 3 (int)", "leave it out"),
        (foretouch.make_operator, (SETTINGS,), {"surface": "1"}, "surface is '1' (str)", "a length [m]"),
        (foretouch.make_robot, (3,), {}, "material is 3 (int)", "a Material, or the name of one"),
        (foretouch.make_robot, ("foam",), {"workspace": 3}, "workspace is 3 (int)", "two numbers [m]"),
        (foretouch.Renderer, (3,), {}, "device is 3 (int)", "SessionSettings(...).device"),
        (foretouch.Recording, (TIME, "x", TIME), {}, "position is 'x' (str)", "a column of numbers"),
        (
            foretouch.delayed_force,
            (TIME, object, 0.1),
            {},
            "a column is <class 'object'> (type)",
            "a column of numbers",
        ),
        (foretouch.delayed_force, (TIME, TIME, "0.1"), {}, "delay is '0.1' (str)", "a number"),
        (foretouch.score_prediction, (TIME,) * 4, {"contact_floor": None}, "contact_floor is None", "a number"),
        (
            foretouch.score_prediction,
            (TIME,) * 4,
            {"contact_floor": 1, "offset": "0"},
            "offset is '0' (str)",
            "a number, or None",
        ),
        (foretouch.SessionSettings, (), {"jitter": "a"}, "jitter is 'a' (str)", "the default is 0.0"),
        (foretouch.SessionSettings, (), {"material": 3}, "material is 3 (int)", "must be a text"),
        (foretouch.SessionSettings, (), {"seed": 1.5}, "seed is 1.5 (float)", "must be a whole number"),
        (foretouch.SessionSettings, (), {"device_damping": "a"}, "device_damping is 'a' (str)", "a number, or None"),
        (make_model, ("hunt-crossley", "abc"), {}, "parameters is 'abc' (str)", "stiffness, damping, exponent"),
        (make_model, ("hunt-crossley", 3), {}, "parameters is 3 (int)", "stiffness, damping, exponent"),
        (make_model, (["a"], (1.0,)), {}, "law is ['a'] (list)", "the name of a contact law"),
    ],
)
def test_what_is_of_another_type_is_refused_in_one_line_that_says_what_is_wanted(
    entry: Callable[..., object], arguments: tuple[Any, ...], options: dict[str, Any], begins: str, tells: str
) -> None:
    with pytest.raises(ArgumentTypeError) as caught:
        entry(*arguments, **options)
    text = str(caught.value)
    assert text.startswith(f"{begins}: must be ")
    assert tells in text
    assert "\n" not in text
    assert len(text) < 200


def test_such_an_error_is_a_type_error_and_crosses_processes() -> None:
    error = pickle.loads(pickle.dumps(ArgumentTypeError("log", list(range(1000)), "a SessionLog")))
    assert isinstance(error, SettingError)
    assert isinstance(error, TypeError)
    assert str(error) == "log is [0, 1, 2, 3, 4, 5, ...] (list): must be a SessionLog"


def test_numbers_of_numpy_are_numbers() -> None:
    settings = foretouch.SessionSettings(force_delay=np.float32(0.25), seed=np.int64(3))  # type: ignore[arg-type]
    assert settings.force_delay == 0.25
    model = make_model("kelvin-voigt", np.array([500, 2]))  # type: ignore[arg-type]
    assert model.parameters == (500, 2)


def test_a_recording_without_a_position_is_refused() -> None:
    with pytest.raises(RecordingError, match=r"position has shape \(\), time has 10 samples"):
        foretouch.Recording(TIME, None, TIME)  # type: ignore[arg-type]


def test_a_budget_of_another_type_is_no_number() -> None:
    with pytest.raises(SettingError, match=r"budget = \[1\]: must be a number above 0"):
        foretouch.read_recording(foretouch.excerpt("tue/b-foam"), budget=[1])  # type: ignore[arg-type]
