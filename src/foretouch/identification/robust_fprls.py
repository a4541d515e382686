"""The paper's estimator with all that mends it on measured contact."""

from __future__ import annotations

from typing import ClassVar

from foretouch.identification.fprls import by_distance
from foretouch.identification.linearised import FPRLSOptions, LinearisedEstimator
from foretouch.identification.robust import RobustOptions

__all__ = ["ROBUST", "RobustFPRLS"]

ROBUST = RobustOptions(
    gate_force=0.02,
    gate_depth=3e-4,
    largest_rate=100.0,
    weight_force=1.0,
    scaled=True,
    covariance_limit=0.1,
)
"""All robust options on."""


class RobustFPRLS(LinearisedEstimator):
    """Equation (20) with all of `RobustOptions` on.

    Args:
        options: As of `FPRLS`; its default has `ROBUST`.
    """

    name: ClassVar[str] = "robust-fprls"

    def __init__(self, options: FPRLSOptions | None = None) -> None:
        options = FPRLSOptions(robust=ROBUST) if options is None else options
        super().__init__(options, by_distance(options.forgetting_rate))
