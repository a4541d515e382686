"""Settings by objects equal settings by text, and are told by the texts that recordings and messages carry."""

from __future__ import annotations

import math
from typing import Any

import pytest

from foretouch import Frame, ImageFault, SensorFault, SessionSettings
from foretouch.errors import ArgumentTypeError, SettingError
from foretouch.session import recorded_settings

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
        with pytest.raises(ArgumentTypeError, match=f"^{name} is .*: must be a (Frame|SensorFault); the default is"):
            SessionSettings(**{name: value})
    for clutch in ([(3, 2)], [1, 2], [("a", "b")], 5):
        with pytest.raises(SettingError, match=r"^clutch = .*: must be START:END,START:END"):
            SessionSettings(grip="soft", clutch=clutch)  # type: ignore[arg-type]
    with pytest.raises(ArgumentTypeError, match="material is None"):
        SessionSettings(material=None)  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="place and size by default"):
        SessionSettings(scene="plane", image_fault=ImageFault("hand", 5, 8, size=0.5))
