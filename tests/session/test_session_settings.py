"""Settings by objects equal settings by text; what they cannot be is refused before anything is made."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import foretouch.cli.commands.sessions
from foretouch import Frame, ImageFault, SensorFault, SessionSettings
from foretouch.cli.app import app
from foretouch.errors import ArgumentTypeError, SettingError, UnknownNameError
from foretouch.session import recorded_settings, simulate

KINDS = {kind.__name__: kind for kind in (SessionSettings, Frame, SensorFault, ImageFault)}
PAIRS: list[tuple[dict[str, Any], dict[str, str]]] = [
    ({"clutch": [(5, 8), (12.5, 13)], "grip": "soft"}, {"clutch": "5:8,12.5:13", "grip": "soft"}),
    ({"leader_frame": Frame(0.1, -1)}, {"leader_frame": "0.1,-1"}),
    ({"follower_frame": Frame(-0.117)}, {"follower_frame": "-0.117,1"}),
    ({"sensor_fault": SensorFault("stuck", 5, 8)}, {"sensor_fault": "stuck:5:8"}),
    ({"sensor_fault": SensorFault("nan", 2.5)}, {"sensor_fault": "nan:2.5"}),
    ({"scene": "plane", "image_fault": ImageFault("hand", 5, 8)}, {"scene": "plane", "image_fault": "hand:5:8"}),
    (dict.fromkeys(("clutch", "leader_frame", "sensor_fault", "image_fault")), {"clutch": "", "sensor_fault": ""}),
    (dict.fromkeys(("estimator", "scene", "calibration", "grip", "baseline", "largest_stiffness", "bump")), {}),
]


@pytest.mark.parametrize(("objects", "texts"), PAIRS)
def test_objects_and_texts_say_the_same(objects: dict[str, Any], texts: dict[str, Any]) -> None:
    one, other = SessionSettings(**objects), SessionSettings(**texts)
    assert one == other
    assert hash(one) == hash(other)
    assert {name: one.as_text()[name] for name in texts} == texts
    assert eval(repr(one), {"inf": math.inf, **KINDS}) == one
    told = one.as_text()
    again, _ = recorded_settings(told)
    assert again.as_text() == told


@pytest.mark.parametrize("origin", [0.1, 1 / 3, 1e-7, -0.123456789012345])
def test_the_text_of_a_frame_gives_it_again_to_the_last_bit(origin: float) -> None:
    assert Frame.from_text("frame", str(Frame(origin, -1))) == Frame(origin, -1)


def test_the_texts_of_what_is_absent_are_those_of_old() -> None:
    texts = SessionSettings().as_text()
    assert [texts[name] for name in ("clutch", "leader_frame", "sensor_fault", "image_fault")] == ["", "0,1", "", ""]


def test_what_is_neither_is_refused() -> None:
    wrong: dict[str, Any] = {"leader_frame": (0.1, -1), "sensor_fault": 3}
    for name, value in wrong.items():
        with pytest.raises(
            ArgumentTypeError, match=f"^{name} is .*: must be a (Frame or SpatialFrame|SensorFault); the default"
        ):
            SessionSettings(**{name: value})
    for clutch in ([(3, 2)], [1, 2], [("a", "b")], 5):
        with pytest.raises(SettingError, match=r"^clutch = .*: must be START:END,START:END"):
            SessionSettings(grip="soft", clutch=clutch)  # type: ignore[arg-type]
    with pytest.raises(ArgumentTypeError, match="on_silence is None"):
        SessionSettings(on_silence=None)  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="place and size by default"):
        SessionSettings(scene="plane", image_fault=ImageFault("hand", 5, 8, size=0.5))


@pytest.mark.parametrize(
    ("given", "shown"),
    [({"probe_radius": 0.004}, "0.004"), ({"image_fault": "hand:1:2"}, "'hand:1:2'"), ({"fusion": "none"}, "'none'")],
)
def test_what_is_of_a_scene_is_refused_along_a_line(given: dict[str, Any], shown: str) -> None:
    ((name, value),) = given.items()
    rule = f"{name} = {shown}: is of a scene, and there is none: add --scene NAME"
    with pytest.raises(SettingError, match=rule):
        simulate(SessionSettings(**given), duration=0.1)
    for command in ("simulate", "follower", "leader"):
        done = CliRunner().invoke(app, [command, f"--{name.replace('_', '-')}", str(value)])
        assert isinstance(done.exception, SettingError)
        assert str(done.exception) == rule


def test_a_wrong_image_fault_names_its_setting() -> None:
    for given in ("hand:2:1", "hand:nan:3", "hand:-inf:3", "hand:2", "hand:a:b"):
        with pytest.raises(
            SettingError, match=rf"^image_fault = '{given}': must .*KIND:BEGIN:END .* such as hand:5:8$"
        ):
            SessionSettings(scene="plane", image_fault=given)  # type: ignore[arg-type]


# --- names and ranges are known before anything is made or compiled ---------------------------------------------------


NAMES = ("material", "operator", "model", "estimator", "grip", "scene", "robot", "baseline", "first_touch", "fusion")


@pytest.mark.parametrize("name", NAMES)
def test_an_unknown_name_is_refused_where_the_settings_are_made(name: str) -> None:
    with pytest.raises(UnknownNameError, match="'nobody'"):
        SessionSettings(**{name: "nobody"})  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["material", "operator", "model", "scene"])
def test_an_unknown_name_is_told_before_anything_is_compiled_or_written(
    name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(foretouch.cli.commands.sessions, "compile_first", lambda: pytest.fail("compiled"))
    done = CliRunner().invoke(app, ["simulate", f"--{name}", "nobody", "--report", str(tmp_path / "out")])
    assert isinstance(done.exception, UnknownNameError)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"position_delay": -0.1}, r"position_delay = -0\.1: must lie between 0 and 10"),
        ({"force_delay": float("nan")}, "force_delay = nan"),
        ({"loss": 2.0}, "loss = 2.0"),
        ({"model_rate": 0.0}, "model_rate = 0.0"),
        ({"operator": "nobody"}, "'nobody': choose one of browser, .*force-dimension, gamepad, .*recorded, .*scripted"),
        ({"model": "jelly"}, "unknown model 'jelly': choose one of contact-map"),
        ({"estimator": "guess"}, "unknown estimator for contact-map 'guess': choose one of bank"),
    ],
    ids=str,
)
def test_settings_out_of_range_and_unknown_names_are_refused_with_the_choices(changes: Any, message: str) -> None:
    with pytest.raises((SettingError, UnknownNameError), match=message):
        SessionSettings(**changes)
