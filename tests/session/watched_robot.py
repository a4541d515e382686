"""A robot that somebody else moves, watched in simulated time."""

from __future__ import annotations

import math

import pytest

from foretouch.messages import SessionLog
from foretouch.session import SessionSettings, make_moved_robot
from foretouch.session.runners import shadow

MS = 1_000_000


def watched(settings: SessionSettings, seconds: float) -> tuple[SessionLog, shadow.State]:
    robot, material = make_moved_robot(settings, say=pytest.fail)
    settings = shadow.shadow_settings(settings)
    state = shadow.start(robot.specification, settings, epoch=5, run=5)
    records, telemetry, models = [], [], []
    sample = robot.read()
    for tick in range(round(seconds * 1000)):
        state, output = shadow.step(state, shadow.follower.Inputs([], sample, MS, 0), tick * MS)
        records.append(output.record)
        telemetry.append(output.telemetry)
        models += [] if output.model is None else [output.model]
        sample = robot.exchange(math.nan)
    texts = settings.as_text() | {"operator": "shadow", "surface": str(material.surface)}
    return SessionLog.from_messages([*records, *telemetry, *models], texts), state
