"""The pose of the fixture, from late images, from touches of its surface, and from a probe that slides over it."""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np

from foretouch.errors import SettingError
from foretouch.quantities.pose import Array, Pose, cross_matrix
from foretouch.vision.seen import (
    ContactSeen,
    ImageSeen,
    Seen,
    SlideSeen,
    TouchedSurface,
    bend,
    height_derivative,
    is_finite,
    turning,
)


class Verdict(Enum):
    """What became of one image, contact or slide."""

    USED = "used"
    RUBBED = "used, for friction alone: the pose is seen"
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
        blind: Time without an image after which one touch that does not fit means that the fixture was moved, and a
            probe that slides tells of the pose [s].
        bump_position: Standard deviation of where the surface is, at the place where a probe slides that shows that the
            fixture was moved [m]: it is still felt there.
        bump_angle: The same of how it is turned about that place [rad].
        slant: Standard deviation of what may turn the forces of all slides alike [rad]: a sensor mounted aslant, soft
            tissue.
        friction: Coefficient of friction that is believed at first.
        friction_deviation: Its standard deviation.
        drift_friction: Random walk of it, density [1/sqrt(s)]: other places rub otherwise.
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
    bump_position: float = 5e-3
    bump_angle: float = math.radians(3.0)
    slant: float = math.radians(2.0)
    friction: float = 0.3
    friction_deviation: float = 0.3
    drift_friction: float = 1e-2

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
        friction: Coefficient of friction.
        covariance: Covariance of pose error, bias and friction, (13, 13).
        image_time: Exposure of the last image that was used [s]; -inf before it.
        contact_time: Time of the last contact that was used [s]; -inf before it.
        refused: The last ones that were refused and agree with each other.
        slide_time: Time of the last slide that was to tell of the pose [s]; -inf before it.
        felt: Where that was, in the fixture's frame [m].
        strange: How unlikely the last slides are: a mean square of their innovations, 1 for those that are expected.
    """

    time: float
    pose: Pose
    bias: Array
    friction: float
    covariance: Array
    image_time: float = -math.inf
    contact_time: float = -math.inf
    refused: tuple[Seen, ...] = ()
    slide_time: float = -math.inf
    felt: Array = field(default_factory=lambda: np.zeros(3))
    strange: float = 1.0

    @property
    def pose_covariance(self) -> Array:
        """Covariance of the pose's error on the right, (6, 6)."""
        return self.covariance[POSE, POSE]

    def sentence(self, now: float) -> str:
        """What is known at a time [s], for the operator."""
        deviation = np.sqrt(np.diag(self.pose_covariance))
        position = 1e3 * float(np.linalg.norm(deviation[:3]))
        angle = math.degrees(float(np.linalg.norm(deviation[3:])))
        uncertainty = f"within {position:.1f} mm and {angle:.1f} degrees (one standard deviation)"
        if self.image_time == -math.inf:
            return f"the fixture has not been seen yet: {uncertainty}"
        return f"the fixture was last seen {max(0.0, now - self.image_time):.1f} s ago: {uncertainty}"


POSE, BIAS, FRICTION = slice(6), slice(6, 12), 12
STATES = 13
"""Where the unknowns stand in the covariance, and their number."""

LARGEST_POSITION, LARGEST_ANGLE = 0.5, math.pi / 2
SLIDES = 10  # Number of slides of which the mean counts: half a second, the time within which images agree
STRANGEST = 4.5  # What one of them counts for at most: five in a row are needed

_LIMIT = np.array([LARGEST_POSITION] * 3 + [LARGEST_ANGLE] * 3)


def _bounded(covariance: Array) -> Array:
    """Symmetric, and no pose uncertainty above what still means anything; scaling both sides keeps it a covariance."""
    scale = np.ones(STATES)
    scale[POSE] = np.minimum(1.0, _LIMIT / np.sqrt(np.maximum(np.diag(covariance)[POSE], 1e-30)))
    return 0.5 * (covariance + covariance.T) * np.outer(scale, scale)


def _variances(position: float, angle: float) -> Array:
    return np.array([position**2] * 3 + [angle**2] * 3)


def _about(place: Array, variances: Array) -> Array:
    """Covariance of a pose that is displaced and turned by these about a place in the fixture's frame [m], (6, 6)."""
    turned = np.eye(6)
    turned[:3, 3:] = cross_matrix(place)
    return turned @ np.diag(variances) @ turned.T


@dataclass(slots=True)
class FixtureFilter:
    r"""An error-state Kalman filter for a fixture that stands still until it is bumped.

    The error of the pose, the error common to all images and the coefficient of friction are one state of 13: an image
    gives r = log(T^-1 Z) - b = delta + b' + noise, a contact the height of q = T^-1 p, whose derivative is (-n, n x q),
    with more noise where the surface is not flat (`bend`), and a slide the normal there (`turning`), from the direction
    of the force. The common error keeps the images' average from being believed too far; contacts take it away along
    the normal. Slides tell of the pose where no image does, else of friction alone. The update has Joseph's form. A
    measurement that comes late takes its place in time, and what came after it is worked through again: the order of
    arrival makes no difference.

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
    _gates: dict[int, float] = field(init=False, default_factory=dict)
    _start: FixtureState = field(init=False)
    _bias: Array = field(init=False)

    def __post_init__(self) -> None:
        from scipy.stats import chi2

        s = self.settings
        self._gates = {size: float(chi2.ppf(s.gate, size)) for size in (1, 2, 6, 2 * SLIDES)}
        covariance = np.zeros((STATES, STATES))
        covariance[POSE, POSE] = np.diag(_variances(s.start_position, s.start_angle))
        self._bias = np.diag(_variances(s.bias_position, s.bias_angle))
        if (length := float(np.linalg.norm(s.view))) > 0.0:  # the view of the fixture is that as first believed
            view = self.pose.rotation.T @ (np.asarray(s.view) / length)
            across = s.bias_across**2
            self._bias[:3, :3] = across * np.eye(3) + (s.bias_position**2 - across) * np.outer(view, view)
        covariance[BIAS, BIAS], covariance[FRICTION, FRICTION] = self._bias, s.friction_deviation**2
        self._start = FixtureState(self.time, self.pose, np.zeros(6), s.friction, covariance)

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
        """What is known at a time [s] after the last measurement: the same pose, and more uncertainty.

        No tilt by slides is known better than what may be wrong with all of them, about the place of the last.
        """
        state = self._predict(self._states[-1] if self._states else self._start, now)
        if not state.slide_time > state.image_time:
            return state
        covariance = state.covariance.copy()
        short = np.maximum(self.settings.slant**2 - np.diag(covariance)[3:6], 0.0)
        covariance[POSE, POSE] += _about(state.felt, np.concatenate([np.zeros(3), short]))
        return replace(state, covariance=covariance)

    def _predict(self, state: FixtureState, time: float) -> FixtureState:
        s, elapsed = self.settings, max(0.0, time - state.time)
        keep = math.exp(-elapsed / s.bias_time)
        transition = np.ones(STATES)
        transition[BIAS] = keep
        covariance = state.covariance * np.outer(transition, transition)
        covariance[POSE, POSE] += elapsed * np.diag(_variances(s.drift_position, s.drift_angle))
        covariance[BIAS, BIAS] += (1.0 - keep**2) * self._bias
        covariance[FRICTION, FRICTION] += elapsed * s.drift_friction**2
        return replace(state, time=max(time, state.time), bias=keep * state.bias, covariance=_bounded(covariance))

    def _step(self, state: FixtureState, seen: Seen) -> tuple[FixtureState, Verdict]:
        if isinstance(seen, SlideSeen):
            return self._slide(state, seen)
        state = self._predict(state, seen.time)
        if self._fits(state, seen):
            return self._correct(state, seen), Verdict.USED
        if isinstance(seen, ContactSeen) and self._is_blind(state, seen):
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

    def _slide(self, state: FixtureState, seen: SlideSeen) -> tuple[FixtureState, Verdict]:
        place = state.pose.inverse().apply(seen.point)
        if not (self.fixture.holds(place) and np.isfinite(self.fixture.height(place)[1]).all()):
            return state, Verdict.REFUSED
        if not self._is_blind(state, seen):
            # The pose is seen, and better than by forces that soft tissue turns, or a sensor that is mounted aslant.
            if not self._fits(state, seen):
                return state, Verdict.REFUSED
            change, covariance = self._gained(state, seen, [FRICTION])
            return replace(state, friction=state.friction + change[FRICTION], covariance=covariance), Verdict.RUBBED
        state = self._predict(state, seen.time)
        innovation, derivative, noise = self._innovation(state, seen)
        off = self._distance(innovation, derivative @ state.covariance @ derivative.T + noise) / len(innovation)
        strange = state.strange if seen.time - state.slide_time <= self.settings.agreeing_within else 1.0
        strange += (min(off, STRANGEST) - strange) / SLIDES
        state = replace(state, strange=strange, slide_time=seen.time, felt=place)
        if strange > self._gates[2 * SLIDES] / (2 * SLIDES):
            return self._reopen(state, place), Verdict.REOPENED
        if not self._fits(state, seen):
            return state, Verdict.REFUSED
        change, covariance = self._gained(state, seen, [*range(6), FRICTION])  # they know nothing of images
        pose, friction = state.pose @ Pose.exp(change[POSE]), state.friction + change[FRICTION]
        return replace(state, pose=pose, friction=friction, covariance=covariance), Verdict.USED

    def _is_blind(self, state: FixtureState, seen: Seen) -> bool:
        return seen.time - state.image_time > self.settings.blind

    def _innovation(self, state: FixtureState, seen: Seen) -> tuple[Array, Array, Array]:
        """Innovation (m,), its derivative by the state (m, 13), and the noise (m, m)."""
        if isinstance(seen, ImageSeen):
            innovation = (state.pose.inverse() @ seen.pose).log() - state.bias
            return innovation, np.hstack([np.eye(6), np.eye(6), np.zeros((6, 1))]), seen.covariance
        point = state.pose.inverse().apply(seen.point)
        if isinstance(seen, SlideSeen):
            return self._slope(state, seen, point)
        height, normal = self.fixture.height(point)
        derivative = np.concatenate([height_derivative(normal, point), np.zeros(STATES - 6)])[None, :]
        noise = seen.deviation**2 + bend(self.fixture, point, state.pose_covariance)
        return np.array([-height]), derivative, np.array([[noise]])

    def _slope(self, state: FixtureState, seen: SlideSeen, point: Array) -> tuple[Array, Array, Array]:
        """The same of a slide at a point in the fixture's frame: by how much the normal is turned, either way."""
        normal, turned, bent = turning(self.fixture, point, state.pose_covariance)
        felt, rubbed = (state.pose.rotation.T @ one for one in seen.normal(state.friction))
        derivative = np.zeros((3, STATES))
        derivative[:, POSE], derivative[:, FRICTION] = turned, -rubbed
        across = np.linalg.svd(normal[None, :])[2][1:]  # two directions along the surface
        return across @ (felt - normal), across @ derivative, (seen.deviation**2 + bent) * np.eye(2)

    def _fits(self, state: FixtureState, seen: Seen) -> bool:
        innovation, derivative, noise = self._innovation(state, seen)
        if not isinstance(seen, ImageSeen) and not self.fixture.holds(state.pose.inverse().apply(seen.point)):
            return False
        return self._within(innovation, derivative @ state.covariance @ derivative.T + noise)

    def _distance(self, innovation: Array, spread: Array) -> float:
        """Square of the Mahalanobis distance."""
        return float(innovation @ np.linalg.solve(spread, innovation))

    def _within(self, innovation: Array, spread: Array) -> bool:
        return self._distance(innovation, spread) <= self._gates[len(innovation)]

    def _agree(self, state: FixtureState, one: Seen, other: Seen) -> bool:
        if type(one) is not type(other):
            return False
        first, _, noise = self._innovation(state, one)
        second, _, more = self._innovation(state, other)
        return self._within(first - second, noise + more)

    def _correct(self, state: FixtureState, seen: Seen) -> FixtureState:
        change, covariance = self._gained(state, seen)
        pose, bias, friction = state.pose @ Pose.exp(change[POSE]), state.bias + change[BIAS], change[FRICTION]
        friction += state.friction
        state = replace(state, pose=pose, bias=bias, friction=friction, covariance=covariance, refused=())
        if isinstance(seen, ImageSeen):
            return replace(state, image_time=seen.time, strange=1.0)
        return replace(state, contact_time=seen.time)

    def _gained(self, state: FixtureState, seen: Seen, learnt: Sequence[int] = range(STATES)) -> tuple[Array, Array]:
        """What is learnt of some unknowns: the change of all (13,), and their covariance then."""
        innovation, derivative, noise = self._innovation(state, seen)
        covariance, gain = state.covariance, np.zeros((STATES, len(innovation)))
        spread = derivative @ covariance @ derivative.T + noise
        gain[list(learnt)] = np.linalg.solve(spread, derivative @ covariance).T[list(learnt)]
        rest = np.eye(STATES) - gain @ derivative
        return gain @ innovation, _bounded(rest @ covariance @ rest.T + gain @ noise @ gain.T)

    def _reopen(self, state: FixtureState, felt: Array | None = None) -> FixtureState:
        """Open the pose by its uncertainty at the start; measurements that agree are then taken in, oldest first.

        Where it is felt that a slope is another, at a place in the fixture's frame [m], it is opened by a bump's, and
        what was refused waits on.
        """
        s, covariance = self.settings, state.covariance.copy()
        if felt is not None:
            covariance[POSE, POSE] += _about(felt, _variances(s.bump_position, s.bump_angle))
            return replace(state, covariance=_bounded(covariance), strange=1.0)
        covariance[POSE, POSE] += np.diag(_variances(s.start_position, s.start_angle))
        refused, state = state.refused, replace(state, covariance=_bounded(covariance), refused=())
        for seen in refused:
            if self._fits(state, seen):
                state = self._correct(state, seen)
        return state
