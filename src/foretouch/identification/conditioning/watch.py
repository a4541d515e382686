"""Watches a force sensor and an encoder, and says at every sample whether they can be believed."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.layout import SensorState

LEAST_STEP = 0.3
"""Smaller steps of the offset than this [N] are not looked for."""

LEAST_SPIKE = 0.5
"""Smaller spikes than this [N] are not looked for."""

END_SHARE = 0.02
"""An end of the range begins so much before it, as a share of it."""

SENSOR_SENTENCES: Final[dict[SensorState, str]] = {
    SensorState.GOOD: "the sensors are as they should be",
    SensorState.NOT_FINITE: "force, position or time is no finite number: check the sensor's driver",
    SensorState.DROPOUT: "force and position repeat exactly: no new values come; check the cable and the bus",
    SensorState.STUCK: "the force stands although its noise should move it: the force sensor hangs",
    SensorState.SATURATED: "the force is at the end of the sensor's range: the true force may be larger",
    SensorState.OFFSET_STEP: "the force has stepped and nothing was touched: the sensor's zero is lost",
    SensorState.SPIKE: "single force samples are far off their neighbours: check the sensor's cable",
    SensorState.ENCODER_JUMP: "the position has jumped faster than the robot can move: the encoder is lost",
    SensorState.CONTACT_LOST: "the force has gone and the probe is as deep as before: the sensor has lost the contact",
    SensorState.FORCE_DISAGREES: "the drive pushes with another force than is felt: the force sensor is wrong",
}
"""Sentence of each state."""


class SensorWatch:
    r"""Finds faults of the sensors from what they show, sample by sample and causally.

    ==================  ==============================================================================  =============
    state               found when                                                                      at the latest
    ==================  ==============================================================================  =============
    `NOT_FINITE`        time, position or force is no finite number                                     at once
    `DROPOUT`           force and position repeat exactly for 20 ms                                     20 ms
    `STUCK`             the force repeats exactly for 0.1 s while the position changes                  0.1 s
    `SATURATED`         two samples within 2 % of an end of the range                                   2 samples
    `OFFSET_STEP`       the force changes and nothing is touched: see `fault_kernels`                   50 ms, still
    `SPIKE`             a sample is far off both neighbours, and no impact explains it                  2 samples
    `ENCODER_JUMP`      the position moves faster than the largest speed                                1 sample
    `CONTACT_LOST`      the force falls and no way out or slowing down explains it (`fault_kernels`)    3 samples
    `FORCE_DISAGREES`   the drive's own effort is another force: see `fault_kernels`                    0.1 s
    ==================  ==============================================================================  =============

    Repetitions count only once the force has shown noise, and from four times the longest repetition so far.
    A spike is larger than 0.5 N and than ten times the mean change between samples (20 ms), and twice what the samples
    around it differ by. A contact of one sample is none: the probe came fast enough for it (600 N s/m) and was slowed
    as that impulse slows a mass,

    .. math:: v \ge F / Z, \quad \Delta v \ge F T / (2 m)

    The first lasting fault stays until `reset`; the transient ones pass 0.5 s after the last finding. `update` never
    raises, costs the same at every sample, and holds a fixed number of numbers. A sample that is not later than the one
    before is left out.

    What it cannot see: an offset step below 0.3 N, and, of a robot that does not tell the effort of its drive, one in
    contact while the probe moves, drift, a wrong scale, and a sensor that is dead before it touches.

    Args:
        force_range: Smallest and largest force that the sensor can show [N]; infinite for an end that is not known, or
            at which the sensor may rest; None for both.
        largest_speed: No motion is faster [m/s], positive; an encoder's count is allowed on top.
        least_step: Smallest offset step that is looked for [N], positive.
        least_spike: Smallest spike that is looked for [N], positive.
        moving_mass: The most that an impact slows: carriage and tool [kg], positive.

    Attributes:
        state: The newest judgement.
        uncertain: Whether a force has fallen and it is not certain yet if that is a fault: it shows where the probe
            goes no deeper.
        effort: What the drive pushes inwards with, low-passed [N]; 0 where the robot does not tell.

    Raises:
        SettingError: A setting out of range.
    """

    __slots__ = ("_begin", "_look", "_numbers", "effort", "state", "uncertain")

    def __init__(
        self,
        force_range: tuple[float, float] | None = None,
        *,
        largest_speed: float = 1.0,
        least_step: float = LEAST_STEP,
        least_spike: float = LEAST_SPIKE,
        moving_mass: float = 1.0,
    ) -> None:
        low, high = (-math.inf, math.inf) if force_range is None else force_range
        if not low < high:
            raise SettingError("force_range", force_range, "the largest force must be above the smallest")
        require("largest_speed", largest_speed, above=0.0)
        require("least_step", least_step, above=0.0)
        require("least_spike", least_spike, above=0.0)
        require("moving_mass", moving_mass, above=0.0)
        # Imported here: it brings a compiler along, and imports the numbers above.
        from foretouch.identification.conditioning import watch_kernel as kernel
        from foretouch.identification.conditioning.fault_kernels import LEAST_STEP as LEAST_STEP_AT

        self._begin, self._look = kernel.begin, kernel.look
        near = [0.0 if math.isinf(end) else END_SHARE * abs(end) for end in (low, high)]
        self._numbers = np.zeros(kernel.SIZE)
        stays = (low + near[0], high - near[1], largest_speed, least_spike, moving_mass)
        self._numbers[kernel.LOWEST : kernel.STEP] = stays
        self._numbers[kernel.STEP + LEAST_STEP_AT] = least_step
        self.uncertain, self.effort = False, 0.0
        self.reset()

    def reset(self) -> None:
        """Believe the sensors again, and forget all samples: say this when they have been looked after."""
        self._begin(self._numbers)
        self.state, self.uncertain = SensorState.GOOD, False

    @property
    def sentence(self) -> str:
        """The newest judgement in words."""
        return SENSOR_SENTENCES[self.state]

    def update(
        self,
        time: float,
        position: float,
        force: float,
        tool_force: float = 0.0,
        *,
        zero: float = 0.0,
        effort: float = math.nan,
        slid: float = 0.0,
    ) -> SensorState:
        """Take one sample and say what the sensors are worth now.

        Args:
            time: [s], of a monotonic clock.
            position: [m].
            force: As the sensor gives it [N]: what is computed from it no longer repeats when the sensor does.
            tool_force: The part of it that the tool's weight and inertia make [N], where that is known: without it, a
                jerked tool can look like a fault.
            zero: What is left of it in free air [N], as far as that is known.
            effort: What the drive pushes inwards with, beyond weight and inertia [N]; NaN where it is not told.
            slid: By how much the probe has moved across the surface since the sample before [m].
        """
        found, self.uncertain, self.effort = self._look(
            self._numbers, time, position, force, tool_force, zero, effort, slid
        )
        if found != self.state:
            self.state = SensorState(found)
        return self.state
