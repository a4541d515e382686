"""A real arm behind its driver, which may be late, be silent, refuse, or say nonsense."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from foretouch.errors import ForetouchError, InputError, one_line
from foretouch.robot.along_line import AlongLine
from foretouch.robot.drivers.arm_link import ArmLink, ArmState
from foretouch.robot.robot import SpatialRobot, SpatialSample, Vector

FASTEST = 0.25
"""Speed at which an arm is commanded at most [m/s], as ISO 10218-1 has it for people beside it, and as a session does.
Here it holds where an arm begins again elsewhere than it was told to be."""

SILENT, PERIODS = 0.02, 5.0
"""An arm that has said nothing for so long [s], and for so many of its periods, shows no force any more: the sensors of
a session have failed then, and it leaves the contact as it came."""

LOST = 1.0  # Silence after which an arm counts as lost [s]: the session ends
FIRST = 3.0  # Longest time until it says something at first [s]
FARTHEST = 10.0  # A place beyond is none, in whatever unit [m]
STRONGEST = 1e4  # A force beyond is none [N]

NO_FORCE: Vector = (math.nan, math.nan, math.nan)


class LostArmError(ForetouchError):
    """An arm has said nothing for a second: the session ends, and the line says why."""


class DrivenArm(SpatialRobot):
    """A real arm as a follower's robot.

    - What it is commanded stays within its reach, moves by at most 0.25 m/s, and begins where the arm is: also after it
      has refused. While it refuses, it is commanded nothing, and is `held`.
    - Silence and numbers that are none become a force that is none. After a second of silence `exchange` raises, so
      that the session ends in order; until then it goes on commanding, so that an arm that only cannot speak unloads.

    Args:
        link: Its driver.
        clock: Monotonic time [ns].

    Attributes:
        link: As given.
        commanded: Where the tip is told to be [m].

    Raises:
        InputError: It says nothing, or nonsense, within 3 s.
    """

    def __init__(self, link: ArmLink, *, clock: Callable[[], int] = time.monotonic_ns) -> None:
        self.link, self.specification, self.reach = link, link.specification, link.reach
        self._clock, self._fresh, self._refuses, self._why = clock, True, "", ""
        self._silent_ns = round(1e9 * max(SILENT, PERIODS * link.specification.sample_period))
        self._step = FASTEST * link.specification.sample_period
        self._state = self._first()
        self.commanded = self._state.place
        self._wanted: Vector | None = None  # one that only watches is not commanded
        self._sample = self._seen()

    def _first(self) -> ArmState:
        """The first state that makes sense."""
        end, state = self._clock() + round(1e9 * FIRST), None
        while self._clock() < end:
            state = self._asked()
            if state is not None and is_place(state.place):
                return state
            time.sleep(1e-3)
        said = self._why or ("it says nothing" if state is None else f"it says it is at {state.place}")
        self.link.close()
        raise InputError(f"{self.link.name}: no place of its tip within {FIRST:g} s ({said}): connect and start it")

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return self._fresh

    @property
    def says(self) -> str:
        """Why it does not follow; see `AnyRobot.says`."""
        return self._refuses or self._why

    def read(self) -> SpatialSample:
        """What the sensors show now; no time passes and nothing moves."""
        self._listen()
        self._sample = self._seen()
        return self._sample

    def exchange(self, desired: Vector) -> SpatialSample:
        """Give a command and return what the sensors showed last: see `SpatialRobot`. It waits for nothing.

        Raises:
            LostArmError: The arm has been silent for a second.
        """
        self._fresh = False
        self._listen()
        silence = self._clock() - self._state.measured_ns
        if silence > 1e9 * LOST:
            reason = f" ({self._why})" if self._why else ""
            raise LostArmError(
                f"{self.link.name}: it has said nothing for {LOST:g} s{reason}: see that it stands still and unloaded, "
                "connect it and begin again"
            )
        if is_place(desired):
            self._wanted = desired
        if self._refuses:
            self.commanded = self._state.place
        elif self._wanted is not None:
            self._go(self._wanted)
        self._sample = self._seen()
        return self._sample

    def close(self) -> None:
        """Leave the arm at rest and give back the connection; a second call does nothing."""
        self.link.close()

    def _asked(self) -> ArmState | None:
        try:
            state = self.link.state()
        except Exception as error:  # a driver's, whatever it is: the arm is silent
            self._why = one_line(error) or type(error).__name__
            return None
        self._why = ""
        return state

    def _listen(self) -> None:
        """Take the newest state; one that says no place says nothing."""
        state = self._asked()
        if state is not None and is_place(state.place):
            self._state, self._refuses = state, state.refuses

    def _seen(self) -> SpatialSample:
        state = self._state
        silent = self._clock() - state.measured_ns > self._silent_ns
        force = NO_FORCE if silent or not is_force(state.force) else state.force
        return SpatialSample(
            state.place, force, NO_FORCE, NO_FORCE, (), False, held=bool(self._refuses), joints=state.joints
        )

    def _go(self, desired: Vector) -> None:
        """Command a step towards a place."""
        low, high = self.reach
        bounded = [min(max(value, a), b) for value, a, b in zip(desired, low, high, strict=True)]
        way = [value - before for value, before in zip(bounded, self.commanded, strict=True)]
        distance = math.hypot(*way)
        part = min(self._step / distance, 1.0) if distance > 0.0 else 1.0
        x, y, z = (before + part * value for before, value in zip(self.commanded, way, strict=True))
        self.commanded = (x, y, z)
        try:
            self.link.command(self.commanded)
        except Exception as error:
            self._why = one_line(error) or type(error).__name__


def is_place(place: object) -> bool:
    """Whether it is three numbers that a place may have [m]."""
    return _within(place, FARTHEST)


def is_force(force: object) -> bool:
    """Whether it is three numbers that a force may have [N]."""
    return _within(force, STRONGEST)


def _within(values: object, largest: float) -> bool:
    if not isinstance(values, tuple | list) or len(values) != 3:
        return False
    return all(isinstance(value, int | float) and abs(value) <= largest for value in values)


def arm_robot(link: ArmLink, *, in_space: bool) -> DrivenArm | AlongLine:
    """A robot for a session in space, or along the vertical through where the tip is now.

    Args:
        link: The arm's driver.
        in_space: Whether the session has a scene.

    Raises:
        InputError: The arm says nothing within 3 s.
    """
    arm = DrivenArm(link)
    return arm if in_space else AlongLine(arm, arm.read().place)
