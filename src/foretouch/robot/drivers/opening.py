"""What drivers of bought arms have in common: their library, the arm's host, and how far it is moved."""

from __future__ import annotations

import importlib
import socket
from typing import Any

from foretouch.errors import InputError, MissingExtraError, SettingError
from foretouch.plugins import named_at
from foretouch.robot.drivers.driven_arm import FIRST
from foretouch.robot.robot import Vector

ASIDE, ABOVE, BELOW = 0.15, 0.12, 0.12
"""How far from where it is found an arm is commanded: to the sides, up, and down [m]."""


def library(module: str, package: str, extra: str) -> Any:
    """A module of an optional package, imported here for the first time.

    Raises:
        MissingExtraError: The package is not installed.
    """
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:  # it is there and misses something itself
            raise
        raise MissingExtraError(package, extra) from None


def host_of(settings: Any) -> str:
    """The host in the robot ``NAME@HOST`` of the settings.

    Raises:
        SettingError: There is none.
    """
    name, host = named_at(settings.robot)
    if not host or any(letter.isspace() for letter in host):
        raise SettingError("robot", settings.robot, f"must be {name}@HOST, with the address of the arm's controller")
    return host


def require_answer(name: str, host: str, port: int) -> None:
    """Find out at once whether a controller listens: the libraries wait for minutes.

    Raises:
        InputError: Nothing answers within 3 s.
    """
    try:
        socket.create_connection((host, port), FIRST).close()
    except OSError as error:
        why = error.strerror or str(error) or type(error).__name__
        raise InputError(f"{name}: port {port} does not answer ({why}): see that it is on and reachable") from None


def reach_about(place: Vector) -> tuple[Vector, Vector]:
    """Lowest and highest place that an arm is commanded, which is at this place [m] now."""
    x, y, z = place
    return (x - ASIDE, y - ASIDE, z - BELOW), (x + ASIDE, y + ASIDE, z + ABOVE)
