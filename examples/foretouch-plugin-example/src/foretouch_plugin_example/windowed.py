"""An estimator that fits a Kelvin-Voigt law to the last samples."""

from __future__ import annotations

import math
from typing import ClassVar

import numpy as np

from foretouch.identification import ContactSample, Estimator
from foretouch.identification.estimator import Status
from foretouch.models import KelvinVoigt

WINDOW = 1.0
"""Samples are forgotten over about so long [s]."""
SAMPLE_PERIOD = 1e-3


class Windowed(Estimator):
    r"""Least squares with a fading window.

    .. math:: F = k x + b \dot x, \quad A \leftarrow \mu A + \phi \phi^T, \quad y \leftarrow \mu y + \phi F

    with :math:`\phi = (x, \dot x)` and :math:`\mu = 1 - T / 1\,\mathrm{s}`; solved where the model is asked for.
    """

    name: ClassVar[str] = "windowed"
    model_name: ClassVar[str] = "kelvin-voigt"

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._xx = self._xv = self._vv = self._xf = self._vf = 0.0
        self.updates = 0

    def update(self, sample: ContactSample) -> Status:
        """Learn from one sample; never raises."""
        if not sample.in_contact:
            return Status.FREE_AIR
        x, v, f = sample.depth, sample.velocity, sample.force
        if not (0.0 < x < 1.0 and abs(v) < 10.0 and 0.0 < f < 1e4):
            return Status.UNUSABLE  # NaN is neither
        kept = 1.0 - SAMPLE_PERIOD / WINDOW
        self._xx, self._xv, self._vv = kept * self._xx + x * x, kept * self._xv + x * v, kept * self._vv + v * v
        self._xf, self._vf = kept * self._xf + x * f, kept * self._vf + v * f
        self.updates += 1
        return Status.LEARNT

    @property
    def model(self) -> KelvinVoigt | None:
        """The law as it is known now."""
        if self.updates < 20 or not self._xx > 0.0:
            return None
        determinant = self._xx * self._vv - self._xv**2
        if determinant > 1e-9 * self._xx * self._vv:
            stiffness = (self._vv * self._xf - self._xv * self._vf) / determinant
            damping = (self._xx * self._vf - self._xv * self._xf) / determinant
        else:  # held in one place: nothing tells the two apart
            stiffness, damping = self._xf / self._xx, 0.0
        usable = math.isfinite(stiffness) and math.isfinite(damping) and stiffness > 0.0
        return KelvinVoigt(float(np.clip(stiffness, 1.0, 1e6)), max(damping, 0.0)) if usable else None

    @property
    def standard_errors(self) -> None:
        """None: it does not say."""
        return None
