"""Threshold switching on one of the presses of Figs. 7 and 8."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import SwitchingOptions, ThresholdSwitching
from foretouch.models import ContactModel, KelvinVoigt
from foretouch.reproduction.presses import Press, forces_of

__all__ = ["errors_of_threshold"]

Array = NDArray[np.float64]


def errors_of_threshold(pressed: Press, options: SwitchingOptions | None = None) -> tuple[Array, NDArray[np.bool_]]:
    """Of threshold switching at each sample: error of the force [N], NaN before there is a law; whether Kelvin-Voigt.

    The law is the one learnt from that sample too.
    """
    estimator = ThresholdSwitching(options)
    models: list[ContactModel | None] = []
    for sample in pressed.samples:
        estimator.update(sample)
        models.append(estimator.model)
    force = forces_of(tuple(models), pressed.depth, pressed.velocity)
    return np.abs(force - pressed.true_force), np.array([isinstance(model, KelvinVoigt) for model in models])
