"""A robot that somebody else moves, watched in simulated time."""

from __future__ import annotations

import pytest

from foretouch.messages import ModelUpdate, SessionLog
from foretouch.session import SessionSettings, make_moved_robot
from foretouch.session.runners.driven import Tick
from foretouch.session.runners.shadow import Shadow
from foretouch.session.settings import shadow_settings

MS = 1_000_000


def watched(settings: SessionSettings, seconds: float) -> tuple[SessionLog, Shadow]:
    robot, material = make_moved_robot(settings, say=pytest.fail)
    settings = shadow_settings(settings)
    shadow, messages = Shadow(robot, settings, 5), []
    for tick in range(round(seconds * 1000)):
        shadow.pass_time(min(tick, 1))
        messages += shadow.tick(Tick(tick * MS, MS))
    models = [message for message in messages if isinstance(message, ModelUpdate)]
    texts = settings.as_text() | {"operator": "shadow", "surface": str(material.surface)}
    return SessionLog.from_messages([*(m for m in messages if m not in models), *models], texts), shadow
