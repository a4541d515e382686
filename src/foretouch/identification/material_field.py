"""The field of materials, learnt from samples that a probe takes as it goes over a surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.identification import material_field_kernel as kernel
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.models import FIELD_DEPTH, NODE_SPACING, MaterialField, QuadraticContact
from foretouch.models.material_field import LARGEST_DEVIATION
from foretouch.models.material_field_kernel import CORNERS, HALF, NUMBERS

Array = NDArray[np.float64]

FIRST_DEVIATION = 300.0  # Standard deviation of each unknown before the first sample [N]

_MEAN = np.array([-1])  # Rows of the mean law alone
_STATUSES = (Status.FREE_AIR, Status.UNUSABLE, Status.HELD, Status.LEARNT, Status.CHANGED, Status.RESTARTED)


class MaterialFieldLearner(Estimator):
    r"""Learns the law at each position of a surface from the forces measured there.

    .. math::
        F &= \sum_{n=1}^{8} w_n(p) \left(a_n x + b_n x^2 + c_n x \dot x\right) + e \\
        K_n &= \frac{P_n h_n}{\sigma^2 + \sum_m h_m^T P_m h_m}, \quad
        h_n = w_n \left(\frac{x}{x_0}, \frac{x^2}{x_0^2}, \frac{x \dot x}{x_0 v_0}\right)

    the Kalman filter of the 24 unknowns of the eight nodes about the touched point p, with the trilinear weights w,
    with their joint covariance in the form of Joseph. The cross-covariance of a pair of nodes is kept while both are
    about the probe; a node that it leaves keeps the covariance of its own three unknowns. Dropping the rest overstates
    the uncertainty of a blend, for the dropped terms say that if one node is stiffer, its neighbour is softer; dropping
    them at every sample would count the one measurement of eight nodes as independent ones of each.

    A new node begins as the **mean law**, which is learnt from all samples alike, with a standard deviation of 100 %
    common to its numbers, correlated by 0.9 with those of nodes that begin with it, and 20 % of each by itself. A node
    that was hardly touched begins so again when the probe comes back. Samples that are further off than three standard
    deviations weigh less; where most of 20 are further off than four, the material has changed and the nodes about it
    begin anew, with four times the standard deviation. Where innovations are larger than expected for longer, as at the
    edge of an inclusion that no blend can follow, the noise is increased by that ratio. Information on a node is
    forgotten by samples taken there: by 1/e in 500. No covariance has more trace than at first.

    A sample is learnt in contact only, and only where depth or position has changed since the last.
    Of 1,024 nodes the one that was touched longest ago makes room for a new one.

    Without `touch_at` all samples are at one position, at a node: the estimator of one quadratic law.

    Args:
        spacing: Spacing h of the nodes [m].

    Attributes:
        states: State of the compiled part, one record.

    Raises:
        SettingError: The spacing is out of range.

    References:
        Bucy and Joseph (1968), Filtering for Stochastic Processes with Applications to Guidance: the form of Joseph.
    """

    name: ClassVar[str] = "material-field"
    model_name: ClassVar[str] = "quadratic"

    def __init__(self, spacing: float = NODE_SPACING) -> None:
        require("spacing", spacing, at_least=1e-3, at_most=0.1)
        self.spacing, self._take, self._has_law = spacing, kernel.take.entry, kernel.has_law.entry
        self.reset()

    def reset(self) -> None:
        """Forget all samples and all nodes."""
        self.states = kernel.FieldState.new(spacing=self.spacing, at=-1, last=math.inf)
        mean = self.states[0].nodes[kernel.MEAN]
        mean.covariance, mean.limit = FIRST_DEVIATION**2 * np.eye(kernel.UNKNOWNS), kernel.UNKNOWNS * FIRST_DEVIATION**2
        self._field: MaterialField | None = None
        self.updates = self.changes = 0

    def touch_at(self, point: Sequence[float]) -> None:
        """Set the position of the next sample before `update`, in the fixture's frame [m]; ignored where not finite."""
        x, y, z = point
        if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
            self.states["point"] = x, y, z

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        return self.taken(self._take(self.states, *sample[1:]), True)

    def taken(self, code: int, news: bool) -> Status:
        """Take over what compiled code did."""
        if code >= kernel.LEARNT:
            self._field = None
            self.updates += 1
            self.changes += code == kernel.CHANGED
        if code == kernel.RESTART:
            self.reset()
        return _STATUSES[code]

    def _laws(self, at: NDArray[np.int64]) -> Array:
        """Laws of nodes, none negative, and their standard deviations, of shape (m, 4); the mean law for -1."""
        out = np.empty((len(at), NUMBERS))
        kernel.LAWS_OF(self.states[0].nodes, at, out)
        return out

    @property
    def field(self) -> MaterialField:
        """The field as learnt so far; without nodes before 20 samples."""
        if self._field is None:
            state = self.states[0]
            codes, covariance = state.codes[: state.count], state.nodes[kernel.MEAN].covariance
            keys = np.stack([codes >> 32, (codes >> 16) & 0xFFFF, codes & 0xFFFF], axis=1) - HALF
            slope = np.array([kernel.SCALES[0], 2.0 * FIELD_DEPTH * kernel.SCALES[1], 0.0])
            variance = float(slope @ (kernel.PRIOR_OF(state)[1] + covariance) @ slope)
            mean, deviation = self._laws(_MEAN)[0, : kernel.UNKNOWNS], min(math.sqrt(variance), LARGEST_DEVIATION)
            laws = self._laws(np.arange(state.count))
            self._field = MaterialField(keys, laws, mean=mean.tolist(), uncertainty=deviation, spacing=self.spacing)
        return self._field

    @property
    def has_model(self) -> bool:
        """See `Estimator.has_model`: one compiled call."""
        return self._has_law(self.states)

    @property
    def model(self) -> QuadraticContact | None:
        """The law at the touched point; None before 20 samples, and while no force follows from it."""
        if not self.has_model:
            return None
        nodes, weights, missing = self._here()
        law = weights @ self._laws(nodes)[:, : kernel.UNKNOWNS] + missing * self._laws(_MEAN)[0, : kernel.UNKNOWNS]
        return QuadraticContact(*(max(value, 0.0) for value in law.tolist()))

    def _here(self) -> tuple[NDArray[np.int64], Array, float]:
        """The known nodes about the point, their weights, and the weight of the unknown ones."""
        about, at, weights = np.empty(CORNERS, np.int64), np.empty(CORNERS, np.int64), np.empty(CORNERS)
        kernel.FIND(self.states[0], tuple(self.states["point"][0].tolist()), about, at, weights)
        weights = weights[at >= 0]
        return at[at >= 0], weights, 1.0 - float(weights.sum())

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard errors of the law at the point, nodes taken as independent; None before there is a law."""
        if not self.has_model:
            return None
        nodes, weights, missing = self._here()
        variances = np.einsum("nii->ni", self.states[0].nodes["covariance"][nodes])
        unknown = np.diag(kernel.PRIOR_OF(self.states[0])[1])
        errors = np.sqrt(np.maximum(np.square(weights) @ variances + missing**2 * unknown, 0.0))
        return dict(zip(QuadraticContact.parameter_names, (errors * kernel.SCALES).tolist(), strict=True))
