"""Switching between the Kelvin-Voigt and the Hunt-Crossley law at a threshold of stiffness."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar, Literal

import numpy as np
from numpy.typing import NDArray

from foretouch.errors.checks import require
from foretouch.identification.classic.least_squares import (
    HuntCrossleyLogOptions,
    HuntCrossleyLogRLS,
    HuntCrossleyTwoStage,
    KelvinVoigtOptions,
    KelvinVoigtRLS,
    TwoStageOptions,
)
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import Estimator, Status
from foretouch.identification.linear.options import require_choice
from foretouch.models import HuntCrossley, KelvinVoigt


@dataclass(frozen=True, slots=True)
class SwitchingOptions:
    """Choices of `ThresholdSwitching`.

    Args:
        threshold: k_th [N/m]; the paper's simulation takes 4000.
        hunt_crossley: Method for the Hunt-Crossley law, `log-rls` or `two-stage`; the paper leaves it open.
        kelvin_voigt_options: Of the Kelvin-Voigt estimator.
        log_options: Of the Hunt-Crossley estimator if it is `log-rls`.
        two_stage_options: Of the Hunt-Crossley estimator if it is `two-stage`.

    Raises:
        SettingError: A value out of range.
    """

    threshold: float = 4000.0
    hunt_crossley: Literal["log-rls", "two-stage"] = "log-rls"
    kelvin_voigt_options: KelvinVoigtOptions = field(default_factory=KelvinVoigtOptions)
    log_options: HuntCrossleyLogOptions = field(default_factory=HuntCrossleyLogOptions)
    two_stage_options: TwoStageOptions = field(default_factory=TwoStageOptions)

    def __post_init__(self) -> None:
        require("threshold", self.threshold, above=0.0)
        require_choice("hunt_crossley", self.hunt_crossley, ("log-rls", "two-stage"))


class ThresholdSwitching(Estimator):
    r"""Runs both estimators on every sample and chooses the law by equation (3).

    .. math:: S(k_{kv}) = \text{Kelvin-Voigt where } k_{kv} \ge k_{th}, \text{ else Hunt-Crossley}

    k_kv is the stiffness that the Kelvin-Voigt estimator finds. At the switch the force jumps by the difference of the
    two laws. `parameters` are those of the law that is chosen now; `exponent` is None while it is Kelvin-Voigt.

    Args:
        options: Its choices.

    References:
        Achhammer, Weber, Peer and Buss (2010), Improvement of model-mediated teleoperation using a new hybrid
        environment estimation technique, IEEE International Conference on Robotics and Automation.
    """

    name: ClassVar[str] = "switching"
    model_name: ClassVar[str] = "threshold-switching"

    def __init__(self, options: SwitchingOptions | None = None) -> None:
        self.options = SwitchingOptions() if options is None else options
        self._stiff = KelvinVoigtRLS(self.options.kelvin_voigt_options)
        self._soft: HuntCrossleyLogRLS | HuntCrossleyTwoStage = (
            HuntCrossleyLogRLS(self.options.log_options)
            if self.options.hunt_crossley == "log-rls"
            else HuntCrossleyTwoStage(self.options.two_stage_options)
        )
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
        return stiff if stiff is not None and stiff.stiffness >= self.options.threshold else self._soft.model

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
