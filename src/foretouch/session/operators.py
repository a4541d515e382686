"""Operators by name."""

from __future__ import annotations

from collections.abc import Callable

from foretouch.devices import OPERATORS, BrowserOperator, Device, RecordedOperator, ScriptedOperator
from foretouch.errors import DatasetError, UnknownNameError
from foretouch.recordings import fetch, read_leader_motion

__all__ = ["RECORDED_MOTION", "make_operator"]

RECORDED_MOTION = "tue/b-foam"
"""Dataset whose leader lever moves the ``recorded`` operator."""


def make_operator(name: str, *, surface: float, press_depth: float, seed: int, say: Callable[[str], None]) -> Device:
    """The operator of that name, fresh.

    Args:
        name: One of `OPERATORS`.
        surface: Where the material begins [m]; the operator sees it.
        press_depth: How deep the deepest press goes [m].
        seed: Of the script.
        say: Told in one line when the measured motion is not to be had and the script is used instead.

    Raises:
        UnknownNameError: No such operator.
    """
    if name not in OPERATORS:
        raise UnknownNameError("operator", name, OPERATORS)
    script = ScriptedOperator(surface, press_depth, seed)
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
