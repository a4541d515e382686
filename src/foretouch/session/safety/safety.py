"""What stands between commands and robot: whatever the leader says, and whether it says anything."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.messages import Status
from foretouch.models.impact_bound import impact_impedance
from foretouch.session.safety import kernel
from foretouch.session.safety.force_guard import ForceGuard
from foretouch.session.safety.motion import POSITION, VELOCITY, MotionLimits
from foretouch.session.safety.proven_way import ProvenWay

REACTION = 3e-3
"""After its first touch a robot is no faster than before for so long [s], and then stops: its sensor and drive are as
late as that. The simulated arm takes 2.3 to 2.8 ms."""

LEFT = 0.6
"""With no more than this [N] a session leaves its robot, if there is time: a little over what unloading comes to."""

REST_SPEED, SEEN_AT_REST = 5e-3, 1e-2
"""A robot is at rest whose path is slower than the first, and whose own velocity, as its encoder shows it, than the
second [m/s]."""

STATES = tuple(Status)
"""By value."""


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
        mass: That moves with the probe [kg]: what an impact is of.
        stiffest: What nobody has gone through yet counts as so stiff [N/m]; 1e5 is bone under a probe.
        most_damped: And as so damped at once [N s/m]; 500 is the paper's Kelvin-Voigt material.
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
    r"""The last stage before the robot.

    In this order, each tick:

    1. **What it does** (`Status`): after an emergency stop it unloads and stays so; with a fault of its sensors it
       holds; without a fresh command it holds after 50 ms, and after 500 ms unloads, or retreats. Unloading is
       compliant: the force is brought to 0.5 N as `ForceGuard` says. A stop also goes back by the way, at the return
       speed, until it is 1 mm further out than where this contact began: it needs no force for that. So does a fault
       of the sensors that lasts as long as a silence until it unloads, in what the robot was told: it needs none.
    2. **The way back** to the commands is inwards no faster than the return speed, until it has been with them for
       0.3 s; outwards it is free.
    3. **Force**: deeper no faster than `ForceGuard` allows for 88 % of the ceiling, and back where that is passed, also
       while it holds.
    4. **Impact**: where the robot has not gone in through itself, no faster than

       .. math:: v_0 = \frac{0.88\, F - f}{Z}

       F being the ceiling, f the force that is felt, or that was when it was there, and Z what `impact_impedance` says
       of the robot's mass, 3 ms of reaction, and the stiffest and most damped that is assumed, as both at once: the
       largest force of an impact of all that is no stiffer and no more damped. Where it has, as fast as `ProvenWay`
       says for three quarters of the ceiling. It brakes in time before what allows less: at a way d before, 0.5 mm of
       margin off, and w being allowed there, by

       .. math:: v = \sqrt{(w + A \tau / 2)^2 + A\, d} - A \tau / 2, \quad \tau = 5\ \mathrm{ms}

       Clipping the force alone would come too late: an impact peaks within milliseconds.
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
        pressing: Whether the robot feels more than 1 N; while nobody knows what it feels, whether it is not yet out by
            the way that it came.
    """

    __slots__ = (
        "_limits",
        "_memory",
        "_motion",
        "_path",
        "_period",
        "_proven",
        "pressing",
        "status",
        "stop_reason",
    )

    def __init__(self, limits: SafetyLimits, sample_period: float) -> None:
        self._memory = np.zeros(kernel.SIZE)
        ForceGuard(self._memory[kernel.GUARD : kernel.MOTION])
        self._proven = ProvenWay(self._memory[kernel.WAY :])
        self._path = self._memory[kernel.MOTION : kernel.WAY]
        self._limits, self._period = limits, sample_period
        self._motion = self._motion_limits(self._path)
        self._memory[kernel.AIM] = self._memory[kernel.CAME] = math.nan
        self._memory[kernel.NEAREST] = -math.inf
        self._memory[kernel.NEW] = 1.0  # it has not followed yet: nothing leads from anywhere
        self._memory[kernel.IMPEDANCE] = impact_impedance(limits.stiffest, limits.most_damped, limits.mass, REACTION)
        self._memory[kernel.DAMPING] = limits.most_damped
        self._memory[kernel.FORCE : kernel.PERIOD] = (
            limits.force,
            limits.depth,
            *limits.workspace,
            limits.speed,
            limits.acceleration,
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
        self._memory[kernel.IN_SPACE] = 1.0
        self._motion = self._motion_limits()
        return self._motion

    def _motion_limits(self, path: NDArray[np.float64] | None = None) -> MotionLimits:
        limits = self._limits
        return MotionLimits(limits.speed, limits.acceleration, limits.jerk, self._period, path=path)

    @property
    def limits(self) -> SafetyLimits:
        """What is never done."""
        return self._limits

    @property
    def blind_speed(self) -> float:
        """Speed at which the robot may come to what may be there, feeling nothing yet [m/s]."""
        memory = self._memory
        return float(kernel.AIMED * memory[kernel.FORCE] / memory[kernel.IMPEDANCE])

    def comes_nearer(self, speed: float) -> None:
        """In space: by what goes along the surface it may come nearer at this speed [m/s]."""
        self._memory[kernel.NEARING] = speed

    @property
    def fastest(self) -> float:
        """Speed at which the robot may go deeper now, negative where it has to go back [m/s]."""
        return float(self._memory[kernel.FASTEST])

    @property
    def shifted(self) -> float:
        """By how far the aim was set elsewhere in the newest tick [m], not positive: no motion of it."""
        return float(self._memory[kernel.SHIFTED])

    def went(self, position: float, velocity: float, nearest: float) -> None:
        """In space: where the robot was told to be.

        Args:
            position: Along the normal that the aim is on [m].
            velocity: Towards the surface [m/s].
            nearest: Where that place itself is against the surface [m].
        """
        self._path[POSITION], self._path[VELOCITY] = position, velocity
        self._memory[kernel.NEAREST] = nearest

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
        if not (still and abs(force) <= kernel.REST_FORCE):
            return False
        self.stop_reason = ""
        return True

    def forget_way(self) -> None:
        """What the way in has proven is of another place: it counts as untouched again."""
        self._proven.forget()

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
        free: float = -math.inf,
        doubtful: bool = False,
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
            free: Up to there nothing is in the way, though the robot has not gone there itself [m].
            doubtful: Whether it is being judged if the force can be believed: until then it goes no deeper.
        """
        told, status, self.pressing = kernel.keep_safe(
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
            free,
            doubtful,
        )
        self.status = STATES[status]
        return told
