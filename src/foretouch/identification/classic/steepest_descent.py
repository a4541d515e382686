"""Steepest descent on the exact law (4): the paper's example of a nonlinear method, made as good as it can be."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from foretouch.core import Record, kernel
from foretouch.errors import SettingError
from foretouch.errors.checks import require
from foretouch.identification.conditioning.conditioner import ContactSample
from foretouch.identification.estimator import FEWEST_UPDATES, Estimator, Status
from foretouch.identification.exact.law import EXACT_LAWS, REFERENCE_TIME
from foretouch.models import ContactModel

DEPTH_MEMORY = 1000.0  # Samples over which the reference depth and the force scale are taken
REFERENCE_STEP = 0.4  # x0 follows the mean depth in steps of at least this much in ln x
SMALLEST_DEPTH = 0.02  # Nearer to the surface than this share of x0 nothing is learnt

LARGEST_LOG_FORCE = 25.0
LARGEST_DAMPING = 20.0  # Bounds of ln F0 on either side, and of D in F0


@dataclass(frozen=True, slots=True)
class SteepestDescentOptions:
    """What the paper leaves open.

    Args:
        step: mu of the normalised step, above 0 and below 2.
        initial_s: s at the beginning.
        initial_alpha: alpha at the beginning.
        initial_damping: D at the beginning, in F0; too much of it would take what belongs to F0 and s.
    """

    step: float = 0.5
    initial_s: float = 1.4
    initial_alpha: float = 0.5
    initial_damping: float = 0.0

    def __post_init__(self) -> None:
        require("step", self.step, above=0.0)
        if self.step >= 2.0:
            raise SettingError("step", self.step, "must be below 2: larger steps diverge")
        require("initial_s", self.initial_s, at_least=1.0, at_most=2.0)
        require("initial_alpha", self.initial_alpha, at_least=0.0, at_most=1.0)
        require("initial_damping", self.initial_damping, at_least=0.0, at_most=LARGEST_DAMPING)


class Descent(Record):
    """What is known of the law; all but the bounds 0 before the first sample."""

    bounds: Annotated[NDArray[Any], float, (4, 2)]  # of theta
    theta: Annotated[NDArray[Any], float, 4]  # ln F0, D / F0, s, alpha
    reference: float  # x0 [m]
    log_depth: float  # mean of ln x, weighted by F^2: with x0 there, steps along ln F0 and s disturb each other least
    power: float  # mean of F^2 [N^2]
    samples: float


@kernel("b1(Descent[::1], f8, f8, f8, f8)")
def _update(descents: NDArray[np.void], step: float, depth: float, velocity: float, force: float) -> bool:
    """One step in place; False where the sample cannot be used: nothing but the reference depth has changed then."""
    descent = descents[0]
    theta, bounds = descent.theta, descent.bounds
    descent.samples = min(descent.samples + 1.0, DEPTH_MEMORY)
    descent.power += (force * force - descent.power) / descent.samples
    weight = min(force * force / descent.power, descent.samples) if descent.power > 0.0 else 1.0
    descent.log_depth += weight * (math.log(depth) - descent.log_depth) / descent.samples
    log_ratio = descent.log_depth - math.log(descent.reference)
    if abs(log_ratio) > REFERENCE_STEP:  # the same law at another reference depth
        descent.reference *= math.exp(log_ratio)
        theta[0] += theta[2] * log_ratio
        theta[1] *= math.exp((1.0 - theta[3]) * log_ratio)
    u = depth / descent.reference
    if u < SMALLEST_DEPTH:
        return False
    log_u = math.log(u)
    elastic = math.exp(theta[0] + theta[2] * log_u)
    per_damping = elastic * math.exp(-theta[3] * log_u) * velocity * REFERENCE_TIME / descent.reference
    expected = elastic + theta[1] * per_damping
    slope = (expected, per_damping, expected * log_u, -theta[1] * per_damping * log_u)
    scale = max(math.sqrt(descent.power), abs(expected))
    power = 1e-2 * scale * scale
    for i in range(4):
        if bounds[i, 0] < bounds[i, 1]:
            power += slope[i] * slope[i]
    innovation = min(max(force - expected, -scale), scale)
    for i in range(4):
        theta[i] = min(max(theta[i] + step * slope[i] * innovation / power, bounds[i, 0]), bounds[i, 1])
    return True


class _SteepestDescent(Estimator):
    """The descent that `SteepestDescent` explains, for each law of the family (4)."""

    name: ClassVar[str] = "steepest-descent"

    def __init__(self, options: SteepestDescentOptions | None = None) -> None:
        self.options = SteepestDescentOptions() if options is None else options
        self._law = EXACT_LAWS[self.model_name]
        strengths = ((-LARGEST_LOG_FORCE, LARGEST_LOG_FORCE), (0.0, LARGEST_DAMPING))
        self._bounds = np.array([*strengths, self._law.s_bounds, self._law.alpha_bounds])
        self.reset()  # compiled when this module was loaded, before any loop

    def reset(self) -> None:
        """Forget all samples."""
        self._states = Descent.new(bounds=self._bounds)
        self._state = self._states[0]
        self._seen = 0
        self.updates = 0

    def update(self, sample: ContactSample) -> Status:
        """One step down the gradient; see `Estimator.update`."""
        if not sample.in_contact:
            return Status.FREE_AIR
        _, depth, velocity, force, _ = sample
        if not (1e-9 < depth < 1e6 and abs(velocity) < 1e6 and abs(force) < 1e9):
            return Status.UNUSABLE
        if self._state.reference == 0.0:
            self._begin(depth, velocity, force)
            return Status.GATED
        if not _update(self._states, self.options.step, depth, velocity, force):
            return Status.GATED
        self.updates += 1
        return Status.LEARNT

    def _begin(self, depth: float, velocity: float, force: float) -> None:
        """Start at the twentieth sample with force: nearer to the surface it would start from noise."""
        if not force > 1e-9:
            return
        self._seen += 1
        if self._seen < FEWEST_UPDATES:
            return
        options = self.options
        damped = 1.0 + options.initial_damping * max(velocity, 0.0) * REFERENCE_TIME / depth
        start = (math.log(force / damped), options.initial_damping, options.initial_s, options.initial_alpha)
        self._state.theta[:] = np.clip(start, self._bounds[:, 0], self._bounds[:, 1])
        self._state.reference = depth

    @property
    def model(self) -> ContactModel | None:
        """The law, None before 20 samples."""
        if self.updates < FEWEST_UPDATES:
            return None
        log_elastic, damping, s, alpha = self._state.theta.tolist()
        elastic = math.exp(log_elastic)
        try:
            return self._law.model(elastic, damping * elastic, s, alpha, float(self._state.reference))
        except (SettingError, OverflowError):  # depths and forces so extreme that k leaves the floating point numbers
            return None


class SteepestDescent(_SteepestDescent):
    r"""Identifies the exact law (4) by normalised steps down the gradient of the squared error.

    .. math:: \theta \leftarrow \Pi\left(\theta + \mu \frac{J e}{0.01\, G^2 + J^T J}\right), \quad
        e = F - \hat F, \quad J = \partial \hat F / \partial \theta, \quad
        \theta = (\ln F_0,\, D / F_0,\, s,\, \alpha)

    in the unknowns of `ExactLaw`, which are of like size: in k, lambda, n and alpha themselves the gradients differ by
    10^6 and no step suits all. G is the RMS force; e is held to it. The bounds are those of equation (5). The paper
    names the method for comparison and says what limits it: it needs good initial values, for it descends into the
    nearest valley. Along directions that hardly change the force (D against alpha) it stays where it began.

    Args:
        options: The choices that the paper leaves open.

    References:
        The paper, "Linearized scheme for CSCM"; Widrow and Stearns (1985), Adaptive Signal Processing (the normalised
        step).
    """

    model_name: ClassVar[str] = "continuous-switching"


class SteepestDescentKelvinVoigt(_SteepestDescent):
    """The same descent with s = alpha = 1: the Kelvin-Voigt law (1)."""

    model_name: ClassVar[str] = "kelvin-voigt"


class SteepestDescentHuntCrossley(_SteepestDescent):
    """The same descent with alpha = 0: the Hunt-Crossley law (2)."""

    model_name: ClassVar[str] = "hunt-crossley"
