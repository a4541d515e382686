"""The interface of an estimator: samples in, a contact model and its uncertainty out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from enum import Enum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.identification.conditioning.conditioner import ContactSample, ContactSamples
from foretouch.models import NO_STATE, ContactModel, ContactState
from foretouch.quantities import brief_number, brief_text

FEWEST_UPDATES = 20  # No force is rendered from fewer samples; the paper's simulations settle at the 20th

LARGEST_BUFFER = 4096
"""Largest number of samples that the estimator holds; when it is reached, every second one is dropped and only every
second one of those to come is taken, so that the buffer always covers the whole recording evenly."""


class Status(Enum):
    """Result of an update; the value is the sentence for people."""

    LEARNT = "learnt from this sample"
    FREE_AIR = "newest sample was not in contact"
    UNUSABLE = "depth, velocity or force is not a number this estimator can take: sample left out"
    GATED = "depth or force below the contact gate: sample left out"
    WAITING = "between two samples that are learnt from"
    HELD = "held in one place: nothing to tell the law's parts apart"
    CHANGED = "the material changed suddenly: learning it anew"
    RESTARTED = "the covariance was no longer usable: the estimator began again"


def status_indices(statuses: Iterable[Status]) -> NDArray[np.int8]:
    """Index of each status in ``tuple(Status)``, shape (n,)."""
    index = {status: row for row, status in enumerate(Status)}
    return np.array([index[status] for status in statuses], np.int8)


class Estimator(ABC):
    """Identifies one contact law from conditioned samples.

    `update` is called at every sample, inside and outside contact, and never raises; `run` is `update` with many.

    Attributes:
        name: Name of the estimator, as on the command line.
        model_name: Name of the law it identifies, as on the command line.
        offline: Whether it is a fit of a whole recording: not usable in a control loop, but the lowest error that its
            law can reach.
        horizon: Delay of the predictions that it learns for [s], where that changes what it learns; else None.
        updates: Samples learnt from since the last reset.
        changes: Sudden changes of the material detected since then, 0 for estimators that do not detect any.
    """

    name: ClassVar[str]
    model_name: ClassVar[str]
    offline: ClassVar[bool] = False
    horizon: float | None = None
    updates: int = 0
    changes: int = 0

    def __repr__(self) -> str:
        """Name, law, updates, and parameters; an offline estimator is not asked for these, for it would fit."""
        known = {} if self.offline else self.parameters
        texts = {"name": self.name, "law": self.model_name, "updates": self.updates}
        return brief_text(
            type(self).__name__, [*texts.items(), *((name, brief_number(value)) for name, value in known.items())]
        )

    @abstractmethod
    def update(self, sample: ContactSample) -> Status:
        """Learn from one sample and return what was done."""

    def run(self, samples: ContactSamples) -> NDArray[np.int8]:
        """`update` with every sample of a recording, and the same numbers to the last bit; it continues from its state.

        Returns:
            Status of each sample, as an index into ``tuple(Status)``, shape (n,).
        """
        return status_indices(map(self.update, samples))

    @abstractmethod
    def reset(self) -> None:
        """Forget all samples."""

    def trust_surface(self, trusted: bool) -> None:  # noqa: B027 - most estimators take the surface as given
        """Set, before the first sample, whether the surface was given."""

    def move_surface(self, change: float) -> None:  # noqa: B027 - most keep no depths
        """Count depths from a surface that is deeper by `change` [m] from now on."""

    def finish(self) -> None:  # noqa: B027 - most have learnt all that there is
        """End the samples: `model` is to be that of all samples."""

    def expect_delay(self, delay: float) -> None:  # noqa: B027 - most learn alike for every delay
        """Set the delay with which the model is used for prediction [s], where it is known."""

    def move_offset(self, change: float) -> None:  # noqa: B027 - most keep no forces
        """Count forces from an offset that is larger by `change` [N] from now on."""

    @property
    def state(self) -> ContactState:
        """State of the material after the newest sample; empty for laws without memory."""
        return NO_STATE

    @property
    def surface_correction(self) -> float:
        """Height of the surface that the model counts from above the one that the samples count from [m]."""
        return 0.0

    @property
    def surface_error(self) -> float:
        """Standard error of the surface that the model counts from [m]; 0 where it is that of the samples."""
        return 0.0

    @property
    @abstractmethod
    def model(self) -> ContactModel | None:
        """The law as learnt so far, None while there is no usable one."""

    @property
    def has_model(self) -> bool:
        """Whether `model` is not None: asked in every tick, so cheaper where that makes an object each time."""
        return self.model is not None

    @property
    def parameters(self) -> dict[str, float | None]:
        """The law's numbers by name, and quantities derived from them; empty while there are none.

        A number is None while the samples so far do not determine it.
        """
        model = self.model
        return {} if model is None else dict(zip(model.parameter_names, model.parameters, strict=True))

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard error of each of `parameters`, None if undetermined; None where the estimator has none at all."""
        return None

    @property
    def standard_errors_with_surface(self) -> dict[str, float | None] | None:
        """The same, with the uncertainty of surface and force in free air; None where that is not known, as mostly."""
        return None

    def refit(self, samples: ContactSamples, covariance: NDArray[np.float64]) -> bool:
        """Fit a whole recording, conditioned in hindsight; False, as mostly, for what learns sample by sample.

        Args:
            samples: All samples.
            covariance: Of the surface [m] and the force in free air [N] that they count from, shape (2, 2).
        """
        return False


class StoringEstimator(Estimator):
    """Stores samples in a buffer that covers all of them evenly, and fits them when asked, not at every sample."""

    offline: ClassVar[bool] = True
    refit_share: ClassVar[float]
    """Fraction of new samples after which the estimator fits again."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self.updates = 0
        self._stride = 1
        self._rows: list[tuple[float, ...]] = []
        self._next_fit = FEWEST_UPDATES

    def _store(self, row: tuple[float, ...]) -> None:
        if self.updates % self._stride == 0:
            self._rows.append(row)
            if len(self._rows) >= LARGEST_BUFFER:
                self._rows = self._rows[::2]
                self._stride *= 2
        self.updates += 1

    def finish(self) -> None:
        """Fit to the newest samples too."""
        self._next_fit = max(self.updates, FEWEST_UPDATES)

    def _is_fit_due(self) -> bool:
        """Whether to fit now; the caller does."""
        due = self.updates >= self._next_fit
        if due:
            self._next_fit = self.updates + max(1, round(self.refit_share * self.updates))
        return due
