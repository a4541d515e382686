"""A simulated six-axis force and torque sensor at an arm's wrist."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, kernel
from foretouch.errors import SettingError
from foretouch.errors.checks import require, require_fields

Array = NDArray[np.float64]
States = NDArray[np.void]

Numbers6 = Annotated[Array, float, 6]

BLOCK = 1024  # Number of samples whose noise is drawn at once


class Wrist(Record):
    """State of a `WristSensor`, with its constants. Six numbers are a force [N] and a torque [N m]."""

    felt: Numbers6  # load behind the low-pass
    low_pass: float  # fraction that the low-pass moves in a step
    cross_talk: Annotated[Array, float, 36]  # what an axis shows of each, row by row
    bias: Numbers6
    warm_up: Numbers6  # what is added to the bias in the end
    cold: float = 1.0  # fraction of the warm-up that is still to come
    cooling: float  # factor of that in a sample
    noise: Numbers6  # standard deviation
    largest: Numbers6  # what it shows at most, either way


@kernel("void(Wrist[::1], f8[::1])")
def feel(wrists: States, interaction: Array) -> None:
    """Move the low-pass behind a physics step.

    Args:
        wrists: Written.
        interaction: What the wrist does to the tool, as MuJoCo's sensors show it: the negative load.
    """
    wrist = wrists[0]
    for axis in range(6):
        wrist.felt[axis] -= wrist.low_pass * (interaction[axis] + wrist.felt[axis])


@kernel("void(Wrist[::1], f8[:, ::1], i8, f8[::1])")
def show(wrists: States, draws: Array, row: int, shown: Array) -> None:
    """Write what the sensor shows at the end of a sample, and let it warm up by one.

    Args:
        wrists: Written.
        draws: Normal numbers, six in a row.
        row: The row that is used.
        shown: Written.
    """
    wrist = wrists[0]
    wrist.cold *= wrist.cooling
    for axis in range(6):
        value = wrist.bias[axis] + (1.0 - wrist.cold) * wrist.warm_up[axis] + wrist.noise[axis] * draws[row, axis]
        for other in range(6):
            value += wrist.cross_talk[6 * axis + other] * wrist.felt[other]
        shown[axis] = min(max(value, -wrist.largest[axis]), wrist.largest[axis])


@dataclass(frozen=True, slots=True)
class WristSensorKind:
    """A kind of sensor. The figures given are chosen for the class of small strain-gauge sensors that arms carry.

    Pairs are of force [N] and torque [N m].

    Attributes:
        bandwidth: Cut-off of its first-order low-pass [Hz]: 1 kHz of samples, and a filter that lets a hand's motion
            and an arm's first resonance through.
        largest: What it shows at most along x, y, z and about them, either way: stiff enough for the arm's own 15 to 30
            N at a lever of 0.2 m, with a factor for impacts.
        noise: Standard deviation of each sample: about half the step of what such sensors resolve.
        bias: Largest offset of any axis, which no two pieces share: 1 or 2 percent of the range, mostly from the
            screws.
        cross_talk: Standard deviation of every entry of the matrix beside 1, as a fraction of the ranges: within 1
            percent of full scale from a single axis.
        warm_up: Largest drift of any axis from cold to warm: strain gauges see their own heat and the arm's.
        warm_up_time: In which 63 percent of it is over [s].

    Raises:
        SettingError: A number that is not finite or below what it can be.
    """

    bandwidth: float = 150.0
    largest: tuple[float, ...] = (145.0, 145.0, 290.0, 5.0, 5.0, 5.0)
    noise: tuple[float, float] = (0.03, 0.0008)
    bias: tuple[float, float] = (2.0, 0.08)
    cross_talk: float = 0.004
    warm_up: tuple[float, float] = (0.4, 0.01)
    warm_up_time: float = 600.0

    def __post_init__(self) -> None:
        require_fields(self, "bandwidth", "warm_up_time", above=0.0)
        require("cross_talk", self.cross_talk, at_least=0.0)
        for name in ("noise", "bias", "warm_up"):
            for value in getattr(self, name):
                require(name, value, at_least=0.0)
        if len(self.largest) != 6 or not min(self.largest) > 0.0:
            raise SettingError("largest", self.largest, "must be six numbers above 0")


class WristSensor:
    r"""What a six-axis sensor shows of the load w on it, force and torque about its origin in its own frame.

    .. math::
        \dot x = 2 \pi f (w - x), \qquad
        y = \mathrm{sat}\big(C x + b + (1 - e^{-t / \tau}) d + n\big)

    x is behind the low-pass, C the cross-talk, b the bias, d the drift of warming up, n white noise, and sat limits
    each axis to its range. The load is what the tool does to the sensor, as in `foretouch.quantities.ToolLoad`: the
    negative of what MuJoCo's sensors of force and torque show at a site of the tool.

    Neither call allocates. Same piece, same seed, same loads: the same samples, bit for bit.

    Args:
        step: Time between two calls of `feel` [s].
        sample_period: Time between two calls of `read` [s].
        seed: Of the noise, not negative.
        piece: Which one of its kind: bias, cross-talk and drift belong to it, and stay in another session.
        kind: Its figures.

    Attributes:
        kind: As given.
        bias: Its bias when cold, shape (6,).
        cross_talk: C, shape (6, 6).
        drift: d, shape (6,).

    Raises:
        SettingError: A time that is not positive, or a negative seed or piece.
    """

    def __init__(
        self,
        step: float,
        sample_period: float = 1e-3,
        *,
        seed: int,
        piece: int = 0,
        kind: WristSensorKind | None = None,
    ) -> None:
        require("step", step, above=0.0)
        require("sample_period", sample_period, above=0.0)
        require("seed", seed, at_least=0)
        require("piece", piece, at_least=0)
        self.kind = kind = kind or WristSensorKind()
        made, largest = np.random.default_rng(piece), np.asarray(kind.largest)
        self.bias = np.repeat(kind.bias, 3) * made.uniform(-1.0, 1.0, 6)
        self.drift = np.repeat(kind.warm_up, 3) * made.uniform(-1.0, 1.0, 6)
        # An axis at the end of its range disturbs another by a fraction of that one's range.
        self.cross_talk = np.eye(6) + kind.cross_talk * made.standard_normal((6, 6)) * largest[:, None] / largest
        self._states = Wrist.new(
            low_pass=-math.expm1(-2.0 * math.pi * kind.bandwidth * step),
            cross_talk=self.cross_talk.ravel(),
            bias=self.bias,
            warm_up=self.drift,
            cooling=math.exp(-sample_period / kind.warm_up_time),
            noise=np.repeat(kind.noise, 3),
            largest=largest,
        )
        self._random, self._draws, self._row = np.random.default_rng(seed), np.empty((BLOCK, 6)), BLOCK
        self._shown = np.zeros(6)
        self._feel, self._show = feel.entry, show.entry

    def settle(self, interaction: Array | Sequence[float]) -> None:
        """Begin as if a load had been there for long; the temperature stays.

        Args:
            interaction: As in `feel`.
        """
        self._states["felt"][0] = -np.asarray(interaction, np.float64)

    def feel(self, interaction: Array) -> None:
        """Take what acts during a physics step.

        Args:
            interaction: What the wrist does to the tool, force [N] and torque [N m] about the sensor's origin in its
                frame, as MuJoCo's sensors at a site of the tool show it; contiguous, shape (6,).
        """
        self._feel(self._states, interaction)

    def read(self) -> Array:
        """Show force [N] and torque [N m] at the end of a sample, shape (6,); the next call writes over it."""
        if self._row == BLOCK:
            self._random.standard_normal(out=self._draws)
            self._row = 0
        self._show(self._states, self._draws, self._row, self._shown)
        self._row += 1
        return self._shown
