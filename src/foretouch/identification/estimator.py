"""What an estimator is: samples in, a contact model and its doubt out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from enum import Enum
from typing import ClassVar

from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.models import NO_STATE, ContactModel, ContactState
from foretouch.quantities import brief_number, brief_text


class Status(Enum):
    """What an update did; the value is the sentence for people."""

    LEARNT = "learnt from this sample"
    FREE_AIR = "newest sample was not in contact"
    UNUSABLE = "depth, velocity or force is not a number this estimator can take: sample left out"
    GATED = "depth or force below the contact gate: sample left out"
    WAITING = "between two samples that are learnt from"
    HELD = "held in one place: nothing to tell the law's parts apart"
    CHANGED = "the material changed suddenly: learning it anew"
    RESTARTED = "the covariance was no longer usable: the estimator began again"


class Estimator(ABC):
    """Identifies one contact law from conditioned samples.

    `update` is called at every sample, inside and outside contact, and never raises.

    Attributes:
        name: Of the estimator, as on the command line.
        model_name: Of the law it identifies, as on the command line.
        offline: Whether it is a fit of a whole recording: no rival in a control loop, but the floor of what its law
            can reach.
        horizon: How late a prediction is that it learns for [s], where that changes what it learns; else None.
        updates: Samples learnt from since the last reset.
        changes: Sudden changes of the material found since then, 0 for those that look for none.
    """

    name: ClassVar[str]
    model_name: ClassVar[str]
    offline: ClassVar[bool] = False
    horizon: float | None = None
    updates: int
    changes: int = 0

    def __repr__(self) -> str:
        """Name, law, updates, and what is known; what fits whole recordings is not asked, for it would fit one."""
        known = {} if self.offline else self.parameters
        told = {"name": self.name, "law": self.model_name, "updates": getattr(self, "updates", 0)}
        return brief_text(
            type(self).__name__, [*told.items(), *((name, brief_number(value)) for name, value in known.items())]
        )

    @abstractmethod
    def update(self, sample: ContactSample) -> Status:
        """Learn from one sample and say what was done."""

    @abstractmethod
    def reset(self) -> None:
        """Forget all samples."""

    def trust_surface(self, trusted: bool) -> None:  # noqa: B027 - most estimators take the surface as given
        """Told by the learner, before the first sample, whether somebody has stated where the surface is."""

    def move_surface(self, change: float) -> None:  # noqa: B027 - who keeps no depths has none to move
        """Told by the learner that depths count from a surface that is deeper by `change` [m] from now on."""

    def finish(self) -> None:  # noqa: B027 - most have learnt all that there is
        """Told that no more samples come: `model` is to be that of all samples."""

    def expect_delay(self, delay: float) -> None:  # noqa: B027 - most learn alike for every delay
        """Told by those who predict how late the model is used [s], where they know."""

    def move_offset(self, change: float) -> None:  # noqa: B027 - who keeps no forces has none to move
        """Told by the learner that forces count from an offset that is larger by `change` [N] from now on."""

    @property
    def state(self) -> ContactState:
        """What the material remembers after the newest sample; empty for laws without memory."""
        return NO_STATE

    @property
    def surface_correction(self) -> float:
        """Height of the surface that the model counts from above the one that the samples count from [m]."""
        return 0.0

    @property
    @abstractmethod
    def model(self) -> ContactModel | None:
        """The law as it is known now, None while nothing usable is known."""

    @property
    def parameters(self) -> dict[str, float | None]:
        """The law's numbers by name, and what follows from them; empty while nothing is known.

        None: undetermined by the samples so far.
        """
        model = self.model
        return {} if model is None else dict(zip(model.parameter_names, model.parameters, strict=True))

    @property
    @abstractmethod
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard error of each of `parameters`, None of one that is undetermined; None where it has none to give."""

    def surface_shifts(self, surface_error: float) -> dict[str, float] | None:
        """How far each of `parameters` moves where the surface lies further out or in by this [m], the larger of both.

        None where the estimator cannot tell, as most.
        """
        return None
