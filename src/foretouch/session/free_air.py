"""Whether a calibration belongs to the robot's sensor: what it leaves in free air, before a session begins."""

from __future__ import annotations

from typing import Any

import numpy as np

from foretouch.robot import ArmAlongLine, ArticulatedArm
from foretouch.robot.arms.arm import left_in_free_air
from foretouch.session.operators import robot_inside
from foretouch.session.settings import SessionSettings
from foretouch.session.steps.follower import State
from foretouch.session.steps.sensing import session_calibration


def misfit(robot: Any, state: State, settings: SessionSettings) -> str:
    """The rule that the settings' calibration of bias and tool breaks by what it leaves in free air; "" for none.

    A force beyond the specification's `largest_offset` would count as contact in the session. An arm with six axes at
    its wrist would also take a first touch for one beside its tip where too much torque is left: it would hold there.

    Only a simulated robot says that it touches nothing. Of hardware nobody knows: it may begin in contact, with a force
    that its calibration is there to tell.

    Args:
        robot: As the follower has it, before it moves; no time passes.
        state: Of the follower that is to begin.
        settings: Of the session.
    """
    known = session_calibration(settings)
    if known is None or known.force_bias is None:
        return ""
    sample, (inner, _) = robot.read(), robot_inside(robot)
    if state.probe.exact_force(sample) != 0.0:  # NaN on hardware
        return ""
    arm = inner.arm if isinstance(inner, ArmAlongLine) else inner
    if isinstance(arm, ArticulatedArm):
        force, torque, most_torque = left_in_free_air(arm)
    else:
        force, torque, most_torque = _size(sample.force if settings.scene else state.sensor_force(sample)), 0.0, 0.0
    most = state.specification.largest_offset
    if not (force > most or torque > most_torque):
        return ""
    left, allowed = _said(force, torque), _said(most, most_torque)
    why = "it is of another sensor or tool, or old; calibrate again (foretouch calibrate sensor)"
    return f"leaves {left} at the start, in free air, where at most {allowed} may be left: {why}"


def _size(force: Any) -> float:
    return float(np.linalg.norm(force))


def _said(force: float, torque: float) -> str:
    return f"{force:.2g} N" + (f" and {torque:.2g} N m about the tip" if torque else "")
