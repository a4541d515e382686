"""MuJoCo, imported when it is first used and whatever the environment says of drawing, and the simulated arm for it.

The arm is an MJCF text with its dimensions as plain numbers.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from foretouch.errors import MissingExtraError, SettingError
from foretouch.errors.checks import require, require_fields
from foretouch.robot.robot import RobotSpecification

CHOICE, NOTHING = "MUJOCO_GL", "disable"  # The variable that names what draws, and its value for nothing


def load_mujoco() -> Any:
    """The module mujoco.

    It ends its own import where ``MUJOCO_GL`` names a library that is not there. A robot draws nothing, and a camera
    makes its own context with what there is, so during the import the variable says so.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    chosen = os.environ.get(CHOICE)
    os.environ[CHOICE] = NOTHING
    try:
        import mujoco
    except ImportError as error:
        raise MissingExtraError("mujoco", "sim") from error
    finally:
        if chosen is None:
            del os.environ[CHOICE]
        else:
            os.environ[CHOICE] = chosen
    return mujoco


def write_no_log() -> None:
    """Let MuJoCo print its warnings and write none of them to a MUJOCO_LOG.TXT in the folder that one stands in.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """
    config = load_mujoco().MjLogConfig.get()
    config.logto_file = False
    config.set()


ROD_LENGTH = 0.16
"""Distance from the force sensor to the tip [m]."""

ROD_RADIUS = 0.004
"""Radius of the probe's rod [m]."""

TIP_RADIUS = 0.006
"""Radius of the ball at the probe's tip [m]."""


class Tip(NamedTuple):
    """The ball at the end of a probe as it is drawn, in any unit of length.

    Attributes:
        radius: Of the ball.
        centre: Height of its centre above the probe's position.
    """

    radius: float
    centre: float

    @classmethod
    def of(cls, radius: float, drawn: float) -> Tip:
        """A sphere about its position; a point, of radius 0, is drawn as a ball of another radius that ends in it."""
        return cls(radius, 0.0) if radius > 0.0 else cls(drawn, drawn)


REMOTE_CENTRE_HEIGHT = 0.08
"""Remote centre of motion above the tip at position 0 [m]; the two rotations turn about this point."""

CARRIAGE_MASS = 0.3  # Mass that the insertion joint moves before the force sensor [kg]
TOOL_MASS = 0.1  # Mass beyond the force sensor: rod and tip [kg]
GRAVITY = 9.81  # Gravity along the approach, which points straight down [m/s^2]


MOVED_MASS = CARRIAGE_MASS + TOOL_MASS  # Mass that a drive moves [kg]
RAIL_DAMPING = 1.0  # Damping of a driven joint [N s/m]

LARGEST_CONTACT_FORCE = 1000.0
"""Bound to which a contact force is cut, so that the physics stay finite [N]."""


def bounded_force(force: tuple[float, float, float]) -> tuple[float, float, float]:
    """A contact force [N] within `LARGEST_CONTACT_FORCE`, and none for one that is no number."""
    size = math.hypot(*force)
    if size <= LARGEST_CONTACT_FORCE:
        return force
    scale = LARGEST_CONTACT_FORCE / size if math.isfinite(size) else 0.0
    return (force[0] * scale, force[1] * scale, force[2] * scale) if scale else (0.0, 0.0, 0.0)


OFFSET_UNCERTAINTY = 0.2  # Part of the force sensor's largest offset beyond its mean one, ten times its noise [N]

LONGEST_STEP, NOISE_BLOCK = 6e-4, 4096


@dataclass(frozen=True, slots=True)
class ArmSettings:
    """Settings that the simulated arms share.

    Args:
        sample_period: [s].
        substeps: Physics steps in a sample period.
        force_limit: Force that a drive can hold at most [N].
        encoder_resolution: [m]; 0 does not round.
        encoder_noise: Standard deviation before rounding [m].
        sensor_noise: Standard deviation of the force, on each axis [N].
        sensor_bandwidth: Cut-off of the sensors' low-pass [Hz].

    Raises:
        SettingError: A setting out of range.
    """

    sample_period: float = 1e-3
    substeps: int = 2
    force_limit: float = 15.0
    encoder_resolution: float = 5e-6
    encoder_noise: float = 2e-6
    sensor_noise: float = 0.02
    sensor_bandwidth: float = 200.0

    def __post_init__(self) -> None:
        require("sample_period", self.sample_period, above=0.0, at_most=0.01)
        require("substeps", self.substeps, at_least=1)
        require_fields(self, "force_limit", "sensor_bandwidth", above=0.0)
        require_fields(self, "encoder_resolution", "encoder_noise", "sensor_noise", at_least=0.0)
        if self.step > LONGEST_STEP:
            message = "the physics step (sample_period / substeps) is at most 0.6 ms"
            raise SettingError("substeps", self.substeps, message)

    @property
    def step(self) -> float:
        """Length of a physics step [s]."""
        return self.sample_period / int(self.substeps)

    def specification(self, **others: Any) -> RobotSpecification:
        """Specification of an arm with these settings and its own fields."""
        return RobotSpecification(
            sample_period=self.sample_period,
            force_limit=self.force_limit,
            encoder_resolution=self.encoder_resolution,
            encoder_noise=self.encoder_noise,
            sensor_noise=self.sensor_noise,
            sensor_bandwidth=self.sensor_bandwidth,
            simulated=True,
            moved_mass=MOVED_MASS,
            **others,
        )


def normal_draws(seed: int) -> Iterator[float]:
    """Standard normal numbers for the noise of the sensors, drawn in blocks."""
    random = np.random.default_rng(seed)
    while True:
        yield from random.standard_normal(NOISE_BLOCK)[::-1].tolist()


def arm_scene(surface: float, timestep: float) -> str:
    """MJCF of the arm above a block of material.

    World frame: z up, the tip at position 0 is the origin, the approach points down. Two hinges cross in the remote
    centre; a slide carries the tool along the rod. The tool is a body of its own, welded to the carriage, so that
    the force sensor between them feels its weight and inertia. No geometry collides: the material's force comes from
    its law and is applied to the tool from outside.

    Args:
        surface: Position of the undeformed surface [m].
        timestep: Physics step [s].
    """
    hub = ROD_LENGTH - REMOTE_CENTRE_HEIGHT
    return f"""
<mujoco model="foretouch remote-centre-of-motion arm">
  <compiler angle="radian" autolimits="true" inertiafromgeom="false"/>
  <option timestep="{timestep}" gravity="0 0 {-GRAVITY}" integrator="implicitfast">
    <flag contact="disable" constraint="disable"/>
  </option>
  <visual><headlight ambient="0.4 0.4 0.4"/></visual>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <light pos="0.3 -0.3 0.6" dir="-0.4 0.4 -0.8"/>
    <geom name="block" type="box" size="0.05 0.05 0.02" pos="0 0 {-surface - 0.02}" rgba="0.95 0.75 0.45 1"/>
    <geom name="post" type="capsule" size="0.012" fromto="-0.12 0 0 -0.12 0 0.30" rgba="0.35 0.37 0.40 1"/>
    <body name="yaw_link" pos="0 0 {REMOTE_CENTRE_HEIGHT}">
      <joint name="yaw" type="hinge" axis="1 0 0" damping="0.5"/>
      <inertial pos="0 0 {hub + 0.05}" mass="0.6" diaginertia="0.004 0.004 0.001"/>
      <geom type="capsule" size="0.008" fromto="-0.12 0 {hub + 0.10} 0 0 {hub + 0.10}" rgba="0.55 0.57 0.60 1"/>
      <body name="pitch_link">
        <joint name="pitch" type="hinge" axis="0 1 0" damping="0.5"/>
        <inertial pos="0 0 {hub + 0.05}" mass="0.4" diaginertia="0.003 0.003 0.001"/>
        <geom type="box" size="0.015 0.015 0.06" pos="-0.02 0 {hub + 0.05}" rgba="0.55 0.57 0.60 1"/>
        <body name="carriage" pos="0 0 {hub}">
          <joint name="insertion" type="slide" axis="0 0 -1" damping="1.0"/>
          <inertial pos="0 0 0.01" mass="{CARRIAGE_MASS}" diaginertia="1e-4 1e-4 1e-4"/>
          <geom type="box" size="0.012 0.012 0.012" pos="0 0 0.012" rgba="0.20 0.45 0.75 1"/>
          <body name="tool">
            <inertial pos="0 0 {-ROD_LENGTH / 2}" mass="{TOOL_MASS}" diaginertia="2e-4 2e-4 1e-6"/>
            <geom type="capsule" size="{ROD_RADIUS}" fromto="0 0 0 0 0 {-ROD_LENGTH}" rgba="0.80 0.82 0.85 1"/>
            <geom type="sphere" size="{TIP_RADIUS}" pos="0 0 {TIP_RADIUS - ROD_LENGTH}" rgba="0.85 0.25 0.20 1"/>
            <site name="sensor" pos="0 0 0"/>
            <site name="tip" pos="0 0 {-ROD_LENGTH}"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position name="yaw" joint="yaw" kp="200" kv="6"/>
    <position name="pitch" joint="pitch" kp="200" kv="6"/>
    <motor name="insertion" joint="insertion"/>
  </actuator>
  <sensor><force name="force" site="sensor"/></sensor>
</mujoco>
"""
