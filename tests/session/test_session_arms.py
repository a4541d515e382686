"""Whole sessions with the arms of the package."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from foretouch import SessionSettings, simulate
from foretouch.errors import UnknownNameError
from foretouch.messages import MOST_JOINTS
from foretouch.report import session_figures
from foretouch.robot import ArmPicture, read_arm


def error(seconds: float, **settings: object) -> float:
    """Prediction error of a session over 80 and 300 ms [%]."""
    settings = {"material": "hunt-crossley", "seed": 11, "position_delay": 0.08, "force_delay": 0.3} | settings
    figures = session_figures(simulate(SessionSettings(**settings), duration=seconds).log)
    assert figures["status"] == "ok"
    return figures["prediction_error_percent"]


@pytest.mark.long
def test_an_arm_is_predicted_about_as_well_as_the_plain_robot() -> None:
    assert error(8.0, robot="fr3") < 1.5 * error(8.0)


@pytest.mark.parametrize("robot", ["ur5e", "simulated"])
@pytest.mark.long
def test_telemetry_of_a_scene_says_how_the_joints_stand(robot: str) -> None:
    """A frame of the follower turns what it counts, and not its joints."""
    frame = {"follower_frame": "0.1,0,0,0,0,0.5"}
    chosen = SessionSettings(robot=robot, scene="plane", seed=3, **frame)
    space = simulate(chosen, duration=0.5).log.follower_space
    names = [f"joint_{number}" for number in range(1, MOST_JOINTS + 1)]
    joints = np.array([space[name] for name in names]).T
    if robot == "simulated":
        assert np.isnan(joints).all()
        return
    picture = ArmPicture(read_arm(robot))
    assert np.isfinite(joints[:, : picture.joints]).all()
    assert np.isnan(joints[:, picture.joints :]).all()
    places = np.array([space[f"place_{axis}"] for axis in "xyz"]).T
    tips = np.array([picture.tip(row[: picture.joints]) for row in joints])
    assert np.abs(tips - places).max() < 1e-3


@pytest.mark.long
@pytest.mark.parametrize(("robot", "factor"), [("ur5e", 1.7), ("so101", 4.5)])
def test_so_are_the_others_along_a_line(robot: str, factor: float) -> None:
    assert error(20.0, robot=robot) < factor * error(20.0)


@pytest.mark.long
@pytest.mark.parametrize("robot", ["fr3", "ur5e", "so101"])
def test_a_scene_is_palpated(robot: str) -> None:
    assert error(20.0, robot=robot, scene="hill") < 100.0


@pytest.mark.long
@pytest.mark.parametrize("robot", ["fr3", "ur5e", "so101"])
def test_a_held_device_keeps_its_energy(robot: str) -> None:
    settings = SessionSettings(robot=robot, material="kelvin-voigt", grip="normal", seed=11)
    figures = session_figures(simulate(settings, duration=15.0).log)
    assert figures["hand"]["stable"]


def test_an_unknown_arm_is_refused_with_the_names_of_those_there_are() -> None:
    with pytest.raises(UnknownNameError, match=r"choose one of FILE\.xml, .*fr3, .*simulated, so101, .*ur5e"):
        SessionSettings(robot="panda")


def test_a_description_of_ones_own_is_used_by_its_path(tmp_path: Path) -> None:
    from importlib import resources

    text = (resources.files("foretouch.robot.arms") / "descriptions" / "ur5e.xml").read_text()
    path = tmp_path / "mine.xml"
    path.write_text(text.replace('data="0.16 0.1"', 'data="0.12 0.2"'))
    session = simulate(SessionSettings(robot=str(path), material="kelvin-voigt"), duration=0.5)
    assert session.log.settings["robot"] == str(path)
