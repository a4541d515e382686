"""Operators' handles that move in three dimensions."""

from __future__ import annotations

import itertools
import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from foretouch.devices.browser import BrowserOperator
from foretouch.devices.device import AnyDevice, DeviceSpecification
from foretouch.devices.hand import LONGEST_GAP, Grip, Held, HeldForce
from foretouch.devices.scripted import RestingOperator
from foretouch.errors import SettingError
from foretouch.quantities.pose import Vector

Keyframe = tuple[float, Vector]
"""A time [s] and a place in the fixture's frame [m]."""

SEEING_TIME = 0.15  # Time constant with which an operator follows what the scene shows [s]
TABLE_PERIOD = 2e-3  # Time between computed points of the path [s]; between them it is straight
HALF_REACH = 0.25  # Largest distance of a handle in the browser from the world's origin, along any axis [m]

NOWHERE: Vector = (math.nan, math.nan, math.nan)


class SpatialDevice(AnyDevice):
    """An operator's handle in three dimensions."""

    closed_loop: ClassVar[bool] = False

    @abstractmethod
    def read(self, now_ns: int) -> Vector:
        """Place of the hand in the world's frame [m]."""

    def render(self, force: Vector) -> None:
        """Give the hand a force [N]; a device without force feedback does nothing."""
        return None

    def see(self, pose: Sequence[float]) -> None:
        """See where the virtual scene shows the fixture: a place [m] and a rotation vector [rad]."""
        return None

    @property
    def intention(self) -> Vector:
        """Where the hand wants to be [m] at the newest `read`; NaN where unknown."""
        return NOWHERE

    @property
    def exact_position(self) -> Vector:
        """Position of a simulated hand [m], without the encoders' counts; NaN where unknown."""
        return NOWHERE


class PalpatingOperator(SpatialDevice):
    """Goes smoothly through keyframes, on the fixture where the virtual scene shows it.

    Between keyframes each coordinate is a monotone cubic (Fritsch and Carlson 1980): where it turns or rests it has no
    speed, nowhere does it overshoot, and through all others it passes without a stop.

    An operator looks at the scene and not at the world: a pose given to `see` moves the whole path, with the time that
    a hand needs to follow an eye (0.15 s).

    Args:
        keyframes: Times, growing, and positions in the fixture's frame; after the last one the path begins again with
            the second, so these two are at one position.
        pose: Pose of the fixture, as the scene shows it at first.
        scale: Follower's motion over the hand's: the hand's is smaller by this factor.

    Raises:
        SettingError: Fewer than two keyframes, times that do not grow, or an end that is elsewhere than the second.
    """

    name = "scripted"

    def __init__(self, keyframes: Sequence[Keyframe], pose: Sequence[float], scale: float = 1.0) -> None:
        self._scale = scale
        times = [time for time, _ in keyframes]
        if len(times) < 2 or not all(a < b for a, b in itertools.pairwise(times)):
            raise SettingError("keyframes", len(times), "must be two or more with growing times")
        if math.dist(keyframes[1][1], keyframes[-1][1]) > 1e-6:
            raise SettingError("keyframes", keyframes[-1], f"must end where the second is, at {keyframes[1][1]}")
        from scipy.interpolate import PchipInterpolator

        from foretouch.devices.hand_kernel import Seeing, look

        self._first, self._last = times[1], times[-1]
        ticks = np.arange(0.0, times[-1] + TABLE_PERIOD, TABLE_PERIOD)
        path = PchipInterpolator(times, np.array([position for _, position in keyframes]))
        self._table = np.ascontiguousarray(path(np.minimum(ticks, times[-1])))
        self._aimed = tuple(pose)
        self._seeings, self._look = Seeing.new(shown=self._aimed, aimed=self._aimed), look.entry
        self._start_ns: int | None = None
        self._now_ns = 0
        self._place: Vector = NOWHERE

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self._start_ns is None

    def see(self, pose: Sequence[float]) -> None:
        """Aim at the fixture where it is shown; a pose that is not six finite numbers is left out."""
        if pose is self._aimed:  # a tuple does not change
            return
        if len(pose) == 6 and all(map(math.isfinite, pose)):
            self._seeings["aimed"] = self._aimed = tuple(pose)

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m]."""
        if self._start_ns is None:
            self._start_ns = self._now_ns = now_ns
        elapsed = max(now_ns - self._now_ns, 0) * 1e-9
        self._now_ns = max(now_ns, self._now_ns)
        time = (self._now_ns - self._start_ns) * 1e-9
        if time > self._last:
            time = self._first + (time - self._first) % (self._last - self._first)
        self._place = self._look(self._seeings, self._table, time / TABLE_PERIOD, elapsed / SEEING_TIME, self._scale)
        return self._place

    @property
    def intention(self) -> Vector:
        """Where the hand is: nothing else moves it."""
        return self._place


class RecordedPalpatingOperator(PalpatingOperator):
    """The same, where the presses of the path are measured ones."""

    name = "recorded"


class _Axis(RestingOperator):
    """One coordinate of a place, shifted so that it is positive: a script for `BrowserOperator`."""

    value = 0.0

    def read(self, now_ns: int) -> float:
        return self.value + HALF_REACH


class SpatialBrowserOperator(SpatialDevice):
    """Palpates by script until the handle in the browser is taken: `BrowserOperator`, once an axis.

    Args:
        script: Operator that moves while the handle is free.
        scale: Follower's motion over the hand's; the handle in the browser is the follower's desired position.
    """

    name = "browser"

    def __init__(self, script: SpatialDevice, scale: float = 1.0) -> None:
        self._script = script
        self._scale = scale
        self._scripts = [_Axis() for _ in range(3)]
        self._axes = [BrowserOperator(axis, deepest=2.0 * HALF_REACH) for axis in self._scripts]
        self._place: Vector = NOWHERE

    @property
    def fresh(self) -> bool:
        """Whether nothing was read yet."""
        return self._script.fresh

    @property
    def held(self) -> bool:
        """Whether the handle is held."""
        return self._axes[0].held

    @property
    def clutched(self) -> bool:
        """Whether the clutch is pressed, as the newest handle message says."""
        return self._axes[0].clutched

    @property
    def intention(self) -> Vector:
        """Where the hand is: nothing else moves it."""
        return self._place

    def see(self, pose: Sequence[float]) -> None:
        """The script aims at the fixture where it is shown; a mouse does so by itself."""
        self._script.see(pose)

    def take(self, place: Sequence[float], held: bool, now_ns: int, *, clutched: bool = False) -> None:
        """One handle message.

        Args:
            place: Position of the handle in the world [m]; one that is not three finite numbers is ignored.
            held: Whether it is being dragged.
            now_ns: Time of the message's arrival [ns], by the clock that `read` gets.
            clutched: Whether the clutch is pressed, from now on.
        """
        if len(place) != 3 or not all(map(math.isfinite, place)):
            return
        for axis, value in zip(self._axes, place, strict=True):
            axis.take(value / self._scale + HALF_REACH, held, now_ns, clutched=clutched)

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m]."""
        for axis, value in zip(self._scripts, self._script.read(now_ns), strict=True):
            axis.value = value
        x, y, z = (axis.read(now_ns) - HALF_REACH for axis in self._axes)
        self._place = (x, y, z)
        return self._place


class SpatialHand(Held, SpatialDevice):
    """A hand that holds a device of three axes; each axis moves as `foretouch.devices.Hand` does.

    The axes do not know of each other: Coulomb friction acts on each by itself.

    Args:
        intention: What the hand wants, an operator that feels nothing itself.
        grip: How the hand holds the device.
        specification: The device, the same along each axis.
        clutch: Intervals with the clutch held: (start, end) in seconds since the first `read`.

    Raises: As of `foretouch.devices.hand.Held`.
    """

    def __init__(
        self,
        intention: SpatialDevice,
        grip: Grip,
        specification: DeviceSpecification,
        clutch: Sequence[tuple[float, float]] = (),
    ) -> None:
        super().__init__(intention, specification, clutch)
        made = [grip.holds(specification) for _ in range(3)]
        self._hands, self._move = [held for held, _ in made], made[0][1]
        self._positions = [held["position"] for held in self._hands]
        self._aim: Vector = NOWHERE
        self._forces: HeldForce[Vector] = HeldForce((0.0, 0.0, 0.0), specification.delay, specification.watchdog)

    @property
    def intention(self) -> Vector:
        """Where the hand wants to be [m]."""
        return self._aim

    @property
    def exact_position(self) -> Vector:
        """Where the hand is [m], not rounded."""
        if self._start_ns is None:
            return NOWHERE
        x, y, z = (float(position[0]) for position in self._positions)
        return x, y, z

    def see(self, pose: Sequence[float]) -> None:
        """The intention aims at the fixture where it is shown."""
        self.intention_device.see(pose)

    def read(self, now_ns: int) -> Vector:
        """Place of the hand [m] as the encoders show it, in whole counts."""
        aim = self.intention_device.read(now_ns)
        if self._start_ns is None:
            self._start_ns = self._now_ns = now_ns
            self._aim = aim
            for position, wanted in zip(self._positions, aim, strict=True):
                position[0] = wanted
        elif now_ns > self._now_ns:
            period = min((now_ns - self._now_ns) * 1e-9, LONGEST_GAP)
            passed = 0.0
            for time, forces in self._forces.over(now_ns - round(period * 1e9), now_ns):
                for held, before, wanted, force in zip(self._hands, self._aim, aim, forces, strict=True):
                    speed = (wanted - before) / period
                    self._move(held, before + speed * passed, speed, -force, time)
                passed += time
            self._aim, self._now_ns = aim, now_ns
        x, y, z = map(self._counted, self._positions)
        return x, y, z

    def render(self, force: Vector) -> None:
        """Hold a force [N] from a delay after the newest `read` on, at most the limit; no number is none."""
        size = math.sqrt(force[0] ** 2 + force[1] ** 2 + force[2] ** 2)
        if not size < math.inf:
            self._forces.render((0.0, 0.0, 0.0), self._now_ns)
            return
        fraction = min(self.specification.force_limit / size, 1.0) if size > 0.0 else 1.0
        self._forces.render((force[0] * fraction, force[1] * fraction, force[2] * fraction), self._now_ns)
