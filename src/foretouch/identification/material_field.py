"""The field of materials, learnt from samples that a probe takes as it goes over a surface."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.material_field_kernel import UNKNOWNS, Node, carry_over, laws_of, learn
from foretouch.models import FIELD_DEPTH, MOST_NODES, NODE_SPACING, MaterialField, QuadraticContact
from foretouch.models.material_field import LARGEST_DEVIATION, LARGEST_LAW
from foretouch.models.material_field_kernel import CORNERS, HALF, NUMBERS, cell_of

Array = NDArray[np.float64]

REFERENCE_DEPTH, REFERENCE_SPEED = 5e-3, 0.05
"""Depth [m] and speed [m/s] at which the unknowns are forces [N], so that all are of one magnitude."""

SCALES = np.array([1.0 / REFERENCE_DEPTH, 1.0 / REFERENCE_DEPTH**2, 1.0 / (REFERENCE_DEPTH * REFERENCE_SPEED)])
"""Factors that convert the unknowns to a, b and c."""

FIRST_DEVIATION = 300.0  # Standard deviation of each unknown before the first sample [N]

FORCE_NOISE, SHARE_NOISE = 0.05, 0.15
"""Standard deviation of a force: constant [N], and the fraction of it that the law misses. Errors of successive samples
are correlated, at edges that the lattice cannot follow above all, so both are larger than a sensor's noise."""

FORGETTING, MEAN_FORGETTING = 2e-3, 5e-5
"""Fraction of the information on a node, and on the mean law, that one more sample there forgets."""

SPREAD, FREEDOM = 1.0, 0.2
"""Standard deviation of a node from the mean law, relative to its force: common to its unknowns, and of each alone."""

TOGETHER = 0.9  # Correlation of the common deviation of nodes that begin together
CHANGED_SPREAD = 4.0  # Factor on the standard deviation of a node whose material has changed, relative to a new one

DEPTH_STEP, WAY_STEP = 2e-5, 1e-4
"""Least change of depth [m] or of position [m] from the last sample for a sample to carry new information."""

FEWEST_UPDATES = 20  # Fewest samples from which a force is rendered

MEAN_UPDATES = 300
"""Number of samples after which nodes are made, unless the mean law is more certain than they will be before: its own
uncertainty would otherwise be taken for differences between positions."""

LEAST_WEIGHT = 1e-3  # Least weight for which a node is made

LARGEST_DEPTH, LARGEST_SPEED, LARGEST_FORCE = 0.1, 5.0, 1e4
"""Largest depth [m], speed [m/s] and force [N] of a sample; others are left out."""

LARGEST_UNKNOWN = 1e7  # Largest valid estimate of an unknown [N]

MISFIT_RATE, LARGEST_RATIO = 0.02, 9.0
"""Rate and largest value of the running mean of squared innovations over their expectation, which scales the noise."""

SURPRISING, SURPRISE_RATE, SURPRISE_LIMIT = 16.0, 0.05, 0.8
"""Squared innovation over its variance that is an outlier, rate of their running mean, and the mean of a change."""


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

    Raises:
        SettingError: The spacing is out of range.

    References:
        Bucy and Joseph (1968), Filtering for Stochastic Processes with Applications to Guidance: the form of Joseph.
    """

    name: ClassVar[str] = "material-field"
    model_name: ClassVar[str] = "quadratic"

    def __init__(self, spacing: float = NODE_SPACING) -> None:
        require("spacing", spacing, at_least=1e-3, at_most=0.1)
        self.spacing = spacing
        self.reset()

    def reset(self) -> None:
        """Forget all samples and all nodes."""
        self._rows: dict[int, int] = {}
        self._nodes = Node.new(MOST_NODES)
        self._mean = Node.new(covariance=FIRST_DEVIATION**2 * np.eye(UNKNOWNS), limit=UNKNOWNS * FIRST_DEVIATION**2)
        self._about = np.zeros(CORNERS, np.int64)
        self._weights = np.zeros(CORNERS)
        self._at = np.full(CORNERS, -1, np.int64)
        self._cell = -1
        self._point = (0.0, 0.0, 0.0)
        self._last = (math.inf, 0.0, 0.0, 0.0)  # depth and point of the newest sample learnt
        self._joint = np.zeros((CORNERS * UNKNOWNS, CORNERS * UNKNOWNS))
        self._surprise = 0.0
        self._misfit = 1.0
        self._field: MaterialField | None = None
        self.updates = 0
        self.changes = 0

    def touch_at(self, point: Sequence[float]) -> None:
        """Set the position of the next sample before `update`, in the fixture's frame [m]; ignored where not finite."""
        x, y, z = point
        if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
            self._point = (x, y, z)

    def update(self, sample: ContactSample) -> Status:
        """One step; see `Estimator.update`."""
        refusal = self._refuse(sample)
        if refusal is not None:
            return refusal
        _, depth, velocity, force, _ = sample
        self._last = (depth, *self._point)
        weight = depth / REFERENCE_DEPTH
        regressor = (weight, weight * weight, weight * velocity / REFERENCE_SPEED)
        noise = FORCE_NOISE**2 + (SHARE_NOISE * force) ** 2
        learn(
            self._mean,
            _FIRST,
            _ALL,
            self._mean[0].covariance,
            regressor,
            force,
            noise,
            MEAN_FORGETTING,
        )
        self._field = None
        self.updates += 1
        if not float(np.abs(self._mean[0].theta[:2]).sum()) < LARGEST_UNKNOWN:
            self.reset()
            return Status.RESTARTED
        if not (self._rows or self._mean_is_known()):
            return Status.LEARNT
        self._find_nodes()
        ratio = learn(
            self._nodes,
            self._at,
            self._weights,
            self._joint,
            regressor,
            force,
            noise * max(self._misfit, 1.0),
            FORGETTING,
        )
        self._nodes["touched"][self._at[self._at >= 0]] = self.updates
        return self._judge(ratio)

    def _refuse(self, sample: ContactSample) -> Status | None:
        """Why a sample is not learnt from, None if it is."""
        _, depth, velocity, force, in_contact = sample
        if not in_contact:
            return Status.FREE_AIR
        usable = 0.0 < depth <= LARGEST_DEPTH and abs(velocity) <= LARGEST_SPEED and abs(force) <= LARGEST_FORCE
        if not usable:
            return Status.UNUSABLE
        last_depth, x, y, z = self._last
        px, py, pz = self._point
        aside = (px - x) ** 2 + (py - y) ** 2 + (pz - z) ** 2
        return Status.HELD if abs(depth - last_depth) < DEPTH_STEP and aside < WAY_STEP**2 else None

    def _find_nodes(self) -> None:
        """Find the nodes about the point and their weights; missing ones are made."""
        cell_of(*self._point, self.spacing, self._about, self._weights)
        cell = int(self._about[0])
        entered, self._cell = cell != self._cell, cell
        if not entered and not ((self._at < 0) & (self._weights > LEAST_WEIGHT)).any():
            return
        before = self._at.copy()
        fresh, spread = self._fresh()
        trace = float(np.trace(spread))
        begun = []
        for corner, (code, weight) in enumerate(zip(self._about.tolist(), self._weights.tolist(), strict=True)):
            node = self._rows.get(code, -1)
            if node < 0 and weight > LEAST_WEIGHT:
                node = self._room_for(code)
                self._begin(node, fresh, spread, trace)
                begun.append(corner)
            elif node >= 0 and node not in before and float(np.trace(self._nodes[node].covariance)) > trace:
                self._begin(node, fresh, spread, trace)
                begun.append(corner)
            self._at[corner] = node
        self._joint = carry_over(self._nodes, before, self._at, self._joint)
        self._tie(begun, fresh, 1.0)

    def _room_for(self, code: int) -> int:
        """Row for a new node: a free one, or that of the node touched longest ago."""
        node = len(self._rows)
        if node == MOST_NODES:
            node = int(np.argmin(self._nodes["touched"]))
            del self._rows[int(self._nodes[node].code)]
        self._rows[code] = node
        self._nodes[["code", "touched"]][node] = code, self.updates
        return node

    def _begin(self, node: int, fresh: Array, spread: Array, trace: float) -> None:
        self._nodes[["theta", "covariance", "limit"]][node] = fresh, spread, trace

    def _tie(self, corners: list[int], fresh: Array, factor: float) -> None:
        """Correlate nodes that begin together: they are likely to be all stiffer than the mean, or all softer."""
        common = TOGETHER * (factor * SPREAD) ** 2 * np.outer(fresh, fresh)
        for one in corners:
            for other in corners:
                if one != other:
                    rows, columns = UNKNOWNS * one, UNKNOWNS * other
                    self._joint[rows : rows + UNKNOWNS, columns : columns + UNKNOWNS] = common

    def _fresh(self) -> tuple[Array, Array]:
        """Prior mean of a node that has not been touched, and its covariance."""
        mean = np.maximum(self._mean[0].theta, 0.0)
        force = max(float(mean[0] + mean[1]), FORCE_NOISE)
        own = np.square(FREEDOM * force * np.array([1.0, 1.0, FREEDOM]))
        return mean, SPREAD**2 * np.outer(mean, mean) + np.diag(own)

    def _mean_is_known(self) -> bool:
        """Whether the mean law is certain enough to begin nodes from it."""
        if self.updates < FEWEST_UPDATES:
            return False
        return self.updates >= MEAN_UPDATES or bool(
            np.trace(self._mean[0].covariance) < FREEDOM**2 * np.trace(self._fresh()[1])
        )

    def _judge(self, ratio: float) -> Status:
        """Whether the material at the point is unchanged."""
        before = self._misfit
        self._misfit += MISFIT_RATE * (min(ratio, LARGEST_RATIO) * max(before, 1.0) - before)
        surprised = 1.0 if ratio * max(before, 1.0) > SURPRISING else 0.0
        self._surprise += SURPRISE_RATE * (surprised - self._surprise)
        if self._surprise < SURPRISE_LIMIT:
            return Status.LEARNT
        self._surprise = 0.0
        self.changes += 1
        self._misfit = 1.0
        fresh, spread = self._fresh()
        spread *= CHANGED_SPREAD**2
        corners = np.flatnonzero(self._at >= 0).tolist()
        for corner in corners:
            self._begin(int(self._at[corner]), fresh, spread, float(np.trace(spread)))
        self._joint = carry_over(self._nodes, _NONE, self._at, self._joint)
        self._tie(corners, fresh, CHANGED_SPREAD)
        return Status.CHANGED

    def _laws(self, at: NDArray[np.int64]) -> Array:
        """Laws of nodes, none negative, and their standard deviations, of shape (m, 4)."""
        out = np.empty((len(at), NUMBERS))
        laws_of(self._nodes, at, SCALES, FIELD_DEPTH, _LARGEST, out)
        return out

    def _mean_law(self) -> Array:
        """The mean law, none of it negative, and the standard deviation of an untouched position, of shape (4,)."""
        out = np.empty((1, NUMBERS))
        laws_of(self._mean, _FIRST, SCALES, FIELD_DEPTH, _LARGEST, out)
        _, spread = self._fresh()
        slope = np.array([SCALES[0], 2.0 * FIELD_DEPTH * SCALES[1], 0.0])
        out[0, 3] = min(math.sqrt(float(slope @ (spread + self._mean[0].covariance) @ slope)), LARGEST_DEVIATION)
        row: Array = out[0]
        return row

    @property
    def field(self) -> MaterialField:
        """The field as learnt so far; without nodes before 20 samples."""
        if self._field is None:
            count = len(self._rows)
            codes = self._nodes["code"][:count]
            keys = np.stack([codes >> 32, (codes >> 16) & 0xFFFF, codes & 0xFFFF], axis=1) - HALF
            mean = self._mean_law()
            self._field = MaterialField(
                keys,
                self._laws(np.arange(count)),
                mean=mean[:3].tolist(),
                uncertainty=float(mean[3]),
                spacing=self.spacing,
            )
        return self._field

    @property
    def model(self) -> QuadraticContact | None:
        """The law at the touched point; None before 20 samples, and while no force follows from it."""
        if self.updates < FEWEST_UPDATES:
            return None
        nodes, weights = self._here()
        known = nodes >= 0
        laws = self._laws(nodes[known])[:, :UNKNOWNS]
        a, b, c = weights[known] @ laws + (1.0 - float(weights[known].sum())) * self._mean_law()[:UNKNOWNS]
        return QuadraticContact(*(max(float(value), 0.0) for value in (a, b, c))) if a + b > 0.0 else None

    def _here(self) -> tuple[NDArray[np.int64], Array]:
        """The nodes about the point, -1 for unknown ones, and their weights."""
        about, weights = np.empty(CORNERS, np.int64), np.empty(CORNERS)
        cell_of(*self._point, self.spacing, about, weights)
        return np.array([self._rows.get(code, -1) for code in about.tolist()]), weights

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Standard errors of the law at the point, nodes taken as independent; None before there is a law."""
        if self.model is None:
            return None
        nodes, weights = self._here()
        known = nodes >= 0
        variances = np.einsum("nii->ni", self._nodes["covariance"][nodes[known]])
        missing = 1.0 - float(weights[known].sum())
        errors = np.sqrt(
            np.maximum(np.square(weights[known]) @ variances + missing**2 * np.diag(self._fresh()[1]), 0.0)
        )
        return dict(zip(QuadraticContact.parameter_names, (errors * SCALES).tolist(), strict=True))


_FIRST = np.zeros(1, np.int64)
_NONE = np.zeros(0, np.int64)
_ALL = np.ones(1)
_LARGEST = np.array(LARGEST_LAW)
