"""Switching between the Kelvin-Voigt and the Hunt-Crossley law at a threshold of stiffness."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.identification.classic.least_squares import HuntCrossleyLogRLS, HuntCrossleyTwoStage, KelvinVoigtRLS
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.models import HuntCrossley, KelvinVoigt


class ThresholdSwitching(Estimator):
    r"""Runs both estimators on every sample and chooses the law by equation (3).

    .. math:: S(k_{kv}) = \text{Kelvin-Voigt where } k_{kv} \ge k_{th}, \text{ else Hunt-Crossley}

    k_kv is the stiffness that the Kelvin-Voigt estimator finds. At the switch the force jumps by the difference of the
    two laws. `parameters` are those of the law that is chosen now; `exponent` is None while it is Kelvin-Voigt.

    Args:
        threshold: k_th [N/m]; the paper's simulation takes 4000.
        stiff: Fresh estimator of the Kelvin-Voigt law, None for one with its defaults.
        soft: Fresh estimator of the Hunt-Crossley law, None for a `HuntCrossleyLogRLS`; the paper leaves it open.

    Raises:
        SettingError: threshold is not positive.

    References:
        Achhammer, Weber, Peer and Buss (2010), Improvement of model-mediated teleoperation using a new hybrid
        environment estimation technique, IEEE International Conference on Robotics and Automation.
    """

    name: ClassVar[str] = "switching"
    model_name: ClassVar[str] = "threshold-switching"

    def __init__(
        self,
        threshold: float = 4000.0,
        stiff: KelvinVoigtRLS | None = None,
        soft: HuntCrossleyLogRLS | HuntCrossleyTwoStage | None = None,
    ) -> None:
        require("threshold", threshold, above=0.0)
        self.threshold = threshold
        self._stiff = KelvinVoigtRLS() if stiff is None else stiff
        self._soft = HuntCrossleyLogRLS() if soft is None else soft
        self.reset()

    def reset(self) -> None:
        """Forget all samples."""
        self._stiff.reset()
        self._soft.reset()
        self.updates = 0

    def update(self, sample: ContactSample) -> Status:
        """One step of both; the status is that of the one that could do more."""
        statuses = self._stiff.update(sample), self._soft.update(sample)
        if Status.LEARNT in statuses:
            self.updates += 1
            return Status.LEARNT
        return Status.RESTARTED if Status.RESTARTED in statuses else statuses[0]

    @property
    def unscaled_covariance(self) -> NDArray[np.float64]:
        """P of the Kelvin-Voigt and of the Hunt-Crossley estimator in one, shape (5, 5); they share nothing."""
        from scipy.linalg import block_diag

        return np.asarray(block_diag(self._stiff.unscaled_covariance, self._soft.unscaled_covariance))

    @property
    def model(self) -> KelvinVoigt | HuntCrossley | None:
        """The law that (3) chooses now, None while that one has none."""
        stiff = self._stiff.model
        return stiff if stiff is not None and stiff.stiffness >= self.threshold else self._soft.model

    @property
    def parameters(self) -> dict[str, float | None]:
        """Stiffness, damping and exponent of the law that is chosen now; see `Estimator.parameters`."""
        known = super().parameters
        return {**known, "exponent": known.get("exponent")} if known else {}

    @property
    def standard_errors(self) -> dict[str, float | None] | None:
        """Of the law that is chosen now, None where its estimator has none."""
        errors = self._stiff.standard_errors if isinstance(self.model, KelvinVoigt) else self._soft.standard_errors
        return None if errors is None else {**errors, "exponent": errors.get("exponent")}
