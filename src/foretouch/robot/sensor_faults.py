"""Sensors that fail, on purpose and on time: any robot with one fault of its force sensor or encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import numpy as np

from foretouch.errors import SettingError, UnknownNameError
from foretouch.errors.checks import require
from foretouch.quantities import shortest
from foretouch.robot.robot import Wrapped, WrappedRobot, WrappedSpatialRobot

SENSOR_FAULTS: Final[dict[str, str]] = {
    "nan": "the force is no number",
    "dropout": "no new values: force, acceleration and position repeat",
    "stuck": "the force repeats, the position goes on",
    "saturated": "the force shows the end of the sensor's range",
    "offset-step": "the force is off by 3 N",
    "spikes": "about every 50 ms one sample of the force is off by 5 to 20 N, either way",
    "encoder-jump": "the position is off by 5 mm",
}
"""Faults by name, and what the sensors show then."""

OFFSET = 3.0  # Size of an offset step [N]
JUMP = 5e-3  # Size of an encoder jump [m]
SPIKE_INTERVAL = 0.05  # Mean time between two spikes [s]; they are at least 3 samples apart
SPIKE_SIZES = (5.0, 20.0)  # Smallest and largest spike [N]
UNKNOWN_RANGE = 50.0  # Force that a saturated sensor of unknown range shows [N]


@dataclass(frozen=True, slots=True)
class SensorFault:
    """A fault, and when.

    Args:
        kind: One of `SENSOR_FAULTS`.
        begin: [s] of the robot's own time, which begins at its first exchange; not negative.
        end: [s], later than the beginning; infinite for one that stays.

    Raises:
        UnknownNameError: No such fault.
        SettingError: It ends before it begins.
    """

    kind: str
    begin: float
    end: float = math.inf

    def __post_init__(self) -> None:
        if self.kind not in SENSOR_FAULTS:
            raise UnknownNameError("sensor fault", self.kind, SENSOR_FAULTS)
        require("begin", self.begin, at_least=0.0)
        if not self.end > self.begin:
            raise SettingError("end", self.end, f"must be later than the beginning, {self.begin:g} s")

    def __str__(self) -> str:
        """The text that `from_text` reads."""
        return ":".join([self.kind, *map(shortest, (self.begin, self.end))]).removesuffix(":inf")

    @classmethod
    def from_text(cls, name: str, text: str) -> SensorFault:
        """The fault that a setting of this name gives as ``KIND:BEGIN`` or ``KIND:BEGIN:END``, such as ``stuck:5:8``.

        Raises:
            UnknownNameError: No such fault.
            SettingError: It is nothing of the kind.
        """
        kind, *times = text.split(":")
        if kind not in SENSOR_FAULTS:
            raise UnknownNameError(name, kind, SENSOR_FAULTS)
        try:
            begin, end = (float(time) for time in (times if len(times) == 2 else [*times, "inf"]))
            return cls(kind, begin, end)
        except (ValueError, SettingError):
            rule = "must be KIND:BEGIN or KIND:BEGIN:END in seconds, the end after the beginning; for example stuck:5:8"
            raise SettingError(name, text, rule) from None


class _Faulty(Wrapped[Any, Any]):
    """A robot whose sensors fail for a while."""

    _names: ClassVar[tuple[str, ...]] = ("position", "sensor_force", "acceleration")
    """Fields of a sample: position, force, and what else repeats in a dropout."""

    def __init__(self, robot: Any, fault: SensorFault, *, seed: int = 0) -> None:
        require("seed", seed, at_least=0)
        super().__init__(robot)
        self.fault, self.faulty = fault, False
        self._random, self._next_spike = np.random.default_rng(seed), 0
        self._sample = self._last_good = robot.read()

    def read(self) -> Any:
        """What the sensors show now; no time passes and nothing moves."""
        return self._sample

    def exchange(self, desired_position: Any) -> Any:
        """Give a command, let one sample period pass, and return what the sensors show then: see `Robot`."""
        sample = self.robot.exchange(desired_position)
        self._exchanges += 1
        time = self._exchanges * self.specification.sample_period
        inside = self.fault.begin <= time < self.fault.end
        self._sample = sample._replace(**self._changes(sample)) if inside else sample
        self.faulty = self._sample != sample
        if not inside:
            self._last_good = sample
        return self._sample

    def _changes(self, sample: Any) -> dict[str, Any]:
        """What the fault changes of a sample."""
        position, force = self._names[:2]
        place, felt = getattr(sample, position), getattr(sample, force)
        match self.fault.kind:
            case "dropout":
                return {name: getattr(self._last_good, name) for name in self._names}
            case "encoder-jump":
                return {position: _off(place, -JUMP if isinstance(place, tuple) else JUMP)}
            case "stuck":
                shown = getattr(self._last_good, force)
            case "nan":
                shown = (math.nan,) * 3 if isinstance(felt, tuple) else math.nan
            case "saturated":
                end = self.specification.sensor_range
                end = end if math.isfinite(end) else UNKNOWN_RANGE
                shown = (*felt[:2], end) if isinstance(felt, tuple) else end
            case "offset-step":
                shown = _off(felt, OFFSET)
            case _:
                shown = _off(felt, self._spike())
        return {force: shown}

    def _spike(self) -> float:
        """Size of a spike [N], 0 between two."""
        if self._exchanges < self._next_spike:
            return 0.0
        mean = SPIKE_INTERVAL / self.specification.sample_period
        self._next_spike = self._exchanges + 3 + round(self._random.exponential(mean))
        return float(self._random.uniform(*SPIKE_SIZES) * self._random.choice((-1.0, 1.0)))


def _off(value: Any, by: float) -> Any:
    """A value off by this; a vector along the tool."""
    return (*value[:2], value[2] + by) if isinstance(value, tuple) else value + by


class FaultySensor(_Faulty, WrappedRobot):
    """A robot whose sensors fail for a while; what it does is as before.

    Only what is reported changes: force, position, and with a dropout the acceleration. The robot's own drive has
    sensors of its own, and the simulator's exact values stay exact. Same seed, same commands: same samples.

    Args:
        robot: Any robot.
        fault: The fault and its times.
        seed: Seed of the spikes, not negative.

    Attributes:
        fault: As given.
        faulty: Whether the newest sample was changed.

    Raises:
        SettingError: A negative seed.
    """


class FaultySpatialSensor(_Faulty, WrappedSpatialRobot):
    """The same in three dimensions, with the same arguments.

    Whole vectors repeat or are no numbers; what is off or saturated is the axis along the tool, which hangs along the
    world's z: a force of compression is positive there, and a deeper position is lower.
    """

    _names = ("place", "force")
