"""The package's own learner of real materials: a contact map, with the paper's law as first guess and rival."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Kernel
from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import ContactSample, ContactSamples
from foretouch.identification.contact_map.kernel import (
    FREE_AIR,
    GONE,
    LEARNT,
    LEARNT_IN_AIR,
    OTHER,
    RESTARTED,
    UNUSABLE,
    WAITING,
    move_offset,
    move_surface,
    reset,
    run,
    take,
)
from foretouch.identification.contact_map.regression import begin_regression
from foretouch.identification.contact_map.remembered import from_the_surface
from foretouch.identification.contact_map.scores import LONGEST_HORIZON
from foretouch.identification.contact_map.state import HELD, Bank
from foretouch.identification.estimator import Estimator, Status, status_indices
from foretouch.identification.exact.belief import FEWEST_UPDATES
from foretouch.identification.exact.recursive import ExactContinuousSwitching
from foretouch.models import ContactMapModel, ContactModel, ContactState

EXPERT_NAMES = ("law", "coarse", "fine")
"""Names of the experts, in the order of their weights."""


Array = NDArray[np.float64]

_take = Kernel(take, "(Bank[::1], f8, f8, f8, f8, b1)")
_STATUS = {
    FREE_AIR: Status.FREE_AIR,
    UNUSABLE: Status.UNUSABLE,
    WAITING: Status.WAITING,
    LEARNT: Status.LEARNT,
    LEARNT_IN_AIR: Status.FREE_AIR,
    OTHER: Status.CHANGED,
    GONE: Status.CHANGED,
    RESTARTED: Status.RESTARTED,
}
_STATUSES = tuple(_STATUS[code] for code in range(len(_STATUS)))
_INDICES = status_indices(_STATUSES)


class ContactMap(Estimator):
    r"""Learns a `foretouch.models.ContactMapModel`: two maps and the paper's law, scored on late predictions.

    **Maps.** Their weights w are learnt by recursive least squares, 250 times a second, in contact and out of it,

    .. math::
        K = \frac{P h}{h^T P h + \sigma^2}, \quad w \leftarrow w + K (F - h^T w), \quad P \leftarrow P - K h^T P

    where h holds the splines of the position and of the features. The prior is a cubic smoothing spline for the elastic
    part, that is doubly integrated white noise, which goes on straight where nothing was learnt, and a smooth Gaussian
    process for each feature. Only the ratio of prior and noise matters, so that nothing depends on the unit of force;
    and depth counts from the first contact, so that a better surface later moves nothing. There is no forgetting
    towards the prior, but for a covariance that goes back to it in 20 minutes of contact.

    **Law.** The exact law (4) by `ExactContinuousSwitching`: a first guess from eight samples, right within 0.1 s
    after a change, and the best where the material is of that kind.

    **Place.** The fine map reaches 0.6 mm out and 1.2 mm in. Where the coarse map is wrong in contact by 10 % of the
    peak beyond that, the fine one begins again there, with the force of the coarse one. What the coarse one misses by
    as much, and the fine one by less than half of that, the fine one learns alone where it has most of the weight and
    reaches to the greatest depth: a coarse map would smear a hard layer over what is soft above it.

    **Weights.** Every 20 ms a snapshot is kept. The forces of the law, and of both maps together, from that of a delay
    ago are compared with the force measured since, where the position had been visited by then. With e_i their RMS
    errors over about the last second of contact, and c_i = 1.2 for the law,

    .. math:: \pi_i \propto (c_i e_i)^{-8}

    The fine map's part of the maps follows the same rule, with 1.2 for the fine one, but with the errors of both before
    they learn a sample: what the coarse map cannot resolve it learns wrong at once. It is 0 while those of the coarse
    one are below 2 % of the peak. Else the law loses the same part and counts no more than the maps: it is at the mercy
    of the surface there. Before anything is scored, the law counts as wrong as it was before it learnt the newest
    samples, and the maps by 20 % of the peak, or 10 % after a change.

    **Touch.** Where a twentieth to a tenth of the peak was felt outermost, and the way over which the force grew to
    four times that, are part of the model: further out the force falls to zero. Inwards without a force, it moves in.

    **Pull.** A force below zero after a contact is a pull once it has let go: where it falls, in two samples in a row
    and within 5 mm of where contact was left, below a tenth of the peak, and is back to a tenth of that 0.3 mm
    further out than it was last half of it. Friction lasts until the probe turns, and a wrong zero stays.
    The largest pull, how far out it was held, and where a probe that comes nearer is caught, are part of the model;
    what was felt before is learnt already. Where nothing sticks yet, the maps do not learn that there is no force.

    **Standard deviation.** That of a late prediction F, with the peak force so far,

    .. math:: \sigma = \sqrt{\pi / 2}\; \delta\, \sqrt{F^2 + (0.1\, F_{peak})^2}

    where :math:`\delta` is the mean of the absolute late errors over about the last second of contact, each relative to
    that root, with 20 % for the first tenth of a second. A Gaussian error's mean is that much smaller than its standard
    deviation. A mean of squares would follow the few large errors at the beginning and the end of a press.

    **Change.** Where predictions of 0.3 s before, or of a longer delay, are wrong at visited positions by three
    standard deviations, and by 10 % of the peak, for 0.1 s of contact without a pause, the material has changed: the
    maps begin anew around those predictions, times the factor by which the forces F since then have changed,

    .. math:: w \leftarrow \frac{\sum F \hat F}{\sum \hat F^2}\, w, \quad P \leftarrow Q

    with the prior Q. So what is as it was, or in proportion to it, has not to be learnt again, and all of it can be.
    Where no force at all is measured instead, the material has gone, and the surface is looked for again. The present
    errors of the maps would not show it: what the material is now like they learn within some samples.

    Args:
        horizon: Delay of the predictions that the experts are scored on [s], 0 to 2.
        experts: Experts in use, of ``law``, ``coarse`` and ``fine``.

    Attributes:
        changes: Number of sudden changes detected since the last reset.
        states: State of the compiled part, one record.

    Raises:
        SettingError: The horizon is out of range, or there are no or unknown experts.

    References:
        Wahba (1990), Spline Models for Observational Data; Rasmussen and Williams (2006), Gaussian Processes for
        Machine Learning, section 6.3; Jacobs, Jordan, Nowlan and Hinton (1991), Adaptive mixtures of local experts,
        Neural Computation 3(1), for weighted experts. The paper's law: its equation (4).
    """

    name: ClassVar[str] = "bank"
    model_name: ClassVar[str] = "contact-map"

    def __init__(self, horizon: float = LONGEST_HORIZON, experts: Sequence[str] = EXPERT_NAMES) -> None:
        require("horizon", horizon, at_least=0.0, at_most=2.0)
        if not experts or not set(experts) <= set(EXPERT_NAMES):
            raise SettingError("experts", ", ".join(experts), f"must be some of {', '.join(EXPERT_NAMES)}")
        self._law = ExactContinuousSwitching()
        self.states = Bank.new(law=self._law._filters, absent=[name not in experts for name in EXPERT_NAMES])
        self._state = self.states[0]
        notes, self._changes = self.states["notes"][0], self.states["changes"]  # views are quicker than names
        self._updates, self._begun = notes["updates"], notes["begun"]
        self._map, self._memory = self.states["map"][0], self.states["memory"][0]
        self._law.place_in(self._state.law)
        for kind, name in enumerate(EXPERT_NAMES[1:]):
            begin_regression(self._state[name], kind)
        self.horizon = horizon
        self.reset()
        self._take = _take.entry
        move_surface(self.states, 0.0)
        move_offset(self.states, 0.0)

    @property
    def horizon(self) -> float:
        """Delay of the predictions that the experts are scored on [s]."""
        return float(self._state.horizon)

    @horizon.setter
    def horizon(self, horizon: float) -> None:
        self._state.horizon = horizon

    def reset(self) -> None:
        """Forget all samples."""
        self._state.changes = 0
        reset(self.states)
        self._model: ContactMapModel | None = None
        self.updates = 0
        self.changes = 0

    def update(self, sample: ContactSample) -> Status:
        """See `Estimator.update`."""
        time, depth, velocity, force, in_contact = sample
        code = self._take(self.states, time, depth, velocity, force, in_contact)
        if code >= LEARNT:
            self._read_counts()
        return _STATUSES[code]

    def _read_counts(self) -> None:
        """Take over the counts of the compiled part; a model made before is out of date."""
        self._model = None
        self.updates, self.changes = self._updates.item(), self._changes.item()

    def run(self, samples: ContactSamples) -> NDArray[np.int8]:
        """See `Estimator.run`; one compiled loop."""
        codes = np.empty(len(samples), np.int8)
        run(self.states, *samples.columns, codes)
        self._read_counts()
        return _INDICES[codes]

    def go_back(self, earlier: NDArray[np.void]) -> None:
        """Forget what was learnt since a copy of `states` was taken."""
        self.states[:] = earlier
        self._read_counts()

    def taken(self, code: int, news: bool) -> Status:
        """Take over what `foretouch.identification.contact_map.kernel.learn_raw` did."""
        if news or code >= LEARNT:
            self._read_counts()
        return _STATUSES[code]

    def expect_delay(self, delay: float) -> None:
        """See `Estimator.expect_delay`: experts are scored on predictions of that delay, up to 0.3 s."""
        if math.isfinite(delay):
            self.horizon = min(max(delay, 0.0), LONGEST_HORIZON)

    def trust_surface(self, trusted: bool) -> None:
        """See `Estimator.trust_surface`."""
        self._law.trust_surface(trusted)

    def move_surface(self, change: float) -> None:
        """See `Estimator.move_surface`: the map stays where it is."""
        move_surface(self.states, change)
        self._model = None

    def move_offset(self, change: float) -> None:
        """See `Estimator.move_offset`: the map keeps the raw forces."""
        move_offset(self.states, change)
        self._model = None

    @property
    def model(self) -> ContactModel | None:
        """See `Estimator.model`."""
        if self.updates - self._begun.item() < FEWEST_UPDATES:
            return None
        if self._model is None:
            self._model = ContactMapModel.of(self._published)
        return self._model

    @property
    def _published(self) -> NDArray[np.void]:
        """The map that is rendered, an array of one."""
        shown: NDArray[np.void] = self._state.remembered.shown
        return shown if self._state.coarse.traced > 0 else self._map

    def recall(self, model: ContactMapModel) -> None:
        """Begin with a map of the same material from before (`remembered`); all samples are forgotten.

        It is placed where the force of the first tenth of a second in contact is its own, and dropped for good where it
        is nowhere: their errors are, as an RMS, more than 10 % of the peak. From then on it is the prior mean of the
        coarse weights. It is dropped again as soon as late predictions are worse with it than without (Page's
        cumulative sum, by errors half as large as those that show a change, for as long), and what is left is what
        would have been learnt without it.
        """
        remembered = self._state.remembered
        remembered.given, remembered.state = model.record, HELD
        self.reset()

    @property
    def remembered(self) -> ContactMapModel | None:
        """The map to begin with next time, its positions counting from the surface; None before there is a model."""
        return None if self.model is None else ContactMapModel.of(from_the_surface(self._published))

    @property
    def contact_time(self) -> float:
        """Time in contact since the beginning or the last change [s]."""
        return float(self._state.notes[0].contact)

    @property
    def recalls(self) -> str:
        """Whether a map from before is ``held``, was ``dropped``, or ``none`` was given."""
        return ("none", "held", "dropped")[int(self._state.remembered.state)]

    @property
    def state(self) -> ContactState:
        """See `Estimator.state`."""
        return tuple(self._memory.tolist())

    @property
    def parameters(self) -> dict[str, float | None]:
        """The law's numbers from its own estimator at the newest sample; a model's are those of its last update."""
        return self._law.parameters

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard errors of the law's numbers."""
        return self._law.standard_errors
