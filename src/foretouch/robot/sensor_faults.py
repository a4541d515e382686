"""Sensors that fail, on purpose and on time: any robot with one fault of its force sensor or encoder."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from foretouch.errors import SettingError, UnknownNameError
from foretouch.errors.checks import require
from foretouch.quantities import shortest
from foretouch.robot.robot import Robot, RobotSample, WrappedRobot

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


class FaultySensor(WrappedRobot):
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

    def __init__(self, robot: Robot, fault: SensorFault, *, seed: int = 0) -> None:
        require("seed", seed, at_least=0)
        super().__init__(robot)
        self.fault, self.faulty = fault, False
        self._random, self._next_spike = np.random.default_rng(seed), 0
        self._sample = self._last_good = robot.read()

    def read(self) -> RobotSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._sample

    def exchange(self, desired_position: float) -> RobotSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `Robot`."""
        sample = self.robot.exchange(desired_position)
        self._exchanges += 1
        time = self._exchanges * self.specification.sample_period
        inside = self.fault.begin <= time < self.fault.end
        self._sample = self._changed(sample) if inside else sample
        self.faulty = self._sample is not sample
        if not inside:
            self._last_good = sample
        return self._sample

    def _changed(self, sample: RobotSample) -> RobotSample:
        """A sample as the fault shows it."""
        last, largest = self._last_good, self.specification.sensor_range
        dropped = {"position": last.position, "sensor_force": last.sensor_force, "acceleration": last.acceleration}
        changes: dict[str, dict[str, Any]] = {
            "nan": {"sensor_force": math.nan},
            "dropout": dropped,
            "stuck": {"sensor_force": last.sensor_force},
            "saturated": {"sensor_force": largest if math.isfinite(largest) else UNKNOWN_RANGE},
            "offset-step": {"sensor_force": sample.sensor_force + OFFSET},
            "encoder-jump": {"position": sample.position + JUMP},
        }
        kind = self.fault.kind
        return sample._replace(**changes[kind]) if kind in changes else self._spiked(sample)

    def _spiked(self, sample: RobotSample) -> RobotSample:
        if self._exchanges < self._next_spike:
            return sample
        mean = SPIKE_INTERVAL / self.specification.sample_period
        self._next_spike = self._exchanges + 3 + round(self._random.exponential(mean))
        size = self._random.uniform(*SPIKE_SIZES) * self._random.choice((-1.0, 1.0))
        return sample._replace(sensor_force=sample.sensor_force + float(size))
