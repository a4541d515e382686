"""What drivers of bought arms have in common: their library, the arm's host, and how far it is moved."""

from __future__ import annotations

import importlib
import socket
import threading
from collections.abc import Callable
from typing import Any, TypeVar

from foretouch.errors import InputError, MissingExtraError, SettingError, one_line
from foretouch.plugins import named_at
from foretouch.robot.drivers.driven_arm import FIRST
from foretouch.robot.robot import Vector

ASIDE, ABOVE, BELOW = 0.15, 0.12, 0.12
"""How far from where it is found an arm is commanded: to the sides, up, and down [m]."""

OPENING = 10.0  # Longest time that a library gets for its connection [s]

Made = TypeVar("Made")


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


def require_answer(name: str, host: str, port: int, question: bytes = b"") -> None:
    """Find out at once whether a controller listens: the libraries wait for minutes, or for ever.

    Args:
        name: Of the arm, for people.
        host: Of its controller.
        port: Where it listens.
        question: What it answers with anything; empty where it is not asked.

    Raises:
        InputError: Nothing answers within 3 s.
    """
    try:
        with socket.create_connection((host, port), FIRST) as connection:
            if question:
                connection.sendall(question)
                connection.recv(1)
    except OSError as error:
        why = error.strerror or str(error) or type(error).__name__
        raise InputError(f"{name}: port {port} does not answer ({why}): see that it is on and reachable") from None


def opened(name: str, make: Callable[[], Made], advice: str) -> Made:
    """What a library makes of a connection, in a thread that is not waited for for ever.

    Args:
        name: Of the arm, for people.
        make: The library's call, which waits without Python's lock.
        advice: What to do where it fails.

    Raises:
        InputError: It raises, or has made nothing after 10 s.
    """
    made: list[Made] = []
    failed: list[str] = ["it does not answer"]

    def attempt() -> None:
        try:
            made.append(make())
        except Exception as error:  # whatever the library raises
            failed.append(one_line(error) or type(error).__name__)

    thread = threading.Thread(target=attempt, name="opening", daemon=True)
    thread.start()
    thread.join(OPENING)
    if not made:
        raise InputError(f"{name}: {failed[-1]}: {advice}")
    return made[0]


def reach_about(place: Vector) -> tuple[Vector, Vector]:
    """Lowest and highest place that an arm is commanded, which is at this place [m] now."""
    x, y, z = place
    return (x - ASIDE, y - ASIDE, z - BELOW), (x + ASIDE, y + ASIDE, z + ABOVE)
