"""The simulated remote world: a fixture that stands elsewhere than believed and is bumped, and what it is made of."""

from __future__ import annotations

import math

import numpy as np

from foretouch.devices.device import minimum_jerk
from foretouch.errors import SettingError
from foretouch.quantities import Pose
from foretouch.quantities.pose import RigidMotion, Vector, add, dot, norm, scaled, subtract
from foretouch.rendering.surfaces import SurfaceProxy
from foretouch.robot import Material
from foretouch.session.spatial.scenes import Scene

__all__ = ["SpatialWorld"]

BUMP_TIME = 0.15
"""A bump moves the fixture in so long [s]."""

BUMP_SHARE = 0.4
"""Of the first displacement, at most."""

STICTION_SPEED = 1e-3
"""Friction grows to its full size up to this speed [m/s]."""

SECOND_LAW = "remembers what was done to it, and in a scene each place would need a memory of its own"


class SpatialWorld:
    r"""What the probe touches, asked at every physics step.

    .. math:: F = s(p)\, f(d, \dot d)\, n - (\mu f_n \tanh(|v_t| / v_0) + c |v_t|)\, \hat v_t

    f is the material's law at the depth of the god object, s the inclusion's factor, v_0 = 1 mm/s.

    Args:
        scene: Shape, inclusion and friction.
        material: Whose law is pressed; one without memory.
        displacement: The fixture stands at most so far from where it is believed [m].
        turn: And is turned by at most so much [rad].
        bump: When it is bumped, to somewhere within 40 % of that [s]; 0 for never.
        seed: Of where it stands, not negative.

    Attributes:
        time: Since the start [s].
        depth: Of the probe [m].

    Raises:
        SettingError: A material with a memory.
    """

    def __init__(
        self, scene: Scene, material: Material, *, displacement: float, turn: float, bump: float, seed: int
    ) -> None:
        if material.model.initial_state():
            raise SettingError("material", material.name, f"{SECOND_LAW}: take hunt-crossley or kelvin-voigt")
        self._scene, self._material = scene, material
        random = np.random.default_rng([seed, 7])
        nominal = Pose.from_rotation_vector(scene.nominal[3:], scene.nominal[:3])
        first = nominal @ _displaced(random, displacement, turn)
        second = first @ _displaced(random, BUMP_SHARE * displacement, BUMP_SHARE * turn)
        self._poses = _numbers(first), _numbers(second)
        self._bump = bump if bump > 0.0 else math.inf
        self._proxy = SurfaceProxy(scene.surface)
        self._pose = self._poses[0]
        self._motion = RigidMotion.from_numbers(self._pose)
        self._depth_before = math.nan
        self._state = material.model.initial_state()
        self.time = 0.0
        self.depth = -math.inf

    def fixture(self) -> tuple[float, ...]:
        """Where the fixture is now: a place [m] and a rotation vector [rad]."""
        return self._pose

    def touch(self, place: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Contact force on the probe [N]; see `foretouch.robot.TouchedWorld`."""
        self.time += elapsed
        self._move_fixture()
        motion = self._motion
        contact = self._proxy.follow(motion.apply_back(place))
        self.depth = contact.depth
        if contact.depth <= 0.0:
            return (0.0, 0.0, 0.0)
        normal = motion.rotate(contact.normal)
        inwards = -dot(velocity, normal)
        self._state, pressed, _ = self._material.model.advance(self._state, contact.depth, inwards, elapsed)
        if self._scene.inclusion is not None:
            pressed *= self._scene.inclusion.factor(contact.point)
        sliding = add(velocity, scaled(normal, inwards))
        speed = norm(sliding)
        if not speed > 0.0:
            return scaled(normal, pressed)
        rub = self._scene.friction * pressed * math.tanh(speed / STICTION_SPEED) + self._scene.viscous * speed
        return subtract(scaled(normal, pressed), scaled(sliding, rub / speed))

    def _move_fixture(self) -> None:
        share = minimum_jerk((self.time - self._bump) / BUMP_TIME)
        if share <= 0.0 or self._pose == self._poses[1]:
            return
        first, second = self._poses
        self._pose = second if share >= 1.0 else tuple(a + share * (b - a) for a, b in zip(first, second, strict=True))
        self._motion = RigidMotion.from_numbers(self._pose)


def _displaced(random: np.random.Generator, displacement: float, turn: float) -> Pose:
    """A pose within these of none at all: anywhere between half and all of them, in any direction."""
    way, axis = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    far, angle = random.uniform(0.5, 1.0, 2) * (displacement, turn)
    return Pose.from_rotation_vector(axis * angle, way * far)


def _numbers(pose: Pose) -> tuple[float, ...]:
    return (*pose.translation.tolist(), *pose.rotation_vector().tolist())
