"""What stands between commands and robot: whatever the leader says, and whether it says anything."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from foretouch.messages import Status
from foretouch.models.checks import require
from foretouch.session.force_guard import ForceGuard
from foretouch.session.motion_limits import POSITION, VELOCITY, MotionLimits

__all__ = ["REST_FORCE", "Safety", "SafetyLimits", "impact_speed"]

STIFFEST, MOST_DAMPED = 1e5, 500.0
"""What nobody has struck yet counts as so stiff [N/m], which is bone under a probe, and so damped [N s/m]."""

AIMED = 0.95
"""Share of the force ceiling that a press is brought to: a sensor errs, and a drive passes its aim by a little."""

HIDDEN = 2.0
"""A contact counts as so many times more damped than it was felt: what it damps, it ends before a sensor shows it."""

IMPACT_SHARE, DAMPING_SHARE = 0.45, 0.75
"""Shares of the force ceiling that mass and stiffness, and damping, may take in an impact by their formulas: drive and
sensor are late beside the first; the second is there at once, and a robot that sets out overshoots its speed."""

MARGIN = 2e-3
"""It has braked so far before the surface [m]: a drive is late."""

UNLOADED, REST_FORCE = 0.5, 1.0
"""A robot that unloads goes back until it feels the first [N]; the second counts as unloaded [N]."""

REST_SPEED, SEEN_AT_REST = 5e-3, 1e-2
"""A robot is at rest whose path is slower than the first, and whose own velocity, as its encoder shows it, than the
second [m/s]."""

REJOINED_FOR = 0.3
"""A robot that has kept up with the commands for so long [s] follows them again: longer than the playout takes to lead
from where it was held to where they are."""

STATES = tuple(Status)
"""By value."""

CLEARANCE = 5e-3
"""A robot that retreats goes so far out of the contact that it was in [m]."""


@dataclass(frozen=True, slots=True)
class SafetyLimits:
    """What a follower never does, whatever it is told.

    Args:
        force: Ceiling of the contact force [N]; 15 is what the paper holds for a hand.
        depth: Deepest below the surface that was felt [m].
        workspace: Smallest and largest position [m].
        speed: [m/s].
        acceleration: [m/s^2].
        jerk: [m/s^3].
        mass: That moves with the probe [kg]: for `impact_speed`.
        return_speed: Inwards, on the way back to the commands after it was held [m/s].
        hold_after: Time without a fresh command until it holds [s].
        unload_after: And until it unloads [s].
        retreats: Whether it then goes out the way that it came.

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
    return_speed: float = 0.05
    hold_after: float = 0.05
    unload_after: float = 0.5
    retreats: bool = False

    def __post_init__(self) -> None:
        for name in ("force", "depth", "speed", "acceleration", "jerk", "mass", "return_speed", "hold_after"):
            require(name, getattr(self, name), above=0.0)
        require("unload_after", self.unload_after, at_least=self.hold_after)


def impact_speed(force: float, mass: float, stiffness: float) -> float:
    r"""Speed at which a mass meets a spring so that the force of the impact peaks at this [m/s].

    .. math:: v = \frac{F}{\sqrt{m K}}

    by the energy of both; what a drive adds, which pushes on until it feels the contact, is not in it.

    Args:
        force: F [N].
        mass: m [kg].
        stiffness: K [N/m].
    """
    return force / math.sqrt(mass * stiffness)


class Safety:
    r"""The last stage before the robot.

    In this order, each tick:

    1. **What it does** (`Status`): after an emergency stop it unloads and stays so; with a fault of its sensors it
       holds; without a fresh command it holds after 50 ms, and after 500 ms unloads, or retreats. Unloading is
       compliant: the force is brought to 0.5 N as `ForceGuard` says.
    2. **The way back** to the commands is inwards no faster than the return speed, until it has been with them for
       0.3 s; outwards it is free.
    3. **Force**: deeper no faster than `ForceGuard` allows for 95 % of the ceiling, and back where that is passed, also
       while it holds.
    4. **Impact**: towards what may be there no faster than

       .. math:: v = \sqrt{v_0^2 + A\, d}, \quad v_0 = \min\left(\frac{0.45\, F}{\sqrt{m K}}, \frac{0.75\, F}{b}\right)

       d being the way to 2 mm before the surface that was felt, 0 while there is none; K the stiffest contact so far,
       at most 100 kN/m, and b twice the most damped, at most 500 N s/m. Both are that as long as no surface is known,
       or no contact began at 10 mm/s or more. Clipping the force alone would come too late: an impact peaks at about
       :math:`v \sqrt{m K}`, and what damps pushes with :math:`b v` at once.
    5. **Depth and workspace.**
    6. **Speed, acceleration, jerk** (`MotionLimits`), from where the robot is in the first tick, at rest.

    On a surface in space the first five are reckoned along its normal, and the last once that is a place again: see
    `in_space`.

    It never raises; a command that is no number counts as none.

    Args:
        limits: What is never done.
        sample_period: T [s], positive.

    Attributes:
        status: What it did in the newest tick.
        stop_reason: Why it was stopped; empty while it is not.
        pressing: Whether the robot feels more than 1 N, or nobody knows what it feels.
    """

    __slots__ = ("_keep", "_kernel", "_limits", "_memory", "_motion", "_path", "pressing", "status", "stop_reason")

    def __init__(self, limits: SafetyLimits, sample_period: float) -> None:
        # Imported here: it brings a compiler along, and imports the numbers above.
        from foretouch.session import safety_kernel as kernel

        self._kernel, self._keep = kernel, kernel.keep_safe
        self._memory = np.zeros(kernel.SIZE)
        ForceGuard(self._memory[kernel.GUARD : kernel.MOTION])
        self._path = self._memory[kernel.MOTION :]
        self._limits = limits.speed, limits.acceleration, limits.jerk, sample_period
        self._motion = MotionLimits(*self._limits, path=self._path)
        self._memory[kernel.AIM] = math.nan
        self._memory[kernel.NEAREST] = -math.inf
        self._memory[kernel.NEW] = 1.0  # it has not followed yet: nothing leads from anywhere
        self._memory[kernel.FORCE : kernel.PERIOD] = (
            limits.force,
            limits.depth,
            *limits.workspace,
            limits.speed,
            limits.acceleration,
            limits.mass,
            limits.return_speed,
            limits.hold_after,
            limits.unload_after,
            limits.retreats,
        )
        self._memory[kernel.PERIOD] = sample_period
        self.status = Status.FOLLOWING
        self.stop_reason = ""
        self.pressing = False

    def in_space(self) -> MotionLimits:
        """Leave the last rule to who brings the aim into space: its limits, for places there.

        From then on `update` returns the aim, and `went` is told in each tick what came of it.
        """
        self._memory[self._kernel.IN_SPACE] = 1.0
        self._motion = MotionLimits(*self._limits)
        return self._motion

    @property
    def fastest(self) -> float:
        """Speed at which the robot may go deeper now, negative where it has to go back [m/s]."""
        return float(self._memory[self._kernel.FASTEST])

    @property
    def shifted(self) -> float:
        """By how far the aim was set elsewhere in the newest tick [m], not positive: no motion of it."""
        return float(self._memory[self._kernel.SHIFTED])

    def went(self, position: float, velocity: float, nearest: float) -> None:
        """In space: where the robot was told to be.

        Args:
            position: Along the normal that the aim is on [m].
            velocity: Towards the surface [m/s].
            nearest: Where that place itself is against the surface [m].
        """
        self._path[POSITION], self._path[VELOCITY] = position, velocity
        self._memory[self._kernel.NEAREST] = nearest

    def go_on_from(self, position: float) -> None:
        """On a line: the robot was told this position by somebody else [m]; the path goes on there, at rest."""
        self._motion.begin(position)

    def stop(self, reason: str) -> None:
        """Emergency stop: latches; the first reason stays."""
        self.stop_reason = self.stop_reason or reason or "no reason given"

    def release(self, velocity: float, force: float) -> bool:
        """Let a stopped robot follow again, if it is at rest: whether it was.

        Args:
            velocity: Of the robot [m/s].
            force: That it feels [N].
        """
        still = self._motion.speed <= REST_SPEED and abs(velocity) <= SEEN_AT_REST
        if not (still and abs(force) <= REST_FORCE):
            return False
        self.stop_reason = ""
        return True

    def update(
        self,
        desired: float,
        position: float,
        force: float,
        in_contact: bool,
        *,
        surface: float,
        silence: float,
        faulty: bool,
        guarded: bool = False,
        surface_doubt: float = 0.0,
    ) -> float:
        """One tick: the position for the robot, in space the aim [m]; no number before it is known where the robot is.

        Args:
            desired: What the commands say [m].
            position: Where the robot is [m].
            force: That it feels [N].
            in_contact: Whether that is contact.
            surface: That was felt [m]; NaN while there is none.
            silence: Time since the newest fresh command [s]; infinite before the first.
            faulty: Whether the sensors are not to be trusted.
            guarded: Whether `desired` was held back for a first touch.
            surface_doubt: The surface may be nearer than it was felt by so much [m]: it was felt elsewhere.
        """
        told, status, self.pressing = self._keep(
            self._memory,
            self.stop_reason != "",
            desired,
            position,
            force,
            in_contact,
            surface,
            silence,
            faulty,
            guarded,
            surface_doubt,
        )
        self.status = STATES[status]
        return told
