"""Robot, camera and operator of a session in three dimensions, as its settings say."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from foretouch.devices import (
    GRIPS,
    INTENDED_FORCE,
    PalpatingOperator,
    SpatialBrowserOperator,
    SpatialDevice,
    SpatialHand,
)
from foretouch.errors import MissingExtraError, SettingError
from foretouch.robot import GantryArm, Material, make_material
from foretouch.robot.gantry_arm import LEAST_STEPS, MOVED_MASS
from foretouch.session.settings import NO_GRIP, SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial.camera import SimulatedCamera
from foretouch.session.spatial.scenes import Scene, palpation
from foretouch.session.spatial.world import SpatialWorld
from foretouch.vision import ImageFault

__all__ = ["make_camera", "make_spatial_operator", "make_spatial_robot"]

PRESS_DEPTH = 0.005
"""Of a palpating hand [m]."""

STOPPED_AT_MOST = 0.7
"""Share of the probe's speed that a damper takes in one physics step: with 1 it stops, and with 2 it swings up."""


def make_spatial_robot(settings: SessionSettings, scene: Scene, *, force_limit: float = 15.0) -> GantryArm:
    """The simulated arm over the scene's fixture, which stands elsewhere than believed.

    Args:
        settings: Of the session.
        scene: What is touched.
        force_limit: Force that each drive can hold at most [N].

    Raises:
        SettingError: A material that remembers, or one in which the safety's bound on an impact is known not to hold.
    """
    material = make_material(settings.material)
    world = SpatialWorld(
        scene,
        material,
        displacement=settings.displacement,
        turn=settings.turn,
        bump=settings.bump,
        seed=settings.seed,
    )
    stiffness, damping = _hardest(settings, scene, material)
    for name, unit, most in (("stiffest", "N/m", stiffness), ("most_damped", "N s/m", damping)):
        if getattr(settings, name) < 0.99 * most:
            rule = f"must be at least {most:.4g} {unit}, which {material.name} has somewhere in the scene {scene.name}"
            raise SettingError(name, getattr(settings, name), rule)
    steps = max(LEAST_STEPS, math.ceil(damping * SAMPLE_PERIOD / (STOPPED_AT_MOST * MOVED_MASS)))
    return GantryArm(world.touch, world.fixture, seed=settings.seed, substeps=steps, force_limit=force_limit)


def _hardest(settings: SessionSettings, scene: Scene, material: Material) -> tuple[float, float]:
    """Largest stiffness [N/m] and damping [N s/m] anywhere in the scene, up to the force ceiling."""
    ratio = 1.0 if scene.inclusion is None else scene.inclusion.ratio
    step, speed = 1e-5, settings.largest_speed

    def force(depth: float, inwards: float) -> float:
        return ratio * material.model.advance((), depth, inwards, SAMPLE_PERIOD)[1]

    stiffness = damping = depth = 0.0
    while depth < settings.largest_depth and force(depth, 0.0) < settings.force_ceiling:
        depth += step
        stiffness = max(stiffness, (force(depth, 0.0) - force(depth - step, 0.0)) / step)
        damping = max(damping, (force(depth, speed) - force(depth, 0.0)) / speed)
    return stiffness, damping


def make_camera(settings: SessionSettings, scene: Scene, *, say: Callable[[str], None]) -> SimulatedCamera | None:
    """The simulated camera; None, said in one line, where nothing here can draw or read its images.

    Args:
        settings: Of the session.
        scene: What is seen.
        say: Told in one line what to install.
    """
    faults = (ImageFault.from_text("image_fault", settings.image_fault),) if settings.image_fault else ()
    try:
        return SimulatedCamera(scene, faults, seed=settings.seed)
    except MissingExtraError as error:  # no MuJoCo, no OpenCV, or no library that draws without a display
        say(f"camera: {error}; the session goes on without it")
        return None


def make_spatial_operator(settings: SessionSettings, scene: Scene, pose: Sequence[float]) -> SpatialDevice:
    """The operator of a session, fresh; with a grip, a hand that intends what that operator does.

    Args:
        settings: Of the session.
        scene: What the operator sees.
        pose: Of the fixture, as the scene shows it at first.
    """
    depth = PRESS_DEPTH
    if settings.grip != NO_GRIP:
        depth += min(INTENDED_FORCE / GRIPS[settings.grip].stiffness, 2.0 * PRESS_DEPTH)
    scale = settings.position_scale
    script = PalpatingOperator(palpation(scene, depth, settings.seed), pose, scale)
    moved: SpatialDevice = SpatialBrowserOperator(script, scale) if settings.operator == "browser" else script
    if settings.grip == NO_GRIP:
        return moved
    return SpatialHand(moved, GRIPS[settings.grip], settings.device, settings.clutch_times)
