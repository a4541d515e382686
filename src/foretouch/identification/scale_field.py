"""The scale of a material's force, learnt place by place beside the law of the whole material."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from foretouch.identification import scale_field_kernel as kernel
from foretouch.models import ScaleField
from foretouch.models.scale_field import packed
from foretouch.models.scale_field_kernel import SIDE, TOUCHED

FORGOTTEN = 3  # Number of times that a node which is untouched again is told, for messages are lost
SHOWN = 0.99  # Part of the largest variance of a touched node that it is then told to have


class ScaleFieldLearner:
    r"""Learns how many times as strong as the law a material is, at each place that is touched.

    A force F at a point p tells of the law f and of the scale s there. It is shared between both by what is known of
    them. With the logarithm g of the scale, its variance v, and the law's relative variance r,

    .. math::
        e &= \frac{F}{e^{g} f} - 1, \quad r = \rho^2 + \left(\frac{\sigma_f}{f}\right)^2, \quad
        q = r + \left(\frac{\sigma_0}{e^{g} f}\right)^2 \\
        g &\leftarrow g + \frac{v}{v + q\, \tau / T}\, e, \qquad
        f \text{ learns } f + \frac{r}{r + v} \left(F e^{-g} - f\right)

    with :math:`\rho` = 2.5 %, :math:`\sigma_0` = 0.05 N, the standard deviation that the law says of its own force, and
    :math:`\tau` = 0.3 s, for which the errors of a law are alike, so that the samples of that time count as one. So
    the first press teaches the law; what is known well is not disturbed by a stiff spot; and the first press on the
    spot knows already what kind of material it is. Where it was touched first, the scale is 1. A force that is too
    small to be called contact is shared as well: a weak place is felt later than the law says, and what is felt before
    would make the law weaker with each. Where the law has no force, below :math:`\sigma_0`, it learns all of it.

    The unknowns are those of `foretouch.models.ScaleField`, with its prior. The Kalman filter keeps the joint
    covariance of the 16 nodes about the probe, and the variance alone of a node that the probe has left. A node that
    comes into that square follows from the others in it by the prior, or is what it was where that is known better. A
    scale drifts where it is touched, by 3 % in a second.

    Attributes:
        states: State of the compiled part, one record.
    """

    def __init__(self) -> None:
        self._take = kernel.take.entry
        self.reset()

    def reset(self) -> None:
        """Forget all places."""
        self.states = kernel.ScaleState.new()
        self._forgotten = np.zeros(0, np.int64)  # nodes that are untouched again, and have to be told

    def go_back(self, earlier: NDArray[np.void]) -> None:
        """Forget what was learnt since a copy of `states` was taken.

        Who hears of the field hears of it: a node that had not been touched before is told to be as the law says.
        """
        state, before = self.states[0], earlier[0]
        different = (state.scales.value != before.scales.value) | (state.scales.variance != before.scales.variance)
        forgotten, updates = state.nodes[before.count : state.count].copy(), state.updates + 1
        self.states[:] = earlier
        state.updates = updates
        state.changed[different & (before.changed > 0)] = updates
        self._forgotten = np.tile(forgotten, FORGOTTEN)

    @property
    def updates(self) -> int:
        """Number of samples that it has learnt from."""
        return int(self.states[0].updates)

    def touch_at(self, point: Sequence[float]) -> None:
        """Set where the next samples are felt, in the fixture's frame [m]; ignored where not finite."""
        x, y = point[:2]
        if math.isfinite(x) and math.isfinite(y):
            self.states["point"] = x, y

    def share(self, force: float, expected: float, deviation: float, period: float) -> float:
        """Learn from a force [N], in contact or out of it; what the law is to learn instead [N].

        Args:
            force: As felt.
            expected: That of the law [N]; NaN where there is none yet.
            deviation: Its standard deviation [N]; NaN where the law says none, which counts as none.
            period: Time since the last sample [s].
        """
        if math.isnan(self.states["point"][0, 0]):
            return force
        return self._take(self.states, force, expected, 0.0 if math.isnan(deviation) else deviation, period)

    @property
    def field(self) -> ScaleField:
        """The field as learnt so far, as it arrives elsewhere."""
        field = ScaleField()
        field.take(self.news(-1, 0, SIDE**2))
        return field

    def news(self, since: int, least: int, most: int) -> bytes:
        """The nodes that have changed after so many updates, and others in turn, for `ScaleField.take`.

        Args:
            since: Number of updates.
            least: Number of nodes that is reached by others, if there are as many.
            most: Largest number of those that have changed.
        """
        picked = np.empty(max(least, most), np.int64)
        count, scales = kernel.pick(self.states, since, least, picked[:most]), self.states[0].scales
        i, j = divmod(picked[:count], SIDE)
        if since < 0 or self._forgotten.size == 0:
            return packed(i, j, scales.value[i, j], scales.variance[i, j])
        gone, self._forgotten = self._forgotten[: most - count], self._forgotten[most - count :]
        k, m = divmod(np.unique(gone[scales.variance.flat[gone] >= TOUCHED]), SIDE)
        value = np.concatenate([scales.value[i, j], np.zeros(k.size)])
        variance = np.concatenate([scales.variance[i, j], np.full(k.size, SHOWN * TOUCHED)])
        return packed(np.concatenate([i, k]), np.concatenate([j, m]), value, variance)
