"""What there is to draw of an arm: the shapes of its description, and where its joints put them. Nothing moves here."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from foretouch.robot.arms.description import BASE, TIP, ArmDescription, driven
from foretouch.robot.engine import load_mujoco

Array = NDArray[np.float64]

DRAWN = 3  # Geoms of the groups before this are seen, as in MuJoCo's own viewer; the others are for contacts


class Capsule(NamedTuple):
    """A round bar in the frame of its link: the middles of both its ends, and its radius [m]."""

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
