"""Description of an arm: an MJCF file with its figures, and what a controller has to know beside them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.errors import InputError
from foretouch.quantities import BASE, FLANGE, SENSOR, TIP, ToolLoad
from foretouch.robot.engine import GRAVITY, load_mujoco

Array = NDArray[np.float64]

WEIGHT = "tool_mass"
"""Site of the tool's centre of mass. The others are named after their frames: base and flange, of the description, the
sensor between flange and tool, and the tip, whose site has the axes of the flange."""

BACKLASH = "_backlash"  # A joint whose name ends so is the play of the gear of the joint before it
PROBE_RADIUS = 0.004  # Of the probe's rod, drawn [m]


@dataclass(frozen=True)
class ArmDescription:
    """An arm as its description file says.

    Attributes:
        name: Of the arm, as it is said to users.
        path: Of the file.
        control: How it is controlled: Cartesian ``impedance`` through joint torques, or a ``servo`` at each joint.
        force: From where it knows the contact force: a six-axis sensor at the ``wrist``, or the motors' ``current``.
        rate: Of its controller [Hz]; a whole fraction of 1 kHz.
        joint_speed: Largest speed of each driven joint [rad/s].
        joint_acceleration: Largest acceleration of each [rad/s^2].
        torque_rate: Largest change of a joint's torque [N m/s]; infinite where none is known.
        payload: Largest mass at the flange [kg].
        encoder: Resolution of the joints' encoders [rad].
        stiffness: Of each joint's servo [N m/rad].
        damping: Of each joint's servo [N m s/rad].
        integral: Of each joint's servo, beside its stiffness [1/s].
        scene: Origin of a scene in the base's frame [m]; the axes are parallel.
        reach: Lowest and highest place of the tip in the scene [m], shape (2, 3).
        probe: Length [m] and mass [kg] of the tool that presses.
        tool: The same tool as a calibration of the sensor at the wrist found it, with the sensor's bias; None where the
            arm knows its weight exactly, and takes the bias for what the sensor shows at first.
    """

    name: str
    path: Path
    control: str
    force: str
    rate: int
    joint_speed: Array
    joint_acceleration: Array
    torque_rate: float
    payload: float
    encoder: float
    stiffness: Array
    damping: Array
    integral: float
    scene: Array
    reach: Array
    probe: tuple[float, float]
    tool: ToolLoad | None = None

    def model(self, step: float, *, backlash: bool = True) -> Any:
        """The arm with its probe as a MuJoCo model, without contacts: what is touched acts from outside.

        Args:
            step: Length of a physics step [s].
            backlash: Whether its gears have play.
        """
        spec = load_mujoco().MjSpec.from_file(str(self.path))
        spec.option.timestep, spec.option.gravity = step, (0.0, 0.0, -GRAVITY)
        without = load_mujoco().mjtDisableBit  # to look for contacts, and for parts that move apart, takes time
        spec.option.disableflags |= without.mjDSBL_CONTACT | without.mjDSBL_ISLAND
        if not backlash:
            for joint in list(spec.joints):
                if joint.name.endswith(BACKLASH):
                    spec.delete(joint)
            for key in list(spec.keys):
                spec.delete(key)
        _add_probe(spec, *self.probe)
        return spec.compile()

    @cached_property
    def home(self) -> Array:
        """Pose of the driven joints above the scene [rad], shape (n,)."""
        model = self.model(1e-3)
        return np.asarray(model.key("home").qpos[driven(model)])

    def refuse(self, rule: str) -> InputError:
        """The error of a file that breaks a rule."""
        return InputError(f"{self.path}: {rule}")


def driven(model: Any) -> NDArray[np.int64]:
    """Numbers of the joints that have a motor, in the order of the motors."""
    return np.asarray(model.actuator_trnid[:, 0], np.int64)


def _add_probe(spec: Any, length: float, mass: float) -> None:
    """Mount a probe on the flange: a rod of this length [m] and mass [kg], with the sensor at its root."""
    mujoco = load_mujoco()
    flange = next(site for site in spec.sites if site.name == FLANGE)
    tool = flange.parent.add_body(name="tool", pos=flange.pos, quat=flange.quat)
    tool.explicitinertial = True
    tool.mass, tool.ipos = mass, (0.0, 0.0, 0.5 * length)
    across = mass * (length**2 / 12.0 + PROBE_RADIUS**2 / 4.0)
    tool.inertia = (across, across, 0.5 * mass * PROBE_RADIUS**2)
    capsule = mujoco.mjtGeom.mjGEOM_CAPSULE
    look = {"contype": 0, "conaffinity": 0, "group": 2, "rgba": (0.80, 0.82, 0.85, 1.0)}
    tool.add_geom(type=capsule, size=(PROBE_RADIUS, 0, 0), fromto=(0, 0, 0, 0, 0, length), **look)
    for name, height in ((SENSOR, 0.0), (TIP, length), (WEIGHT, 0.5 * length)):
        tool.add_site(name=name, pos=(0.0, 0.0, height))
    kinds = mujoco.mjtSensor
    for kind, site in (
        (kinds.mjSENS_FORCE, SENSOR),
        (kinds.mjSENS_TORQUE, SENSOR),
        (kinds.mjSENS_ACCELEROMETER, WEIGHT),
    ):
        spec.add_sensor(name=kind.name, type=kind, objtype=mujoco.mjtObj.mjOBJ_SITE, objname=site)


DRAWN = 3  # Geoms of the groups before this are seen, as in MuJoCo's own viewer; the others are for contacts


class Capsule(NamedTuple):
    """A bar with round ends, in the frame of its link.

    Attributes:
        begin: Centre of one round end [m].
        end: Centre of the other [m].
        radius: Of the bar [m].
    """

    begin: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


class ArmPicture:
    """The capsules of an arm, link by link from the base to the tool, and the poses of the links in the scene.

    A shape that is no capsule is drawn as the capsule along the longest side of its bounding box.

    Args:
        description: Of the arm.

    Attributes:
        joints: Number of the driven joints.
        links: Capsules of each link in its own frame; the last are those of the probe.

    Raises:
        MissingExtraError: MuJoCo is not installed.
    """

    def __init__(self, description: ArmDescription) -> None:
        mujoco = load_mujoco()
        model = self._model = description.model(1e-3, backlash=False)
        self._data: Any = mujoco.MjData(model)
        self._kinematics, self._driven, self._tip = mujoco.mj_kinematics, driven(model), model.site(TIP).id
        self.joints = int(self._driven.size)
        seen = [geom for geom in range(model.ngeom) if model.geom_group[geom] < DRAWN and model.geom_bodyid[geom] > 0]
        of_link = {int(body): [geom for geom in seen if model.geom_bodyid[geom] == body] for body in range(model.nbody)}
        self._bodies = [body for body, geoms in of_link.items() if geoms]
        self.links = tuple(tuple(_capsule(model, geom) for geom in of_link[body]) for body in self._bodies)
        self._kinematics(model, self._data)
        self._origin = self._data.site(BASE).xpos + description.scene

    def poses(self, joints: ArrayLike) -> tuple[Array, Array]:
        """Places [m], shape (n, 3), and quaternions, real part first, shape (n, 4), of the links in the scene.

        Args:
            joints: Positions of the driven joints [rad], shape (joints,).
        """
        self._data.qpos[self._driven] = joints
        self._kinematics(self._model, self._data)
        return self._data.xpos[self._bodies] - self._origin, self._data.xquat[self._bodies]

    def tip(self, joints: ArrayLike) -> Array:
        """Place of the probe's tip in the scene with these joints [m], shape (3,)."""
        self.poses(joints)
        place: Array = self._data.site_xpos[self._tip] - self._origin
        return place


def _capsule(model: Any, geom: int) -> Capsule:
    middle, half = model.geom_aabb[geom, :3], model.geom_aabb[geom, 3:]
    axis = int(np.argmax(half))
    radius = float(np.sqrt(np.prod(np.delete(half, axis))))
    along = np.zeros(3)
    along[axis] = max(half[axis] - radius, 0.0)
    turn = np.empty(9)
    load_mujoco().mju_quat2Mat(turn, model.geom_quat[geom])
    begin, end = ((model.geom_pos[geom] + turn.reshape(3, 3) @ (middle + way * along)).tolist() for way in (-1.0, 1.0))
    return Capsule(tuple(begin), tuple(end), radius)
