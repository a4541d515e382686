"""Our own learner of real materials: a contact map, with the paper's law as first guess and rival."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np

from foretouch.errors import SettingError
from foretouch.identification.conditioning import ContactSample
from foretouch.identification.contact_map_learning import (
    ABSENT,
    ALARM_FROM,
    CHANGED,
    CONTACT,
    FAILED,
    FIRST_DOUBT,
    LEARNT_AT,
    MOMENTS,
    NOTES,
    PATIENCE,
    PERIOD,
    RING,
    SPREAD,
    TOO_SOON,
    learn,
    prior,
    restart,
)
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.exact_recursive import ExactRecursive, ExactRecursiveOptions
from foretouch.models import ContactMap, ContactModel, ContactState, ContinuousSwitching
from foretouch.models.checks import require
from foretouch.models.contact_map_kernel import (
    DOUBT,
    DOUBTS,
    FELT,
    LARGEST_FORCE,
    LAW,
    LAW_SURFACE,
    MEMORY,
    ORIGIN,
    SHARES,
    SIZE,
    ZERO,
    pack,
    rates,
    remember,
)
from foretouch.models.contact_model import LARGEST_DEPTH, LARGEST_SPEED

__all__ = ["EXPERT_NAMES", "LONGEST_HORIZON", "ContactMapBank"]

EXPERT_NAMES = ("law", "coarse", "fine")
"""In the order of their shares."""

LONGEST_HORIZON = 0.3
"""Experts are scored on predictions at most this late [s]: on longer ones they are too much alike."""

FEWEST_UPDATES = 8
"""No force is rendered from fewer samples."""

LARGEST_SHIFT, LARGEST_SHIFT_IN_YOUTH, YOUTH = 9e-3, 1e-3, 0.3
"""A surface that is found further than this [m] from where the map began is out of its reach: the map begins anew; at
less in its first time in contact [s], for then the first contact was none and little is lost."""


class ContactMapBank(Estimator):
    r"""Learns a contact map (`foretouch.models.ContactMap`): two maps and the paper's law, scored on late predictions.

    **Maps.** Their weights w are learnt by recursive least squares, 250 times a second, in contact and out of it,

    .. math::
        K = \frac{P h}{h^T P h + \sigma^2}, \quad w \leftarrow w + K (F - h^T w), \quad P \leftarrow P - K h^T P

    where h holds the splines of the place and of the features. The prior is a cubic smoothing spline for the elastic
    part, that is doubly integrated white noise, which goes on straight where nothing was learnt, and a smooth Gaussian
    process for each feature. Only the ratio of prior and noise matters, so that nothing depends on the unit of force;
    and depth counts from the first contact, so that a surface found better later moves nothing. There is no forgetting
    towards the prior, but for a covariance that goes back to it in 50 minutes of contact.

    **Law.** The exact law (4) by `ExactRecursive`: a first guess from twenty samples, right within 0.1 s after a
    change, and the best where the material is of that kind.

    **Shares.** Every 20 ms the whole is kept, and each expert's force from what was known a delay ago is compared with
    what was felt since, where the place had been visited by then. With e_i the RMS error over about the last second of
    contact and c_i penalties (1.2 for the law; for each map what its knots cannot resolve),

    .. math:: \pi_i \propto (c_i e_i)^{-8}

    **Change.** Where over 0.05 s no map explains a force at a visited place to a quarter of the peak, the material has
    changed: the maps begin anew, and until they are scored again the law's share is largest. Where instead of a force
    nothing at all is felt, the material has gone, and the surface is looked for again.

    **Doubt.** The variance of a late prediction is a constant and shares of the squares of force and speed, none of
    them negative, by least squares on its own squared errors, scaled until one standard deviation holds 75 % of them:
    their tails are heavier than a Gaussian's.

    Args:
        horizon: How late a prediction is that the experts are scored on [s], 0 to 2.
        experts: Those that are asked, of ``law``, ``coarse`` and ``fine``.

    Attributes:
        changes: Sudden changes found since the last reset.

    Raises:
        SettingError: A horizon out of range, or no or unknown experts.

    References:
        Wahba (1990), Spline Models for Observational Data; Rasmussen and Williams (2006), Gaussian Processes for
        Machine Learning, section 6.3; Jacobs, Jordan, Nowlan and Hinton (1991), Adaptive mixtures of local experts,
        Neural Computation 3(1), for experts in shares. The paper's law: its equation (4).
    """

    name: ClassVar[str] = "bank"
    model_name: ClassVar[str] = "contact-map"

    def __init__(self, horizon: float = LONGEST_HORIZON, experts: Sequence[str] = EXPERT_NAMES) -> None:
        require("horizon", horizon, at_least=0.0, at_most=2.0)
        if not experts or not set(experts) <= set(EXPERT_NAMES):
            raise SettingError("experts", ", ".join(experts), f"must be some of {', '.join(EXPERT_NAMES)}")
        self.horizon = horizon
        self._absent = [name not in experts for name in EXPERT_NAMES]
        # Residuals count as alike for 0.02 s, not 0.1: the law is asked where it holds, and there it may be quick.
        self._law = ExactRecursive(ExactRecursiveOptions(correlation_time=0.02))
        self._priors = prior(0), prior(1)
        self._rates = np.empty(MEMORY)
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._law.reset()
        self._flat = np.zeros(SIZE)
        self._memory = np.full(MEMORY, math.nan)
        self._covariances = self._priors[0].copy(), self._priors[1].copy()
        self._ring = np.zeros((RING, SIZE + 2))
        self._notes = np.zeros(NOTES)
        self._notes[ABSENT : ABSENT + len(EXPERT_NAMES)] = self._absent
        self._notes[PATIENCE] = ALARM_FROM
        self._time = math.nan
        self._model: ContactMap | None = None
        self._touched = False
        self.updates = 0
        self.changes = 0
        self._begin()

    def _begin(self) -> None:
        """Begin a map where the surface is now."""
        restart(self._flat, *self._covariances, *self._priors, self._notes)
        self._flat[ORIGIN] = self._flat[ZERO] = self._flat[FELT] = 0.0
        self._flat[DOUBT : DOUBT + DOUBTS] = 0.0, FIRST_DOUBT**2, 0.0
        self._notes[MOMENTS:SPREAD] = 0.0
        self._notes[SPREAD] = 1.0
        self._notes[LEARNT_AT] = -math.inf
        self._memory[:] = math.nan
        self._begun = self.updates

    def update(self, sample: ContactSample) -> Status:
        """See `Estimator.update`."""
        time, depth, velocity, force, in_contact = sample
        self._law.update(sample)
        if not (abs(depth) <= LARGEST_DEPTH and abs(velocity) <= LARGEST_SPEED and abs(force) <= LARGEST_FORCE):
            return Status.FREE_AIR if math.isnan(depth) else Status.UNUSABLE
        self._touched = self._touched or in_contact
        if not self._touched:  # the map counts from the first contact
            return Status.FREE_AIR
        if not time > self._time and not math.isnan(self._time):
            return Status.UNUSABLE
        rates(0.0 if math.isnan(self._time) else time - self._time, self._rates)
        self._time = time
        place = depth - self._flat[ORIGIN]
        remember(self._memory, place, self._rates)
        if time - self._notes[LEARNT_AT] < PERIOD - 1e-7:
            return Status.WAITING
        law = self._law.model
        if isinstance(law, ContinuousSwitching):
            self._flat[LAW : LAW + 4] = law.parameters
            self._flat[LAW_SURFACE] = self._law.surface_correction
        code = learn(
            self._flat,
            self._memory,
            *self._covariances,
            *self._priors,
            self._ring,
            self._notes,
            time,
            place,
            velocity,
            force,
            in_contact,
            self.horizon,
        )
        self._model = None
        if code == FAILED:
            changes = self.changes
            self.reset()
            self.changes = changes
            return Status.RESTARTED
        if code == TOO_SOON:
            return Status.WAITING
        self.updates += 1
        if code == CHANGED:
            self.changes += 1
            if not in_contact:  # the material is gone, and nobody knows how far: all waits for the next touch
                self._law.reset()
                self._flat[LAW : LAW + 4] = self._flat[LAW_SURFACE] = 0.0
                self._begin()
                self._touched = False
            return Status.CHANGED
        return Status.LEARNT if in_contact else Status.FREE_AIR

    def expect_delay(self, delay: float) -> None:
        """See `Estimator.expect_delay`: experts are scored on predictions that late, if it is no more than 0.3 s."""
        if math.isfinite(delay):
            self.horizon = min(max(delay, 0.0), LONGEST_HORIZON)

    @property
    def shares(self) -> dict[str, float]:
        """Shares of the experts in the force, by name."""
        return dict(zip(EXPERT_NAMES, self._flat[SHARES : SHARES + len(EXPERT_NAMES)].tolist(), strict=True))

    def trust_surface(self, trusted: bool) -> None:
        """See `Estimator.trust_surface`."""
        self._law.trust_surface(trusted)

    def move_surface(self, change: float) -> None:
        """See `Estimator.move_surface`: the map stays where it is."""
        self._law.move_surface(change)
        if math.isfinite(change):
            self._flat[ORIGIN] -= change
            self._flat[LAW_SURFACE] += change
            self._model = None
            young = self._notes[CONTACT] < YOUTH
            if abs(self._flat[ORIGIN]) > (LARGEST_SHIFT_IN_YOUTH if young else LARGEST_SHIFT):
                self._begin()

    def move_offset(self, change: float) -> None:
        """See `Estimator.move_offset`: the map keeps what the sensor said."""
        if math.isfinite(change):
            self._flat[ZERO] += change
            self._model = None

    @property
    def model(self) -> ContactModel | None:
        """See `Estimator.model`."""
        if self.updates - self._begun < FEWEST_UPDATES:
            return None
        if self._model is None:
            try:
                stiffness, damping, exponent, switching = self._flat[LAW : LAW + 4].tolist()
                self._model = ContactMap(stiffness, damping, exponent, switching, pack(self._flat))
            except SettingError:  # numbers that 32 bits do not hold
                return None
        return self._model

    @property
    def state(self) -> ContactState:
        """See `Estimator.state`."""
        return tuple(self._memory.tolist())

    @property
    def parameters(self) -> dict[str, float | None]:
        """The law's numbers, as the law's own estimator gives them."""
        return self._law.parameters

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Of the law's numbers."""
        return self._law.standard_errors
