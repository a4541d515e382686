"""Robot, camera and operator of a session in three dimensions, and the simulated world of the robot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, cast

import numpy as np

from foretouch.devices import (
    GRIPS,
    INTENDED_FORCE,
    OPERATORS,
    UNKNOWN_REACH,
    PalpatingOperator,
    RecordedPalpatingOperator,
    SpatialBrowserOperator,
    SpatialDevice,
)
from foretouch.devices.device import minimum_jerk
from foretouch.devices.recorded import KNOT_PERIOD
from foretouch.errors import MissingExtraError, SettingError
from foretouch.quantities import Pose
from foretouch.quantities.pose import RigidMotion, Vector, add, dot, scaled, subtract
from foretouch.rendering.surfaces import SurfaceProxy
from foretouch.robot import ArticulatedArm, GantryArm, Material, SpatialRobot, make_material
from foretouch.robot.engine import MOVED_MASS
from foretouch.robot.gantry_arm import LEAST_STEPS
from foretouch.session.operators import (
    foreign_operator,
    foreign_robot,
    mounted_operator,
    mounted_robot,
    recorded_operator,
    say_on_stderr,
)
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.camera import SimulatedCamera
from foretouch.session.spatial.scenes import HOVER, Scene, palpation, recorded_palpation
from foretouch.session.steps.sensing import calibrated_arm
from foretouch.settings import NO_GRIP, SIMULATED, is_simulated

BUMP_TIME = 0.15  # Duration of a bump of the fixture [s]
BUMP_SHARE = 0.4  # Largest bump as a fraction of the first displacement


class SpatialWorld:
    r"""The world that the probe touches, evaluated at every physics step.

    .. math:: F = s(p)\, f(d, \dot d)\, n + f_t

    f is the material's law at the depth of the god object, s the inclusion's factor where the probe is: the god object
    leaps from facet to facet of a mesh, under a deep probe by 0.3 mm, and a force leaps on no material. f_t is the
    friction of a `foretouch.models.BristleFriction`. A sphere is given by its centre; its depth is that of its deepest
    point, and the factor is that there, so that it turns with the normal from facet to facet. The law is of depth
    alone, whatever the radius, and the force acts on the centre: there is no torque.
    A law that remembers has one memory, of the contact: it goes along where the probe slides, and fades in free air as
    along a line.

    Args:
        scene: Shape, inclusion and friction.
        material: Material whose law is pressed.
        displacement: Largest displacement of the fixture from its believed position [m].
        turn: Largest rotation of the fixture from its believed one [rad].
        bump: Time of a bump, to somewhere within 40 % of that [s]; 0 for never.
        seed: Random seed of its pose, not negative.
    """

    def __init__(
        self, scene: Scene, material: Material, *, displacement: float, turn: float, bump: float, seed: int
    ) -> None:
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
        self._state = material.model.initial_state()
        self._bend: Vector = (0.0, 0.0, 0.0)  # of the friction's bristles, along the surface [m]
        self.time = 0.0
        self.depth = -math.inf

    def fixture(self) -> tuple[float, ...]:
        """Present pose of the fixture: a position [m] and a rotation vector [rad]."""
        return self._pose

    def touch(self, place: Vector, velocity: Vector, elapsed: float) -> Vector:
        """Contact force on the probe [N]; see `foretouch.robot.TouchedWorld`."""
        self.time += elapsed
        self._move_fixture()
        motion = self._motion
        within = motion.apply_back(place)
        contact = self._proxy.follow(within)
        self.depth = contact.depth
        if contact.depth <= 0.0 and not self._state:
            self._bend = (0.0, 0.0, 0.0)
            return (0.0, 0.0, 0.0)
        normal = motion.rotate(contact.normal)
        inwards = -dot(velocity, normal)
        self._state, pressed, _ = self._material.model.advance(self._state, contact.depth, inwards, elapsed)
        if contact.depth <= 0.0 and not (self._material.pulls and pressed < 0.0):
            self._bend = (0.0, 0.0, 0.0)
            return (0.0, 0.0, 0.0)
        if self._scene.inclusion is not None:
            deepest = subtract(within, scaled(contact.normal, self._scene.surface.radius))
            pressed *= self._scene.inclusion.factor(deepest)
        bend = subtract(self._bend, scaled(normal, dot(self._bend, normal)))
        sliding = add(velocity, scaled(normal, inwards))
        self._bend, rub = self._scene.friction.advance(bend, sliding, pressed, elapsed)
        return add(scaled(normal, pressed), rub)

    def _move_fixture(self) -> None:
        fraction = minimum_jerk((self.time - self._bump) / BUMP_TIME)
        if fraction <= 0.0 or self._pose == self._poses[1]:
            return
        first, second = self._poses
        self._pose = (
            second if fraction >= 1.0 else tuple(a + fraction * (b - a) for a, b in zip(first, second, strict=True))
        )
        self._motion = RigidMotion.from_numbers(self._pose)


def _displaced(random: np.random.Generator, displacement: float, turn: float) -> Pose:
    """A random displacement: between half and all of these amounts, in any direction."""
    way, axis = (vector / np.linalg.norm(vector) for vector in random.normal(size=(2, 3)))
    far, angle = random.uniform(0.5, 1.0, 2) * (displacement, turn)
    return Pose.from_rotation_vector(axis * angle, way * far)


def _numbers(pose: Pose) -> tuple[float, ...]:
    return (*pose.translation.tolist(), *pose.rotation_vector().tolist())


PRESS_DEPTH = 0.005  # Press depth of a palpating hand [m]

STOPPED_AT_MOST = 0.7
"""Largest fraction of the probe's speed that a damper may take in one physics step: with 1 it stops, with 2 it swings
up."""


def make_spatial_robot(settings: SessionSettings, scene: Scene, *, force_limit: float = 15.0) -> SpatialRobot:
    """The robot of the settings: another package's, or the simulated arm over a fixture that is not where believed.

    The arm counts as the settings' follower frame says; another package's is translated by the session.

    Raises:
        SettingError: A material in which the safety's bound on an impact is known not to hold; a robot of one axis.
        UnknownNameError: No such robot or material.
        PluginError: Another package's robot, which cannot be made.
    """
    if not is_simulated(settings.robot):
        return cast("SpatialRobot", foreign_robot(settings))
    material = make_material(settings.material)
    world = SpatialWorld(
        scene, material, displacement=settings.displacement, turn=settings.turn, bump=settings.bump, seed=settings.seed
    )
    stiffness, damping = _hardest(settings, scene, material)
    for name, unit, most in (("stiffest", "N/m", stiffness), ("most_damped", "N s/m", damping)):
        if getattr(settings, name) < 0.99 * most:
            rule = f"must be at least {most:.4g} {unit}, which {material.name} has somewhere in the scene {scene.name}"
            raise SettingError(name, getattr(settings, name), rule)
    steps = max(LEAST_STEPS, math.ceil(damping * SAMPLE_PERIOD / (STOPPED_AT_MOST * MOVED_MASS)))
    options: Any = {"seed": settings.seed, "substeps": steps, "force_limit": force_limit}
    arm: SpatialRobot
    if settings.robot == SIMULATED:
        arm = GantryArm(world.touch, world.fixture, **options)
    else:
        arm = ArticulatedArm(calibrated_arm(settings), world.touch, world.fixture, **options)
    return cast("SpatialRobot", mounted_robot(settings, arm))


def _hardest(settings: SessionSettings, scene: Scene, material: Material) -> tuple[float, float]:
    """Largest stiffness [N/m] and damping [N s/m] anywhere in the scene, untouched, up to the force ceiling."""
    fresh = material.model.initial_state()
    ratio = 1.0 if scene.inclusion is None else scene.inclusion.ratio
    step, speed = 1e-5, settings.largest_speed

    def force(depth: float, inwards: float) -> float:
        return ratio * material.model.advance(fresh, depth, inwards, SAMPLE_PERIOD)[1]

    stiffness = damping = depth = 0.0
    while depth < settings.largest_depth and force(depth, 0.0) < settings.force_ceiling:
        depth += step
        stiffness = max(stiffness, (force(depth, 0.0) - force(depth - step, 0.0)) / step)
        damping = max(damping, (force(depth, speed) - force(depth, 0.0)) / speed)
    return stiffness, damping


def make_camera(settings: SessionSettings, scene: Scene, *, say: Callable[[str], None]) -> SimulatedCamera | None:
    """The simulated camera; None, said in one line, where nothing here can draw or read its images."""
    faults = (settings.image_fault,) if settings.image_fault else ()
    try:
        return SimulatedCamera(scene, faults, seed=settings.seed)
    except MissingExtraError as error:  # no MuJoCo, no OpenCV, or no library that draws without a display
        say(f"camera: {error}; the session goes on without it")
        return None


def make_spatial_operator(
    settings: SessionSettings, scene: Scene, pose: Sequence[float], say: Callable[[str], None] = say_on_stderr
) -> SpatialDevice:
    """The operator of a session, fresh, shown this pose at first; with a grip, a hand that intends what it does.

    ``recorded`` presses at the places of the script as deep, and as fast, as the measured hand did.

    Raises:
        SettingError: A device of one axis; one that is felt, with a simulated grip.
        UnknownNameError: No such operator.
        PluginError: Another package's device, which cannot be made.
    """
    if settings.operator not in OPERATORS:
        return cast("SpatialDevice", foreign_operator(settings, UNKNOWN_REACH, say))
    depth, scale = PRESS_DEPTH, settings.position_scale
    if settings.grip != NO_GRIP:
        depth += min(INTENDED_FORCE / GRIPS[settings.grip].stiffness, 2.0 * PRESS_DEPTH)
    if settings.operator == "recorded":
        heights = [HOVER - position for position in recorded_operator(HOVER, depth).loop]
        moved: SpatialDevice = RecordedPalpatingOperator(recorded_palpation(scene, heights, KNOT_PERIOD), pose, scale)
    else:
        moved = PalpatingOperator(palpation(scene, depth, settings.seed), pose, scale)
    moved = SpatialBrowserOperator(moved, scale) if settings.operator == "browser" else moved
    return cast("SpatialDevice", mounted_operator(settings, moved))
