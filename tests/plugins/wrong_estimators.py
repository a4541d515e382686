"""Estimators that each break one rule that the example of a plug-in keeps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from foretouch_plugin_example.windowed import Windowed

from foretouch.identification import ContactSample, Estimator
from foretouch.identification.estimator import Status
from foretouch.models import ContactModel, KelvinVoigt


class WrongName(Windowed):
    name: ClassVar[str] = "other"


class Knowing(Windowed):
    @property
    def model(self) -> KelvinVoigt | None:
        return super().model or KelvinVoigt(600.0, 2.0)


class InAir(Windowed):
    def update(self, sample: ContactSample) -> Status:
        if not sample.in_contact:
            self.updates += 1
        return super().update(sample)


class TwiceAsStiff(Windowed):
    @property
    def model(self) -> KelvinVoigt | None:
        result = super().model
        return result and KelvinVoigt(2.0 * result.stiffness, result.damping)


@dataclass(frozen=True)
class Flat(ContactModel):
    """Feels the same at every depth, and outside."""

    law: ClassVar[str] = "kelvin-voigt"
    parameter_names: ClassVar[tuple[str, ...]] = ("stiffness", "damping")
    stiffness: float
    damping: float

    def advance(
        self, state: object, depth: float, velocity: float, sample_period: float
    ) -> tuple[object, float, float]:
        return state, 3.0, math.nan


class Unfeeling(Windowed):
    @property
    def model(self) -> object:
        result = super().model
        return result and Flat(result.stiffness, result.damping)


class Renamed(KelvinVoigt):
    """Says the name of a law of which it is not."""

    law: ClassVar[str] = "hunt-crossley"


class WrongLaw(Windowed):
    @property
    def model(self) -> KelvinVoigt | None:
        result = super().model
        return result and Renamed(result.stiffness, result.damping)


class BadErrors(Windowed):
    @property
    def standard_errors(self) -> dict[str, float | None]:  # type: ignore[override]
        return dict.fromkeys(self.parameters, -1.0)


class OtherErrors(Windowed):
    @property
    def standard_errors(self) -> dict[str, float | None]:  # type: ignore[override]
        return {"k": 1.0}


class Skewed(Windowed):
    unscaled_covariance = np.array([[1.0, 0.5], [0.4, 1.0]])


class Endless(Windowed):
    covariance = np.array([[math.inf, 0.0], [0.0, 1.0]])


class Raising(Windowed):
    def update(self, sample: ContactSample) -> Status:
        if sample.in_contact:
            math.sqrt(sample.depth)  # of a negative depth
        return super().update(sample)


class Poisoned(Windowed):
    """Takes what is no number."""

    def update(self, sample: ContactSample) -> Status:
        self.poison = getattr(self, "poison", 0.0) + sample.force
        return super().update(sample)

    def reset(self) -> None:
        self.poison = 0.0
        super().reset()

    @property
    def model(self) -> KelvinVoigt | None:
        result = super().model
        if not math.isfinite(self.poison):
            broken = KelvinVoigt(600.0, 2.0)
            object.__setattr__(broken, "stiffness", math.nan)
            return broken
        return result


class Remembering(Windowed):
    def reset(self) -> None:
        if not self.updates:
            super().reset()


class Slow(Windowed):
    def update(self, sample: ContactSample) -> Status:
        if sample.time > 1.9:  # the longer checks are not to take long
            time.sleep(1.5e-4)
        return super().update(sample)


WRONG: dict[str, tuple[Callable[[], Estimator], str]] = {
    "name": (WrongName, "name = 'other'"),
    "knows nothing at first": (Knowing, "model = KelvinVoigt"),
    "free air teaches nothing": (InAir, "200 updates"),
    "learns its own law": (TwiceAsStiff, "%"),
    "its model predicts": (Unfeeling, "3 N at 1 mm, 3 N at 10 mm"),
    "its model crosses the network": (WrongLaw, ""),
    "standard errors": (BadErrors, "not stiffness"),
    "standard errors / names": (OtherErrors, "of k"),
    "covariance": (Skewed, "symmetric to 0.1"),
    "covariance / endless": (Endless, "is not finite"),
    "nonsense does no harm": (Raising, "raises ValueError"),
    "nonsense does no harm / numbers": (Poisoned, "nan"),
    "reset forgets": (Remembering, "something known"),
    "update time": (Slow, "ms"),
}
