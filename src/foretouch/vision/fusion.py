"""The pose of the fixture, from late images and from touches of its surface."""

from __future__ import annotations

import bisect
import math
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from foretouch.errors import SettingError
from foretouch.quantities.pose import Array, Pose
from foretouch.vision.seen import ContactSeen, ImageSeen, Seen, TouchedSurface, bend, height_derivative, is_finite


class Verdict(Enum):
    """What became of one image or contact."""

    USED = "used"
    REFUSED = "refused: it does not fit what is known of the fixture"
    REOPENED = "the fixture was moved: several agree on another pose, and the filter has opened for it"
    NOT_FINITE = "refused: it is not finite, or its covariance is none"
    TOO_LATE = "refused: it is older than the history that is kept"


@dataclass(frozen=True, slots=True)
class FusionSettings:
    """What is believed of the fixture and of the camera before anything is seen.

    Attributes:
        start_position: Standard deviation of the fixture's position at first [m].
        start_angle: Standard deviation of its orientation at first [rad].
        drift_position: Random walk of the fixture, density [m/sqrt(s)].
        drift_angle: Random walk of its orientation, density [rad/sqrt(s)].
        bias_position: Standard deviation of the error common to all images [m]; averaging does not take it away.
        bias_across: Standard deviation of this error across the view [m]: a camera errs most in how far away a board
            is, and a touch that shows that error along the surface's normal mends it along the view.
        view: Direction in which the camera looks, in the world; of no length where it is not known, and then
            `bias_position` holds in all directions.
        bias_angle: Standard deviation of the common error of orientation [rad].
        bias_time: Correlation time of such an error [s].
        gate: Probability that a good image or contact passes the gate.
        agreeing: Number of refused measurements, agreeing among themselves, that mean that the fixture was moved.
        agreeing_within: Time within which they come [s].
        history: Largest delay of a measurement [s].
        blind: Time without an image after which one touch that does not fit means that the fixture was moved [s].
    """

    start_position: float = 0.02
    start_angle: float = math.radians(10.0)
    drift_position: float = 1e-4
    drift_angle: float = math.radians(0.02)
    bias_position: float = 8e-4
    bias_across: float = 1.5e-4
    view: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias_angle: float = math.radians(0.1)
    bias_time: float = 60.0
    gate: float = 0.999
    agreeing: int = 4
    agreeing_within: float = 0.5
    history: float = 2.0
    blind: float = 1.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, self.view)):
            raise SettingError("view", self.view, "must be three finite numbers")
        for name in self.__dataclass_fields__.keys() - {"view"}:
            value = getattr(self, name)
            if not (math.isfinite(value) and value > 0.0):
                raise SettingError(name, value, "must be finite and above 0")
        if self.gate >= 1.0:
            raise SettingError("gate", self.gate, "must be below 1")


@dataclass(frozen=True, slots=True)
class FixtureState:
    """All that the filter knows at one time.

    Attributes:
        time: [s].
        pose: Pose of the fixture in the world.
        bias: Error common to all images, on the right of the pose, (6,).
        covariance: Covariance of pose error and bias, (12, 12).
        image_time: Exposure of the last image that was used [s]; -inf before it.
        contact_time: Time of the last contact that was used [s]; -inf before it.
        refused: The last ones that were refused and agree with each other.
    """

    time: float
    pose: Pose
    bias: Array
    covariance: Array
    image_time: float = -math.inf
    contact_time: float = -math.inf
    refused: tuple[Seen, ...] = ()

    @property
    def pose_covariance(self) -> Array:
        """Covariance of the pose's error on the right, (6, 6)."""
        return self.covariance[:6, :6]

    def sentence(self, now: float) -> str:
        """What is known at a time [s], for the operator."""
        deviation = np.sqrt(np.diag(self.pose_covariance))
        position = 1e3 * float(np.linalg.norm(deviation[:3]))
        angle = math.degrees(float(np.linalg.norm(deviation[3:])))
        uncertainty = f"within {position:.1f} mm and {angle:.1f} degrees (one standard deviation)"
        if self.image_time == -math.inf:
            return f"the fixture has not been seen yet: {uncertainty}"
        return f"the fixture was last seen {max(0.0, now - self.image_time):.1f} s ago: {uncertainty}"


LARGEST_POSITION, LARGEST_ANGLE = 0.5, math.pi / 2
_LIMIT = np.array([LARGEST_POSITION] * 3 + [LARGEST_ANGLE] * 3)


def _bounded(covariance: Array) -> Array:
    """Symmetric, and no pose uncertainty above what still means anything; scaling both sides keeps it a covariance."""
    scale = np.ones(12)
    scale[:6] = np.minimum(1.0, _LIMIT / np.sqrt(np.maximum(np.diag(covariance)[:6], 1e-30)))
    return 0.5 * (covariance + covariance.T) * np.outer(scale, scale)


def _variances(position: float, angle: float) -> Array:
    return np.array([position**2] * 3 + [angle**2] * 3)


@dataclass(slots=True)
class FixtureFilter:
    r"""An error-state Kalman filter for a fixture that stands still until it is bumped.

    The error of the pose and the error common to all images are one state of 12: an image gives
    r = log(T^-1 Z) - b = delta + b' + noise, a contact the height of q = T^-1 p, whose derivative is (-n, n x q), with
    more noise where the surface is not flat (`bend`). The common error keeps their average from being believed too
    far; contacts take it away along the normal. The update has Joseph's form. A measurement that comes late takes its
    place in time, and what came after it is worked through again: the order of arrival makes no difference.

    Args:
        fixture: The surface in its own frame.
        pose: Pose at which the fixture is believed to be.
        time: [s].
        settings: What is believed before.

    References:
        Sola (2017), Quaternion kinematics for the error-state Kalman filter; Bar-Shalom, Li & Kirubarajan (2001).
    """

    fixture: TouchedSurface
    pose: Pose
    time: float = 0.0
    settings: FusionSettings = field(default_factory=FusionSettings)
    _times: list[float] = field(init=False, default_factory=list)
    _seen: list[Seen] = field(init=False, default_factory=list)
    _states: list[FixtureState] = field(init=False, default_factory=list)
    _verdicts: list[Verdict] = field(init=False, default_factory=list)
    _gates: tuple[float, float] = field(init=False, default=(0.0, 0.0))
    _start: FixtureState = field(init=False)
    _bias: Array = field(init=False)

    def __post_init__(self) -> None:
        from scipy.stats import chi2

        s = self.settings
        self._gates = float(chi2.ppf(s.gate, 1)), float(chi2.ppf(s.gate, 6))
        covariance = np.zeros((12, 12))
        covariance[:6, :6] = np.diag(_variances(s.start_position, s.start_angle))
        self._bias = np.diag(_variances(s.bias_position, s.bias_angle))
        if (length := float(np.linalg.norm(s.view))) > 0.0:  # the view of the fixture is that as first believed
            view = self.pose.rotation.T @ (np.asarray(s.view) / length)
            across = s.bias_across**2
            self._bias[:3, :3] = across * np.eye(3) + (s.bias_position**2 - across) * np.outer(view, view)
        covariance[6:, 6:] = self._bias
        self._start = FixtureState(self.time, self.pose, np.zeros(6), covariance)

    def update(self, seen: Seen) -> Verdict:
        """Take an image or a contact in, late or not; what became of it. It never raises for what it holds."""
        if not is_finite(seen):
            return Verdict.NOT_FINITE
        newest = self._times[-1] if self._times else self._start.time
        if seen.time < max(self._start.time, newest - self.settings.history):
            return Verdict.TOO_LATE
        index = bisect.bisect_right(self._times, seen.time)
        self._times.insert(index, seen.time)
        self._seen.insert(index, seen)
        del self._states[index:], self._verdicts[index:]
        state = self._states[-1] if self._states else self._start
        for later in self._seen[index:]:
            state, verdict = self._step(state, later)
            self._states.append(state)
            self._verdicts.append(verdict)
        verdict = self._verdicts[index]
        if old := bisect.bisect_left(self._times, self._times[-1] - self.settings.history):
            self._start = self._states[old - 1]
            del self._times[:old], self._seen[:old], self._states[:old], self._verdicts[:old]
        return verdict

    def state(self, now: float) -> FixtureState:
        """What is known at a time [s] after the last measurement: the same pose, and more uncertainty."""
        return self._predict(self._states[-1] if self._states else self._start, now)

    def _predict(self, state: FixtureState, time: float) -> FixtureState:
        s, elapsed = self.settings, max(0.0, time - state.time)
        keep = math.exp(-elapsed / s.bias_time)
        transition = np.ones(12)
        transition[6:] = keep
        covariance = state.covariance * np.outer(transition, transition)
        covariance[:6, :6] += elapsed * np.diag(_variances(s.drift_position, s.drift_angle))
        covariance[6:, 6:] += (1.0 - keep**2) * self._bias
        return replace(state, time=max(time, state.time), bias=keep * state.bias, covariance=_bounded(covariance))

    def _step(self, state: FixtureState, seen: Seen) -> tuple[FixtureState, Verdict]:
        state = self._predict(state, seen.time)
        if self._fits(state, seen):
            return self._correct(state, seen), Verdict.USED
        if isinstance(seen, ContactSeen) and seen.time - state.image_time > self.settings.blind:
            # Nothing is seen, and a touch is elsewhere: the fixture was moved, and touches are all that tells of it.
            return self._reopen(replace(state, refused=(seen,))), Verdict.REOPENED
        agreeing = [
            before
            for before in state.refused
            if seen.time - before.time <= self.settings.agreeing_within and self._agree(state, before, seen)
        ]
        state = replace(state, refused=(*agreeing, seen))
        if len(state.refused) < self.settings.agreeing:
            return state, Verdict.REFUSED
        return self._reopen(state), Verdict.REOPENED

    def _innovation(self, state: FixtureState, seen: Seen) -> tuple[Array, Array, Array]:
        """Innovation (m,), its derivative by the state (m, 12), and the noise (m, m)."""
        if isinstance(seen, ImageSeen):
            innovation = (state.pose.inverse() @ seen.pose).log() - state.bias
            return innovation, np.hstack([np.eye(6), np.eye(6)]), seen.covariance
        point = state.pose.inverse().apply(seen.point)
        height, normal = self.fixture.height(point)
        derivative = np.concatenate([height_derivative(normal, point), np.zeros(6)])[None, :]
        noise = seen.deviation**2 + bend(self.fixture, point, state.pose_covariance)
        return np.array([-height]), derivative, np.array([[noise]])

    def _fits(self, state: FixtureState, seen: Seen) -> bool:
        innovation, derivative, noise = self._innovation(state, seen)
        if isinstance(seen, ContactSeen) and not self.fixture.holds(state.pose.inverse().apply(seen.point)):
            return False
        return self._within(innovation, derivative @ state.covariance @ derivative.T + noise)

    def _within(self, innovation: Array, spread: Array) -> bool:
        gate = self._gates[0] if len(innovation) == 1 else self._gates[1]
        return float(innovation @ np.linalg.solve(spread, innovation)) <= gate

    def _agree(self, state: FixtureState, one: Seen, other: Seen) -> bool:
        if type(one) is not type(other):
            return False
        first, _, noise = self._innovation(state, one)
        second, _, more = self._innovation(state, other)
        return self._within(first - second, noise + more)

    def _correct(self, state: FixtureState, seen: Seen) -> FixtureState:
        innovation, derivative, noise = self._innovation(state, seen)
        covariance = state.covariance
        spread = derivative @ covariance @ derivative.T + noise
        gain = np.linalg.solve(spread, derivative @ covariance).T
        change = gain @ innovation
        rest = np.eye(12) - gain @ derivative
        covariance = rest @ covariance @ rest.T + gain @ noise @ gain.T
        pose, bias = state.pose @ Pose.exp(change[:6]), state.bias + change[6:]
        state = replace(state, pose=pose, bias=bias, covariance=_bounded(covariance), refused=())
        if isinstance(seen, ImageSeen):
            return replace(state, image_time=seen.time)
        return replace(state, contact_time=seen.time)

    def _reopen(self, state: FixtureState) -> FixtureState:
        """Reset the pose to its uncertainty at the start; measurements that agree are then taken in, oldest first."""
        s, refused = self.settings, state.refused
        covariance = state.covariance.copy()
        covariance[:6, :6] += np.diag(_variances(s.start_position, s.start_angle))
        state = replace(state, covariance=_bounded(covariance), refused=())
        for seen in refused:
            if self._fits(state, seen):
                state = self._correct(state, seen)
        return state
