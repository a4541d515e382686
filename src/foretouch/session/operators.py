"""Operators by name."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.devices import GRIPS, INTENDED_FORCE, BrowserOperator, Device, Hand, RecordedOperator, ScriptedOperator
from foretouch.errors import DatasetError, SettingError
from foretouch.recordings import fetch, read_leader_motion
from foretouch.session.frames import framed_device, inverse
from foretouch.session.settings import NO_GRIP, SessionSettings

__all__ = ["RECORDED_MOTION", "make_operator"]

RECORDED_MOTION = "tue/b-foam"
"""Dataset whose leader lever moves the ``recorded`` operator."""

NEAREST_SURFACE, FARTHEST_SURFACE, SHALLOWEST, DEEPEST = 0.001, 0.2, 0.0005, 0.1
"""How near and far a surface can be for the operators, and how deep they press at least and at most [m]."""


def make_operator(
    settings: SessionSettings, *, surface: float, press_depth: float, say: Callable[[str], None]
) -> Device:
    """The operator of a session, fresh; with a grip, a hand that intends what that operator does.

    It counts as the settings' leader frame says: a simulated device is built to.

    Args:
        settings: Of the session.
        surface: Where the material begins [m], for the follower; the operator sees it.
        press_depth: How deep the deepest press goes [m], there.
        say: Told in one line when the measured motion is not to be had and the script is used instead.

    Raises:
        SettingError: A position scale by which the operator's hand cannot reach the material.
    """
    surface, press_depth = _hand_lengths(settings, surface, press_depth)
    mounted = inverse(settings.frames[0])
    if settings.grip == NO_GRIP:
        return framed_device(_intention(settings, surface, press_depth, say), mounted)
    grip = GRIPS[settings.grip]
    intention = _intention(settings, surface, min(press_depth + INTENDED_FORCE / grip.stiffness, DEEPEST), say)
    return framed_device(Hand(intention, grip, settings.device, settings.clutch_times), mounted)


def _hand_lengths(settings: SessionSettings, surface: float, press_depth: float) -> tuple[float, float]:
    """Where the hand meets the surface and how deep it goes [m], so that the proxy does what the follower is to do."""
    scale = settings.position_scale
    least = max(surface / FARTHEST_SURFACE, press_depth / DEEPEST)
    most = min(surface / NEAREST_SURFACE, press_depth / SHALLOWEST)
    if not least <= scale <= most:
        rule = f"an operator of the package reaches this material by a scale of {least:.3g} to {most:.3g}"
        raise SettingError("position_scale", scale, rule)
    return surface / scale, press_depth / scale


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
