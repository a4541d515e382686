"""A robot that keeps every rule, and ones that each break one."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace

from foretouch.robot import Robot, RobotSample, RobotSpecification

PERIOD, MASS = 1e-3, 0.2
SPECIFICATION = RobotSpecification(
    sample_period=PERIOD,
    force_limit=12.0,
    encoder_resolution=1e-6,
    encoder_noise=0.0,
    tool_mass=MASS,
    gravity=9.81,
    sensor_noise=0.0,
    accelerometer_noise=0.0,
    sensor_bandwidth=1000.0,
    workspace=(-0.02, 0.04),
    simulated=True,
)


class Rail(Robot):
    """A probe that is where it is told one tick later, over a spring of 800 N/m at 10 mm, at most 12 N deep."""

    def __init__(self) -> None:
        self.specification = SPECIFICATION
        self.places = [0.0, 0.0, 0.0]
        self.told = 0.0
        self.closed = False

    def force(self, position: float) -> float:
        return 800.0 * max(position - 0.010, 0.0)

    def read(self) -> RobotSample:
        before, middle, here = self.places
        acceleration = (here - 2.0 * middle + before) / PERIOD**2
        force = self.force(here) + self.specification.tool_force(acceleration) + 0.2
        return RobotSample(here, force, acceleration, self.force(here), here, self.told, False)

    def exchange(self, desired_position: float) -> RobotSample:
        if math.isfinite(desired_position):
            low, high = self.specification.workspace
            self.told = min(max(desired_position, low), high, 0.010 + 12.0 / 800.0)
        # No faster than 50 mm/s, so that a step is no impact.
        step = min(max(self.told - self.places[-1], -5e-5), 5e-5)
        self.places = [*self.places[1:], self.places[-1] + step]
        return self.read()

    def close(self) -> None:
        self.closed = True


class OtherPeriod(Rail):
    def __init__(self) -> None:
        super().__init__()
        self.specification = replace(SPECIFICATION, sample_period=2e-3)


class Grams(Rail):
    def __init__(self) -> None:
        super().__init__()
        self.specification = replace(SPECIFICATION, tool_mass=200.0)


class Millimetres(Rail):
    def read(self) -> RobotSample:
        sample = super().read()
        return sample._replace(position=1000.0 * sample.position + 5.0)


class Tuple(Rail):
    def read(self) -> RobotSample:
        return tuple(super().read())  # type: ignore[return-value]


class Drifting(Rail):
    def read(self) -> RobotSample:
        self.places[-1] += 1e-5
        return super().read()


class Literal(Rail):
    def exchange(self, desired_position: float) -> RobotSample:
        sample = super().exchange(desired_position)
        return sample if math.isfinite(desired_position) else sample._replace(position=math.nan)


class Homing(Rail):
    def exchange(self, desired_position: float) -> RobotSample:
        return super().exchange(desired_position if math.isfinite(desired_position) else -0.02)


class Slow(Rail):
    def exchange(self, desired_position: float) -> RobotSample:
        if math.isnan(desired_position):
            time.sleep(1.1e-3)
        return super().exchange(desired_position)


class Outwards(Rail):
    def read(self) -> RobotSample:
        sample = super().read()
        return sample._replace(position=-sample.position)


class AccelerationUp(Rail):
    def read(self) -> RobotSample:
        sample = super().read()
        return sample._replace(acceleration=-sample.acceleration)


class AccelerationInG(Rail):
    def read(self) -> RobotSample:
        sample = super().read()
        return sample._replace(acceleration=sample.acceleration / 9.81)


class Boundless(Rail):
    def exchange(self, desired_position: float) -> RobotSample:
        sample = super().exchange(desired_position)
        return sample._replace(commanded_position=desired_position) if math.isfinite(desired_position) else sample


class Tension(Rail):
    def force(self, position: float) -> float:
        return -super().force(position)


class TooStrong(Rail):
    def force(self, position: float) -> float:
        return 1.5 * super().force(position)


class ClosedOnce(Rail):
    def close(self) -> None:
        if self.closed:
            raise ValueError("closed already")
        super().close()


WRONG: dict[str, tuple[Callable[[], Robot], str]] = {
    "specification": (OtherPeriod, "sample_period = 0.002"),
    "specification / unit": (Grams, "tool_mass = 200"),
    "units": (Millimetres, "5 m"),
    "units / type": (Tuple, "tuple"),
    "reading moves nothing": (Drifting, "0.49 mm"),
    "no command, no motion": (Literal, "nan"),
    "no command, no motion / goes home": (Homing, "mm"),
    "exchange time": (Slow, "ms"),
    "sign of position": (Outwards, "-5 mm"),
    "sign of acceleration": (AccelerationUp, "-1 in phase"),
    "sign of acceleration / unit": (AccelerationInG, "0.102 in phase"),
    "workspace": (Boundless, "50 mm beyond"),
    "sign of force": (Tension, "-12 N"),
    "force limit": (TooStrong, "18 N"),
    "close": (ClosedOnce, "raises ValueError: closed already"),
}
