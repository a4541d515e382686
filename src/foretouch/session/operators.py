"""Operators by name."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.devices import GRIPS, BrowserOperator, Device, Hand, RecordedOperator, ScriptedOperator
from foretouch.errors import DatasetError
from foretouch.recordings import fetch, read_leader_motion
from foretouch.session.frames import framed_device, inverse
from foretouch.session.settings import NO_GRIP, SessionSettings

__all__ = ["RECORDED_MOTION", "make_operator"]

RECORDED_MOTION = "tue/b-foam"
"""Dataset whose leader lever moves the ``recorded`` operator."""


INTENDED_FORCE, DEEPEST = 3.0, 0.1
"""A hand that means to press with a force intends to be deeper, by so many newtons over the stiffness of its grip [N],
and at most so deep [m]."""


def make_operator(
    settings: SessionSettings, *, surface: float, press_depth: float, say: Callable[[str], None]
) -> Device:
    """The operator of a session, fresh; with a grip, a hand that intends what that operator does.

    It counts as the settings' leader frame says: a simulated device is built to.

    Args:
        settings: Of the session.
        surface: Where the material begins [m]; the operator sees it.
        press_depth: How deep the deepest press goes [m].
        say: Told in one line when the measured motion is not to be had and the script is used instead.
    """
    mounted = inverse(settings.frames[0])
    if settings.grip == NO_GRIP:
        return framed_device(_intention(settings, surface, press_depth, say), mounted)
    grip = GRIPS[settings.grip]
    intention = _intention(settings, surface, min(press_depth + INTENDED_FORCE / grip.stiffness, DEEPEST), say)
    return framed_device(Hand(intention, grip, settings.device, settings.clutch_times), mounted)


def _intention(settings: SessionSettings, surface: float, press_depth: float, say: Callable[[str], None]) -> Device:
    name = settings.operator
    script = ScriptedOperator(surface, press_depth, settings.seed)
    if name == "browser":
        return BrowserOperator(script, deepest=surface + 1.2 * press_depth)
    if name == "recorded":
        try:
            time, position = read_leader_motion(fetch(RECORDED_MOTION))
        except DatasetError as error:
            say(f"operator: {error}; the script presses instead of the recorded hand")
        else:
            return RecordedOperator(time, position, surface, press_depth)
    return script
