"""A simulated arm that moves its probe in three dimensions, in MuJoCo."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from foretouch.errors.checks import require
from foretouch.robot.engine import (
    CARRIAGE_MASS,
    GRAVITY,
    OFFSET_UNCERTAINTY,
    RAIL_DAMPING,
    ROD_LENGTH,
    ROD_RADIUS,
    TIP_RADIUS,
    TOOL_MASS,
    ArmSettings,
    bounded_force,
    load_mujoco,
    normal_draws,
)
from foretouch.robot.robot import SpatialRobot, SpatialSample, Vector

LEAST_STEPS = 2  # Smallest number of physics steps in a sample period: of 1 ms they are 0.5 ms long

TouchedWorld = Callable[[Vector, Vector, float], Vector]
"""What is touched: place [m] and velocity [m/s] of the tip and the time since the call before [s] to the contact force
on the probe [N]."""


class GantryArm(SpatialRobot):
    """Three slides that stand on each other, each driven by a `Servo`, with the tool below the third.

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
        sensor_offset: What the sensor shows with nothing on it [N].
        **options: Settings of `ArmSettings`. What is touched acts through a whole physics step, so that a damping of b
            needs more than b T / (2 m) of them in a sample period, or a contact swings up by itself.

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
        sensor_offset: Vector = (0.1, -0.15, 0.3),
        **options: Any,
    ) -> None:
        require("seed", seed, at_least=0)
        built = ArmSettings(**options)
        require("sample_period", built.sample_period, at_most=1.2e-3)
        require("substeps", built.substeps, at_least=LEAST_STEPS)
        self._world, self._fixture = world, fixture
        self.reach = reach
        self._steps, self._h = range(built.substeps), built.step
        self._offset, self._noise = sensor_offset, normal_draws(seed)
        self.specification = built.specification(
            tool_mass=0.0,
            gravity=0.0,
            accelerometer_noise=0.0,
            workspace=(-1.0, 1.0),
            sensor_range=200.0,
            largest_offset=math.hypot(*sensor_offset) + OFFSET_UNCERTAINTY,
        )
        self._build(start)

    def _build(self, start: Vector) -> None:
        from foretouch.robot import servo_kernel as kernel  # Numba is slow to import: only when used

        mujoco, built = load_mujoco(), self.specification
        model: Any = mujoco.MjModel.from_xml_string(gantry_scene(self._h))
        data: Any = mujoco.MjData(model)
        data.qpos[:] = start
        mujoco.mj_forward(model, data)
        self._model, self._data, self._mj_step = model, data, mujoco.mj_step
        self._begin, self._push = kernel.begin_gantry.entry, kernel.push_gantry.entry
        self._sense = kernel.sense_gantry.entry
        self._applied = data.xfrc_applied[model.body("tool").id][:3]
        self._interaction = data.sensordata[:3]
        weight = (0.0, 0.0, TOOL_MASS * GRAVITY)
        low_pass = -math.expm1(-2.0 * math.pi * built.sensor_bandwidth * self._h)
        self._arm = kernel.Gantry.new(h=self._h, low_pass=low_pass, tool=weight, raw=weight)
        for axis, (way, position) in enumerate(zip(kernel.WAYS, start, strict=True)):
            self._arm["servos"][0, axis] = kernel.make_servo(built.force_limit, built.sample_period, way * position)
        self._clipped = False
        self._desired = start
        self._contact: Vector = (0.0, 0.0, 0.0)
        self._sample = self._measure()

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return bool(self._data.time == 0.0)

    def read(self) -> SpatialSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._sample

    def exchange(self, desired: Vector) -> SpatialSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `SpatialRobot`."""
        if len(desired) == 3 and all(map(math.isfinite, desired)):
            low, high = self.reach
            x, y, z = (min(max(value, a), b) for value, a, b in zip(desired, low, high, strict=True))
            self._desired = (x, y, z)
        arm, data = self._arm, self._data
        self._begin(arm, *self._desired)
        for _ in self._steps:
            self._clipped = self._push(arm, data.qpos, data.qvel, data.ctrl)
            self._applied[:] = self._contact
            self._mj_step(self._model, data)
            self._sense(arm, data.qvel, self._interaction)
            self._touch()
        self._sample = self._measure()
        return self._sample

    def _touch(self) -> None:
        (x, y, z), (u, v, w) = self._data.qpos.tolist(), self._data.qvel.tolist()
        self._contact = bounded_force(self._world((x, y, z), (u, v, w), self._h))

    def _measure(self) -> SpatialSample:
        x, y, z = self._data.qpos.tolist()
        a, b, c = map(self._counted, (x, y, z))
        (sensor,), noise = self._arm["sensor"].tolist(), self.specification.sensor_noise
        f, g, h = (felt + offset + noise * next(self._noise) for felt, offset in zip(sensor, self._offset, strict=True))
        fixture = () if self._fixture is None else self._fixture()
        return SpatialSample((a, b, c), (f, g, h), self._contact, (x, y, z), fixture, self._clipped)

    def _counted(self, value: float) -> float:
        measured = value + self.specification.encoder_noise * next(self._noise)
        resolution = self.specification.encoder_resolution
        return round(measured / resolution) * resolution if resolution > 0.0 else measured


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
