"""A simulated arm that moves its probe in three dimensions, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from foretouch.errors.checks import require
from foretouch.robot.engine import CARRIAGE_MASS, GRAVITY, ROD_LENGTH, ROD_RADIUS, TIP_RADIUS, TOOL_MASS, load_mujoco
from foretouch.robot.insertion_servo import InsertionServo
from foretouch.robot.robot import RobotSpecification, SpatialRobot, SpatialSample, Vector

MOVED_MASS = CARRIAGE_MASS + TOOL_MASS
RAIL_DAMPING = 1.0
"""Damping of each joint [N s/m]."""

LEAST_STEPS = 2
"""Smallest number of physics steps in a sample period: of 1 ms they are 0.5 ms long."""

LARGEST_FORCE = 1000.0
"""Bound to which a contact force that is more, or no number, is cut, so that the physics stay finite [N]."""

NOISE_BLOCK = 4096
OFFSET_UNCERTAINTY = 0.2
AXES = range(3)
WAYS = (1.0, 1.0, -1.0)
"""Direction of each axis in which its servo counts: the third goes in as it goes down."""

TouchedWorld = Callable[[Vector, Vector, float], Vector]
"""What is touched: place [m] and velocity [m/s] of the tip and the time since the call before [s] to the contact force
on the probe [N]."""


class GantryArm(SpatialRobot):
    """Three slides that stand on each other, each driven by an `InsertionServo`, with the tool below the third.

    The contact force comes from what is touched, asked at every physics step with the tip's exact place and velocity,
    and is applied to the tool from outside; native contact is off. The force sensor stands between carriage and tool.
    Its chain is that of `RcmArm`, one for each axis: interaction force, first-order low-pass, offset, noise. What it
    gives out is the contact force with the offset: the tool's weight and inertia are taken out by the accelerometer
    beside it, as the follower along a line does for itself.

    Same seed, same commands: same samples, bit for bit.

    Args:
        world: Gives the contact force.
        fixture: Gives the true pose of what is touched (a position [m] and a rotation vector [rad]) for scores
            and drawings; None where there is none.
        seed: Seed of sensor and encoder noise, not negative.
        start: Position of the tip at first [m].
        reach: Lowest and highest position [m].
        sample_period: [s].
        substeps: Physics steps in a sample period: what is touched acts through a whole one, so that a damping of b
            needs more than b T / (2 m) of them, or a contact swings up by itself.
        force_limit: Force that each drive can hold at most [N].
        encoder_resolution: [m]; 0 does not round.
        encoder_noise: Standard deviation before rounding [m].
        sensor_noise: Standard deviation of each axis [N].
        sensor_bandwidth: Cut-off of the low-pass [Hz].
        sensor_offset: What the sensor shows with nothing on it [N].

    Raises:
        SettingError: A setting out of range.
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(
        self,
        world: TouchedWorld,
        fixture: Callable[[], tuple[float, ...]] | None = None,
        *,
        seed: int,
        start: Vector = (0.0, 0.0, 0.05),
        reach: tuple[Vector, Vector] = ((-0.15, -0.15, -0.08), (0.15, 0.15, 0.12)),
        sample_period: float = 1e-3,
        substeps: int = LEAST_STEPS,
        force_limit: float = 15.0,
        encoder_resolution: float = 5e-6,
        encoder_noise: float = 2e-6,
        sensor_noise: float = 0.02,
        sensor_bandwidth: float = 200.0,
        sensor_offset: Vector = (0.1, -0.15, 0.3),
    ) -> None:
        require("seed", seed, at_least=0)
        require("sample_period", sample_period, above=0.0, at_most=1.2e-3)
        require("substeps", substeps, at_least=LEAST_STEPS)
        require("force_limit", force_limit, above=0.0)
        for name, value in (("resolution", encoder_resolution), ("noise", encoder_noise), ("sensor", sensor_noise)):
            require(name, value, at_least=0.0)
        require("sensor_bandwidth", sensor_bandwidth, above=0.0)
        self._world, self._fixture = world, fixture
        self.reach = reach
        self._steps = range(substeps)
        self._h = sample_period / substeps
        self._low_pass = -math.expm1(-2.0 * math.pi * sensor_bandwidth * self._h)
        self._offset = sensor_offset
        self._resolution, self._encoder_noise, self._sensor_noise = encoder_resolution, encoder_noise, sensor_noise
        self._random = np.random.default_rng(seed)
        self._noise: list[float] = []
        self.specification = RobotSpecification(
            sample_period=sample_period,
            force_limit=force_limit,
            encoder_resolution=encoder_resolution,
            encoder_noise=encoder_noise,
            tool_mass=0.0,
            gravity=0.0,
            sensor_noise=sensor_noise,
            accelerometer_noise=0.0,
            sensor_bandwidth=sensor_bandwidth,
            workspace=(-1.0, 1.0),
            simulated=True,
            moved_mass=MOVED_MASS,
            sensor_range=200.0,
            largest_offset=math.hypot(*sensor_offset) + OFFSET_UNCERTAINTY,
        )
        self._build(start)

    def _build(self, start: Vector) -> None:
        mujoco = load_mujoco()
        self._model: Any = mujoco.MjModel.from_xml_string(gantry_scene(self._h))
        self._data: Any = mujoco.MjData(self._model)
        self._data.qpos[:] = start
        mujoco.mj_forward(self._model, self._data)
        self._mj_step = mujoco.mj_step
        self._applied = self._data.xfrc_applied[self._model.body("tool").id][:3]
        self._interaction = self._data.sensordata[:3]
        self._servos = [
            InsertionServo(
                mass=MOVED_MASS,
                damping=RAIL_DAMPING,
                force_limit=self.specification.force_limit,
                sample_period=self.specification.sample_period,
                position=WAYS[axis] * start[axis],
            )
            for axis in AXES
        ]
        self._desired = start
        self._place: list[float] = list(start)
        self._velocity = [0.0, 0.0, 0.0]
        self._contact: Vector = (0.0, 0.0, 0.0)
        self._sensor = [0.0, 0.0, 0.0]  # the low-pass of the contact force, as the compensated sensor shows it
        self._tool = [0.0, 0.0, TOOL_MASS * GRAVITY]
        self._raw = list(self._tool)
        self._sample = self._measure()

    def read(self) -> SpatialSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._sample

    def exchange(self, desired: Vector) -> SpatialSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `SpatialRobot`."""
        if len(desired) == 3 and all(map(math.isfinite, desired)):
            low, high = self.reach
            x, y, z = (min(max(value, a), b) for value, a, b in zip(desired, low, high, strict=True))
            self._desired = (x, y, z)
        for servo, way, wanted in zip(self._servos, WAYS, self._desired, strict=True):
            servo.command(way * wanted)
        h, data = self._h, self._data
        place, velocity = self._place, self._velocity
        for _ in self._steps:
            for axis in AXES:
                # A servo counts inwards, against the force that it meets; the third one moves in downwards.
                way = WAYS[axis]
                effort = self._servos[axis].effort(
                    way * place[axis], way * velocity[axis], -way * self._sensor[axis], h
                )
                effort = max(effort, -self.specification.force_limit)
                data.ctrl[axis] = way * effort + (MOVED_MASS * GRAVITY if axis == 2 else 0.0)
            self._applied[:] = self._contact
            self._mj_step(self._model, data)
            before = tuple(velocity)
            self._place = place = data.qpos.tolist()
            self._velocity = velocity = data.qvel.tolist()
            for axis in AXES:
                weight = GRAVITY if axis == 2 else 0.0
                tool = TOOL_MASS * ((velocity[axis] - before[axis]) / h + weight)
                self._tool[axis] += self._low_pass * (tool - self._tool[axis])
                # MuJoCo gives what the tool's weight, inertia and contact need from the carriage
                self._raw[axis] += self._low_pass * (float(self._interaction[axis]) - self._raw[axis])
                self._sensor[axis] = self._tool[axis] - self._raw[axis]
            self._touch(h)
        self._sample = self._measure()
        return self._sample

    def _touch(self, h: float) -> None:
        x, y, z = self._place
        force = self._world((x, y, z), (self._velocity[0], self._velocity[1], self._velocity[2]), h)
        size = math.hypot(*force)
        if not size <= LARGEST_FORCE:
            scale = LARGEST_FORCE / size if math.isfinite(size) else 0.0
            force = (force[0] * scale, force[1] * scale, force[2] * scale) if scale else (0.0, 0.0, 0.0)
        self._contact = force

    def _measure(self) -> SpatialSample:
        x, y, z = self._place
        a, b, c = (self._counted(value) for value in (x, y, z))
        noise = self._sensor_noise
        f, g, h = (self._sensor[axis] + self._offset[axis] + noise * self._draw() for axis in AXES)
        return SpatialSample(
            (a, b, c),
            (f, g, h),
            self._contact,
            (x, y, z),
            () if self._fixture is None else self._fixture(),
            any(servo.clipped for servo in self._servos),
        )

    def _counted(self, value: float) -> float:
        measured = value + self._encoder_noise * self._draw()
        return round(measured / self._resolution) * self._resolution if self._resolution > 0.0 else measured

    def _draw(self) -> float:
        if not self._noise:
            self._noise = self._random.standard_normal(NOISE_BLOCK).tolist()
        return self._noise.pop()


def gantry_scene(timestep: float) -> str:
    """MJCF of the three slides; the tip is at the joints' positions.

    Args:
        timestep: Physics step [s].
    """
    return f"""
<mujoco model="foretouch gantry">
  <compiler autolimits="true" inertiafromgeom="false"/>
  <option timestep="{timestep}" gravity="0 0 {-GRAVITY}" integrator="implicitfast">
    <flag contact="disable" constraint="disable"/>
  </option>
  <default><geom contype="0" conaffinity="0"/></default>
  <worldbody>
    <body name="carriage">
      <joint name="x" type="slide" axis="1 0 0" damping="{RAIL_DAMPING}"/>
      <joint name="y" type="slide" axis="0 1 0" damping="{RAIL_DAMPING}"/>
      <joint name="z" type="slide" axis="0 0 1" damping="{RAIL_DAMPING}"/>
      <inertial pos="0 0 {ROD_LENGTH}" mass="{CARRIAGE_MASS}" diaginertia="1e-4 1e-4 1e-4"/>
      <geom type="box" size="0.012 0.012 0.012" pos="0 0 {ROD_LENGTH + 0.012}"/>
      <body name="tool" pos="0 0 {ROD_LENGTH}">
        <inertial pos="0 0 {-ROD_LENGTH / 2}" mass="{TOOL_MASS}" diaginertia="2e-4 2e-4 1e-6"/>
        <geom type="capsule" size="{ROD_RADIUS}" fromto="0 0 0 0 0 {-ROD_LENGTH}"/>
        <geom type="sphere" size="{TIP_RADIUS}" pos="0 0 {TIP_RADIUS - ROD_LENGTH}"/>
        <site name="sensor" pos="0 0 0"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor joint="x"/><motor joint="y"/><motor joint="z"/></actuator>
  <sensor><force name="force" site="sensor"/></sensor>
</mujoco>
"""
