"""An arm's body in MuJoCo: its state in the terms of its control, and what the world does to its tip."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.quantities import BASE, SENSOR, TIP, WORLD
from foretouch.robot.arms.description import BACKLASH, ArmDescription, driven
from foretouch.robot.engine import load_mujoco
from foretouch.robot.robot import Vector

Array = NDArray[np.float64]

FRICTION_KNOWN, FRICTION_SPEED = 0.7, 0.05
"""Share of the joints' Coulomb friction that an arm knows and takes off, and speed from which most of it is [rad/s]."""


class Body:
    """An arm with its probe, standing in its home pose at first.

    Where its gears have play, a joint's position is that of its output shaft, on which the encoder stands.

    Args:
        description: Of the arm.
        step: Length of a physics step [s].

    Attributes:
        description: As given.
        model: Of MuJoCo.
        data: Of MuJoCo.
        joints: Numbers of the driven joints.
        origin: Of the scene, in MuJoCo's frame [m].
        jacobian: Of the tip's place and, below it, of its orientation, shape (6, n), as `look` took it.
    """

    def __init__(self, description: ArmDescription, step: float) -> None:
        mujoco = load_mujoco()
        self.description, self.model = description, description.model(step)
        self.data: Any = mujoco.MjData(self.model)
        self._mujoco, count = mujoco, self.model.nv
        self.joints = driven(self.model)
        names = [self.model.joint(number).name for number in range(count)]
        play = [names.index(names[joint] + BACKLASH) for joint in self.joints if names[joint] + BACKLASH in names]
        self._play = np.asarray(play, np.int64) if play else None
        tip, tool = self.model.site(TIP).id, self.model.body("tool").id
        self._tip, self._whole, self._inertia = tip, np.zeros((6, count)), np.zeros((count, count))
        self._along, self._about = self._whole[:3], self._whole[3:]
        # Asking MuJoCo's data for an array costs as much as using it.
        self._qpos, self._qvel, self._ctrl = self.data.qpos, self.data.qvel, self.data.ctrl
        self._bias = self.data.qfrc_bias
        self._place, self.rotation = self.data.site_xpos[tip], self.data.site_xmat[tip]
        self.sensor_rotation = self.data.site_xmat[self.model.site(SENSOR).id]
        self._middle, self._applied = self.data.xipos[tool], self.data.xfrc_applied[tool]
        self._all = self.joints.size == count  # every joint has a motor: nothing is looked for
        self.jacobian = self._whole if self._all else np.zeros((6, self.joints.size))
        self.data.qpos[self.joints] = description.home
        mujoco.mj_forward(self.model, self.data)
        self.origin = self.data.site(BASE).xpos + description.scene
        self.look()

    def stand(self, pose: Array) -> None:
        """Stand still in another pose of the driven joints [rad]."""
        self.data.qpos[:], self.data.qvel[:] = 0.0, 0.0
        self.data.qpos[self.joints] = pose
        self._mujoco.mj_forward(self.model, self.data)
        self.look()

    @property
    def place(self) -> Array:
        """Place of the tip in the scene [m], shape (3,)."""
        place: Array = self._place - self.origin
        return place

    @property
    def velocity(self) -> Array:
        """Velocity of the tip [m/s], shape (3,)."""
        velocity: Array = self._along.dot(self._qvel)
        return velocity

    @property
    def positions(self) -> Array:
        """Positions of the joints [rad], shape (n,)."""
        return self._of_joints(self._qpos)

    @property
    def counted(self) -> Array:
        """Positions of the joints as their encoders count them [rad], shape (n,)."""
        resolution = self.description.encoder
        counted: Array = np.rint(self.positions / resolution) * resolution
        return counted

    @property
    def velocities(self) -> Array:
        """Velocities of the joints [rad/s], shape (n,)."""
        return self._of_joints(self._qvel)

    @property
    def bias(self) -> Array:
        """Torques of gravity, Coriolis and centrifugal forces on the joints [N m], shape (n,)."""
        bias: Array = self._bias[self.joints]
        return bias

    @property
    def inertia(self) -> Array:
        """Inertia of the joints with what they carry and their rotors [kg m^2], shape (n, n)."""
        self._mujoco.mj_fullM(self.model, self.data, self._inertia)
        return self._inertia if self._all else self._inertia[np.ix_(self.joints, self.joints)]

    def _of_joints(self, values: Array) -> Array:
        return values[self.joints] if self._play is None else values[self.joints] + values[self._play]

    def look(self) -> None:
        """Take the tip's Jacobian from the present state."""
        self._mujoco.mj_jacSite(self.model, self.data, self._along, self._about, self._tip)
        if not self._all:
            self.jacobian[:] = self._whole[:, self.joints]

    def begin_step(self) -> None:
        """Begin a physics step: everything that depends on positions and velocities is known then."""
        self._mujoco.mj_step1(self.model, self.data)
        self.look()

    def end_step(self, torques: Array, force: Vector) -> None:
        """End it, with the motors' torques [N m] and a force on the tip [N], which the wrist's sensor feels."""
        (x, y, z), (a, b, c) = (self._place - self._middle).tolist(), force
        self._applied[:] = (a, b, c, y * c - z * b, z * a - x * c, x * b - y * a)
        self._ctrl[:] = torques
        self._mujoco.mj_step2(self.model, self.data)

    def mass_along(self, direction: Array) -> float:
        r"""Mass that the tip shows along a unit direction u [kg], :math:`1 / (u^T J M^{-1} J^T u)`."""
        row = direction @ self.jacobian[:3]
        return float(1.0 / (row @ np.linalg.solve(self.inertia, row)))

    def limits(self) -> dict[str, Array]:
        """Of each joint: its range [rad], largest torque and Coulomb friction [N m], and damping [N m s/rad]."""
        model, joints = self.model, self.joints
        low, high = model.jnt_range[joints].T
        return {
            "low": low,
            "high": high,
            "torque": model.actuator_ctrlrange[:, 1],
            "friction": model.dof_frictionloss[joints],
            "damping": model.dof_damping[joints],
        }


def too_far(description: ArmDescription, place: Vector, away: float) -> InputError:
    """The error of an arm that cannot bring its tip to a place of the scene [m]; how far it stays away [m]."""
    at = ", ".join(f"{value:.3g}" for value in place)
    return InputError(
        f"{description.path}: the arm's {TIP} stays {1e3 * away:.3g} mm away from ({at}) m of the scene, in {WORLD}: "
        f"move the scene nearer to its {BASE} (numeric scene), or take a shorter probe"
    )
