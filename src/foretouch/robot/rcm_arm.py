"""The paper's slave in MuJoCo, a remote-centre-of-motion arm with a linear probe; and robots by their names."""

from __future__ import annotations

import math
from typing import Any

from foretouch.errors import ArgumentTypeError, SettingError
from foretouch.errors.checks import NUMBER, require, require_type
from foretouch.models import ContactState
from foretouch.robot.engine import (
    GRAVITY,
    LARGEST_CONTACT_FORCE,
    MOVED_MASS,
    OFFSET_UNCERTAINTY,
    TOOL_MASS,
    ArmSettings,
    arm_scene,
    load_mujoco,
    normal_draws,
)
from foretouch.robot.materials import Material, make_material
from foretouch.robot.robot import Robot, RobotSample


class RcmArm(Robot):
    """Two hinges through the remote centre, held so that the rod stays vertical, and a slide that inserts the probe.

    The hinges are position-controlled by MuJoCo, the insertion by a `Servo`. The force of the material comes
    from its law, advanced at every physics step with the exact depth and velocity of the tip, and is applied to the
    tool from outside; native contact is off, because its stiffness depends on the mass that touches.

    The force sensor stands between carriage and tool. Its chain: MuJoCo's interaction force, first-order low-pass,
    offset, noise, range. MuJoCo gives the force at the start of the last physics step, so the chain is late by that
    step and the low-pass (0.5 + 0.8 ms as built). The drive feeds its own copy forward, tared at the start.

    Same seed, same commands: same samples, bit for bit.

    Args:
        material: Material that the probe presses.
        seed: Seed of the sensor and encoder noise, not negative.
        surface: Position of the undeformed surface [m]; None takes the material's own.
        accelerometer_noise: Standard deviation of the acceleration [m/s^2].
        sensor_offset: What the sensor shows with nothing on it [N].
        workspace: Smallest and largest position of the tip [m]; 0 lies inside.
        sensor_range: The force sensor shows at most this, either way [N].
        **options: Settings of `ArmSettings`.

    Attributes:
        material: What the probe presses.
        surface: Position of the undeformed surface [m].
        mj_model: MuJoCo's model, for rendering.
        mj_data: MuJoCo's data, for rendering: look, do not touch.

    Raises:
        SettingError: A setting out of range.
        MissingExtraError: MuJoCo is not installed.
    """

    mj_model: Any
    mj_data: Any

    def __init__(
        self,
        material: Material,
        *,
        seed: int,
        surface: float | None = None,
        accelerometer_noise: float = 0.05,
        sensor_offset: float = 0.3,
        workspace: tuple[float, float] = (-0.02, 0.06),
        sensor_range: float = 200.0,
        **options: Any,
    ) -> None:
        require("seed", seed, at_least=0)
        require("accelerometer_noise", accelerometer_noise, at_least=0.0)
        require("sensor_offset", sensor_offset)
        require("sensor_range", sensor_range, above=0.0)
        if not (isinstance(workspace, tuple | list) and [isinstance(end, NUMBER) for end in workspace] == [True, True]):
            raise ArgumentTypeError("workspace", workspace, "two numbers [m]: smallest and largest position of the tip")
        if not -math.inf < workspace[0] < 0.0 < workspace[1] < math.inf:
            raise SettingError("workspace", workspace, "must be finite and reach from below 0 to above 0")
        self.material = material
        self.surface = material.surface if surface is None else surface
        require("surface", self.surface)
        built = ArmSettings(**options)
        self.specification = built.specification(
            tool_mass=TOOL_MASS,
            gravity=GRAVITY,
            accelerometer_noise=accelerometer_noise,
            workspace=workspace,
            sensor_range=sensor_range,
            largest_offset=abs(sensor_offset) + OFFSET_UNCERTAINTY,
        )
        self._h, self._substeps, self._noise = built.step, range(int(built.substeps)), normal_draws(seed)
        self._build(sensor_offset)

    def _build(self, offset: float) -> None:
        from foretouch.robot import servo_kernel as kernel  # Numba is slow to import: only when used

        mujoco = load_mujoco()
        self.mj_model = mujoco.MjModel.from_xml_string(arm_scene(self.surface, self._h))
        self.mj_data = mujoco.MjData(self.mj_model)
        self._mj_step = mujoco.mj_step
        joint = int(self.mj_model.joint("insertion").qposadr[0])
        self._qpos = self.mj_data.qpos[joint : joint + 1]  # views of one number each: quicker than a search by name
        self._qvel = self.mj_data.qvel[joint : joint + 1]
        self._drive = self.mj_data.ctrl[self.mj_model.actuator("insertion").id :][:1]
        self._applied = self.mj_data.xfrc_applied[self.mj_model.body("tool").id][2:3]
        self._interaction = self.mj_data.sensordata[2:3]
        built = self.specification
        self._begin, self._effort = kernel.begin.entry, kernel.effort.entry
        self._sense, self._show = kernel.sense.entry, kernel.show.entry
        self._arm = kernel.Arm.new(
            servo=kernel.make_servo(built.force_limit, built.sample_period, 0.0),
            h=self._h,
            low_pass=1.0 - math.exp(-2.0 * math.pi * built.sensor_bandwidth * self._h),
            workspace=built.workspace,
            encoder_noise=built.encoder_noise,
            resolution=built.encoder_resolution,
            offset=offset,
            sensor_noise=built.sensor_noise,
            largest=built.sensor_range,
            accelerometer_noise=built.accelerometer_noise,
        )
        self._state: ContactState = self.material.model.initial_state()
        self._least_force = -LARGEST_CONTACT_FORCE if self.material.pulls else 0.0
        self._contact_force = 0.0
        self._touch(0.0, 0.0)
        tool = built.tool_force(0.0)
        self._arm["tool"], self._arm["sensor"] = tool, self._contact_force + tool  # the low-pass, settled
        self._sample = self._measure()

    @property
    def fresh(self) -> bool:
        """Whether no exchange has been yet."""
        return bool(self.mj_data.time == 0.0)

    def read(self) -> RobotSample:
        """What the sensors show now; no time passes and nothing moves."""
        return self._sample

    def exchange(self, desired_position: float) -> RobotSample:
        """Give a command, let one sample period pass, and return what the sensors show then: see `Robot`."""
        arm, effort, sense = self._arm, self._effort, self._sense
        position, velocity = self._qpos.item(), self._qvel.item()
        self._begin(arm, desired_position, velocity)
        for _ in self._substeps:
            self._drive[0] = effort(arm, position, velocity) - MOVED_MASS * GRAVITY
            self._applied[0] = self._contact_force
            self._mj_step(self.mj_model, self.mj_data)
            position, velocity = self._qpos.item(), self._qvel.item()
            # MuJoCo gives what the carriage does to the tool along the world's z: compression pushes it down
            sense(arm, velocity, -self._interaction.item())
            self._touch(position, velocity)
        self._sample = self._measure()
        return self._sample

    def _touch(self, position: float, velocity: float) -> None:
        """Advance the material to where the tip is now; its force acts through the next physics step."""
        self._state, force, _ = self.material.model.advance(self._state, position - self.surface, velocity, self._h)
        self._contact_force = min(force, LARGEST_CONTACT_FORCE) if force >= self._least_force else 0.0

    def _measure(self) -> RobotSample:
        noise, exact = self._noise, self._qpos.item()
        position, force, acceleration, reference, clipped = self._show(
            self._arm, exact, next(noise), next(noise), next(noise)
        )
        effort = self._drive.item() + MOVED_MASS * GRAVITY
        return RobotSample(position, force, acceleration, self._contact_force, exact, reference, clipped, effort)


def make_robot(material: str | Material, *, seed: int = 0, surface: float | None = None, **options: Any) -> RcmArm:
    """The simulated arm over a material.

    Args:
        material: A material, or its name in `MATERIALS`.
        seed: Seed of the sensor and encoder noise.
        surface: Position of the undeformed surface [m]; None takes the material's own.
        **options: Settings of `RcmArm` and `ArmSettings`.

    Raises:
        UnknownNameError: No such material.
        SettingError: A setting out of range.
        ArgumentTypeError: A material or a setting of another type.
        MissingExtraError: MuJoCo is not installed.
    """
    if isinstance(material, str):
        material = make_material(material)
    require_type("material", material, Material, "a Material, or the name of one")
    return RcmArm(material, seed=seed, surface=surface, **options)
