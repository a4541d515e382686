"""What a console may choose while a session runs, and who hears it: the process that supervises the others."""

from __future__ import annotations

import dataclasses
import math
import time

from foretouch.errors import SettingError
from foretouch.link import ZenohLink
from foretouch.messages import Choice, EmergencyStop, Hello, Settings
from foretouch.robot import make_material
from foretouch.session.housekeeping import HELLO_PERIOD
from foretouch.session.settings import SessionSettings

__all__ = ["CHOICE_CHANNELS", "SUPERVISOR", "Desk", "choose", "with_faults"]

CHOICE_CHANNELS = ("choice", "settings", "stop", "emergency", "hello")
"""What the supervisor's link receives."""

SUPERVISOR = "supervisor"
"""Its role in `Hello` messages."""

LATCHING = 2.0
"""For so long [s] after an emergency stop was asked for it counts as latched, whatever the follower has said so far."""


def choose(settings: SessionSettings, choice: Choice) -> SessionSettings:
    """The settings with what was chosen in their place; what is "" stays.

    Args:
        settings: Of the session as it runs.
        choice: From a console.

    Raises:
        SettingError: A choice that other settings forbid.
        UnknownNameError: No such material, operator or grip.
    """
    named = {name: getattr(choice, name) for name in ("material", "operator", "grip")}
    chosen = dataclasses.replace(settings, **{name: value for name, value in named.items() if value})
    make_material(chosen.material)
    return chosen


def with_faults(settings: SessionSettings, faults: Settings) -> SessionSettings:
    """The settings with the delays and faults that a console has set since, for processes that start now.

    Args:
        settings: Of the session as it was started.
        faults: From a console; what other settings forbid leaves them as they were.
    """
    names = ("position_delay", "force_delay", "jitter", "loss", "outage")
    try:
        return dataclasses.replace(settings, **{name: getattr(faults, name) for name in names})
    except SettingError:
        return settings


class Desk:
    """Where the supervisor hears consoles, and says what runs.

    Args:
        link: With `CHOICE_CHANNELS`, joined to the follower and to the console.

    Attributes:
        refused: Why the newest choice was not followed; "" where it was.
        recording: File that is being written; "" for none.
        faults: Delays and faults that a console has set, None before the first.
        compiling: How far compiling is before the session can begin, "" while nothing is compiled.
        ended: When somebody asked for the session's end [s], infinite before.
    """

    def __init__(self, link: ZenohLink) -> None:
        self._link = link
        self._hellos = 0
        self._spoken = -math.inf
        self._stop_asked = -math.inf
        self._stop_said = ""
        self.refused = ""
        self.recording = ""
        self.compiling = ""
        self.faults: Settings | None = None
        self.ended = math.inf

    def hear(self) -> list[Choice]:
        """Take what has arrived; what was chosen, oldest first."""
        for _, message in self._link.take("emergency"):
            if isinstance(message, EmergencyStop):
                self._stop_asked = time.monotonic()
        for _, hello in self._link.take("hello"):
            if hello.role == "follower":
                self._stop_said = hello.texts.get("stopped", "")
        if self._link.take("stop"):
            self.ended = min(self.ended, time.monotonic())
        if faults := self._link.take("settings"):
            self.faults = faults[-1][1]
        return [choice for _, choice in self._link.take("choice")]

    @property
    def latched(self) -> bool:
        """Whether an emergency stop holds the robot: a follower that began anew would have forgotten it."""
        return bool(self._stop_said) or time.monotonic() - self._stop_asked < LATCHING

    def say(self) -> None:
        """Publish a `Hello` if it is time for one."""
        now = time.monotonic()
        if now - self._spoken < HELLO_PERIOD:
            return
        self._spoken, self._hellos = now, self._hellos + 1
        texts = {"supervised": "yes", "recording": self.recording, "refused": self.refused}
        if self.compiling:
            texts["compiling"] = self.compiling
        self._link.publish(Hello.of(SUPERVISOR, self._hellos, time.monotonic_ns(), texts))

    def say_now(self) -> None:
        """Publish a `Hello`, for something has changed."""
        self._spoken = -math.inf
        self.say()

    def close(self) -> None:
        """Leave the network."""
        self._link.close()
