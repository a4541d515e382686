"""Robots and devices of other packages in a session: what they press where nobody knows, and what they feel."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import pytest
from typer.testing import CliRunner
from wrong_devices import Held
from wrong_robots import SPECIFICATION

from foretouch.cli.app import app
from foretouch.devices import UNKNOWN_REACH, BrowserOperator
from foretouch.errors import SettingError
from foretouch.report import session_figures
from foretouch.session import (
    SessionSettings,
    make_moved_robot,
    make_operator,
    make_session_robot,
    reach_texts,
    simulate,
)
from foretouch.session.operators import felt_device

SOURCE = """
from dataclasses import replace
from foretouch.models import KelvinVoigt
from foretouch.robot import Material
from wrong_devices import Held
from wrong_robots import Rail

def rail(settings): return Rail()

class Known(Rail):
    material = Material("spring", "a spring", "the test", KelvinVoigt(800.0, 0.0), 0.008)

def known(settings): return Known()

class Real(Rail):
    def __init__(self):
        super().__init__()
        self.specification = replace(self.specification, simulated=False)

def real(settings): return Real()

class Slow(Rail):
    def __init__(self):
        super().__init__()
        self.specification = replace(self.specification, sample_period=1e-2)

def slow(settings): return Slow()

def held(settings, reach): return Held()
"""
POINTS = {
    "robot": {"rail": "lab:rail", "known": "lab:known", "real": "lab:real", "slow": "lab:slow"},
    "device": {"held": "lab:held"},
}


@pytest.fixture(autouse=True)
def lab(install: Callable[..., None]) -> None:
    install("lab", POINTS, SOURCE)


def operator_of(settings: SessionSettings, reach: object) -> object:
    return make_operator(settings, surface=reach.surface, press_depth=reach.press_depth, say=pytest.fail)  # type: ignore[attr-defined]


@pytest.mark.long
def test_a_robot_that_says_what_it_presses_is_pressed_by_script() -> None:
    settings = SessionSettings(robot="known", position_delay=0.01, force_delay=0.02, model="kelvin-voigt")
    robot, reach = make_session_robot(settings)
    assert reach_texts(reach) == {"surface": "0.01", "press_depth": "0.008"}
    log = simulate(settings, duration=8.0, operator=operator_of(settings, reach), robot=robot).log
    assert log.settings["robot"] == "known"
    report = session_figures(log, score_from=5.0)  # the first presses are slow, into what the robot does not know
    assert report["contact_force_rms_N"] > 1.0
    assert report["prediction_error_percent"] < 10.0
    # The model that the last update brought is the spring of the robot.
    assert report["parameters"]["stiffness"] == pytest.approx(800.0, rel=0.05)


def test_where_nobody_knows_the_surface_a_script_says_so_and_a_hand_is_taken() -> None:
    settings = SessionSettings(robot="rail")
    _, reach = make_session_robot(settings)
    assert reach is UNKNOWN_REACH
    assert reach_texts(reach) == {}
    for operator in ("scripted", "recorded"):
        with pytest.raises(SettingError, match="this robot does not say where it is: take one that you move"):
            operator_of(replace(settings, operator=operator), reach)
    output: list[str] = []
    mouse = make_operator(
        replace(settings, operator="browser"), surface=reach.surface, press_depth=reach.press_depth, say=output.append
    )
    assert len(output) == 1
    assert output[0].startswith(
        "operator: robot 'rail' does not say where its surface is, so a script stays in the air"
    )
    assert isinstance(mouse, BrowserOperator)
    assert {mouse.read(tick * 10**6) for tick in range(3000)} == {0.0}  # nobody presses before somebody takes it
    mouse.take(0.012, True, 3 * 10**9)
    assert max(mouse.read(3 * 10**9 + tick * 10**6) for tick in range(500)) == pytest.approx(0.012, rel=1e-3)


def test_the_specification_rules() -> None:
    with pytest.raises(
        SettingError, match=r"robot = 'slow': has a sample period of 0.01 s: .* 1 kHz, 500, 250 or 200 Hz"
    ):
        make_session_robot(SessionSettings(robot="slow"))
    with pytest.raises(SettingError, match="is of the simulated robot"):
        SessionSettings(robot="rail", sensor_fault="stuck:1:2")
    with pytest.raises(SettingError, match="robot = 'rail': moves along one axis, and the scene plane is touched in"):
        simulate(SessionSettings(robot="rail", scene="plane"))
    with pytest.raises(SettingError, match="operator = 'held': moves along one axis, and the scene plane is touched i"):
        simulate(SessionSettings(operator="held", scene="plane"))
    settings = SessionSettings(robot="rail", follower_frame="0.1,-1")
    robot, _ = make_session_robot(settings)
    assert robot.specification == SPECIFICATION  # in its own frame: the session translates it


def test_a_real_robot_is_watched_as_it_is_and_not_simulated() -> None:
    settings = SessionSettings(robot="real")
    robot, reach = make_moved_robot(settings, say=pytest.fail)
    assert type(robot).__name__ == "Real"  # somebody else moves it, not an operator of ours
    assert math.isnan(reach.surface)
    assert settings.guards(simulated=robot.specification.simulated)
    result = CliRunner().invoke(app, ["simulate", "--robot", "real", "--duration", "1"])
    assert isinstance(result.exception, SettingError)
    assert str(result.exception) == "robot = 'real': is a real one and needs real time: foretouch teleop"


@pytest.mark.long
def test_a_device_that_is_felt_is_rendered_as_stiff_as_it_carries() -> None:
    settings = SessionSettings(operator="held", robot="known", position_delay=0.01, force_delay=0.02)
    robot, reach = make_session_robot(settings)
    device = operator_of(settings, reach)
    assert isinstance(device, Held)
    assert felt_device(device, settings) == device.specification
    log = simulate(settings, duration=6.0, operator=device, robot=robot).log
    report = session_figures(log)
    assert report["loop"] == "closed loop: a hand of its own holds the device held and feels the force"
    assert 0.5 < report["max_rendered_force_N"] <= 8.0  # its own limit
    assert log.leader["engaged"].any()
    assert not log.leader["engaged"][:5].all()  # hand and follower have to meet first


def test_a_device_that_is_felt_takes_no_simulated_hand_and_no_baseline() -> None:
    for options, name in (({"grip": "soft"}, "grip"), ({"baseline": "delayed"}, "baseline")):
        settings = SessionSettings(operator="held", **options)  # type: ignore[arg-type]
        with pytest.raises(SettingError, match=f"{name} = .*is felt by a hand of its own: leave {name} at none"):
            operator_of(settings, UNKNOWN_REACH)
