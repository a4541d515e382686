"""Safety layer between commands and robot, independent of the leader's messages or silence."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel
from foretouch.errors.checks import require
from foretouch.messages import Status
from foretouch.session.safety import kernel
from foretouch.session.safety.force_guard import AIMED, AWAY
from foretouch.session.safety.motion import Path, begin

_begin = Kernel(begin, "(Path, f8, f8, f8)", Path)

LEFT = 0.6
"""Largest force at which a session leaves its robot, if there is time [N]: a little above that after unloading."""

STATES = tuple(Status)  # The statuses by value


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """Limits that a follower never exceeds, whatever is commanded.

    Args:
        force: Ceiling of the contact force [N]; 15 is the paper's limit for a hand.
        depth: Largest depth below the surface that was felt [m].
        workspace: Smallest and largest position [m].
        speed: Largest speed [m/s].
        acceleration: Largest acceleration [m/s^2].
        jerk: Largest jerk [m/s^3].
        mass: Mass that moves with the probe, for the force of an impact [kg].
        stiffest: Stiffness assumed of an untouched region [N/m]; 1e5 is bone under a probe.
        most_damped: Damping assumed of it at once [N s/m]; 500 is the paper's Kelvin-Voigt material.
        return_speed: Largest speed inwards on the return to the commands after a hold [m/s].
        hold_after: Time without a fresh command until it holds [s].
        unload_after: Time without a fresh command until it unloads [s].
        retreats: Whether it then retraces its path out of the contact.

    Raises:
        SettingError: A number out of range.
    """

    force: float = 15.0
    depth: float = 0.05
    workspace: tuple[float, float] = (-math.inf, math.inf)
    speed: float = 0.25
    acceleration: float = 40.0
    jerk: float = 1e5
    mass: float = 0.4
    stiffest: float = 1e5
    most_damped: float = 500.0
    return_speed: float = 0.05
    hold_after: float = 0.05
    unload_after: float = 0.5
    retreats: bool = False

    def __post_init__(self) -> None:
        for limit in dataclasses.fields(self):
            if limit.name not in ("workspace", "unload_after", "retreats"):
                require(limit.name, getattr(self, limit.name), above=0.0)
        require("unload_after", self.unload_after, at_least=self.hold_after)


class Safety:
    r"""The last stage before the robot, Python's hold of it: a tick is `keep_safe` and `limit` of `kernel`.

    In this order, each tick:

    1. **Status** (`Status`): after an emergency stop it unloads and stays so; with a fault of its sensors it holds;
       without a fresh command it holds after 50 ms, and after 500 ms unloads, or retreats. Unloading is compliant: the
       force is brought to 0.5 N by `ForceGuard`. A stop also retraces its path, at the return speed, until it is 1 mm
       further out than where this contact began: that needs no force. So does a fault of the sensors that lasts as
       long as a silence until it unloads, in commanded positions: that needs no sensor.
    2. **Return** to the commands is inwards no faster than the return speed, until it has kept up with them for
       0.3 s; outwards it is free.
    3. **Force**: deeper no faster than `ForceGuard` allows for 88 % of the ceiling, and back where that is exceeded,
       also while it holds.
    4. **Impact**: where the robot has not gone in before, no faster than

       .. math:: v_0 = \frac{0.88\, F - f}{Z}

       F being the ceiling, f the larger of the measured force and the one proven at that depth, and Z the
       `impact_impedance` of the robot's mass, 3 ms of reaction, and the largest stiffness and damping assumed, both at
       once: the largest force of an impact on all that is no stiffer and no more damped. Where it has, as fast as
       `ProvenWay` allows for three quarters of the ceiling. It brakes in time before a lower limit: at a distance d
       before it, less 0.5 mm of margin, with w the speed allowed there, by

       .. math:: v = \sqrt{(w + A \tau / 2)^2 + A\, d} - A \tau / 2, \quad \tau = 5\ \mathrm{ms}

       Clipping the force alone would come too late: an impact peaks within milliseconds.
    5. **Depth and workspace.**
    6. **Speed, acceleration, jerk** (`Path`), from where the robot is in the first tick, at rest.

    On a surface in space the first five are computed along its normal, and the last once the result is a position in
    space again: `foretouch.session.spatial.safety`.

    It never raises; a NaN command counts as none.

    Args:
        limits: Limits that are never exceeded.
        sample_period: T [s], positive.
        memory: Array of one `foretouch.session.safety.kernel.Memory` for the state, part of another record; None for
            one of its own.

    Attributes:
        limits: As given.
        status: Status in the newest tick.
        stop_reason: Why it was stopped; empty while it is not.
        path: The robot's `Path`, an array of one: that along the line, or a caller's in space.
        blind_speed: Speed at which the robot may approach a possible obstacle before it feels anything [m/s].
        memories: Its state, for compiled code.
    """

    def __init__(self, limits: SafetyLimits, sample_period: float, *, memory: NDArray[np.void] | None = None) -> None:
        require("sample_period", sample_period, above=0.0)
        self.memories = memory = kernel.Memory.new() if memory is None else memory
        memory[:] = kernel.Memory.new(limits=dataclasses.astuple(limits))
        kernel.set_limits(memory, sample_period)
        self._begin = _begin.entry
        kernel.may_release.entry  # noqa: B018  # asked for, it is compiled or loaded: nothing of that in the loop
        self.limits, self.path = limits, memory["motion"]
        self.status, self.stop_reason = Status.FOLLOWING, ""
        self.blind_speed = AIMED * limits.force / float(memory[0].impedance)

    @property
    def pressing(self) -> bool:
        """Whether the robot feels more than 1 N; if unknown, whether it has not yet gone back out of the contact."""
        memory = self.memories[0]
        if memory.faulty_for > 0.0:
            return not memory.motion.position[0] <= memory.came - AWAY
        return not abs(memory.guard.force) <= kernel.REST_FORCE

    def go_on_from(self, position: float) -> None:
        """On a line: go on, at rest, from a position that something else commanded [m]."""
        self._begin(self.path[0], position, 0.0, 0.0)

    def stop(self, reason: str) -> None:
        """Emergency stop: latches; the first reason stays."""
        self.stop_reason = self.stop_reason or reason or "no reason given"

    def release(self, velocity: float, force: float) -> bool:
        """Let a stopped robot follow again, if it is at rest; return whether it was.

        Args:
            velocity: Velocity of the robot [m/s].
            force: Measured force [N].
        """
        rests = kernel.may_release.entry(self.path[0], velocity, force)
        if rests:
            self.stop_reason = ""
        return rests
