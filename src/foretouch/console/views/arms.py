"""A simulated arm in the picture of a scene, as its joints stand: delayed, as its operator hears of it, and now.

It is drawn by its description, which is read where the console runs; nothing of its simulation is.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from foretouch.console.history import Array
from foretouch.console.panels.stop import WHOLE_ARM, add_keys
from foretouch.console.views.probes import UNITS
from foretouch.console.views.shapes import ARM_DELAYED, ARM_NOW, HANDLE_HEIGHT, Mesh, add_body, along, lathe
from foretouch.console.watched import NOWHERE, Watched
from foretouch.errors import ForetouchError
from foretouch.quantities.colours import Colour
from foretouch.quantities.pose import Vector
from foretouch.robot import ArmPicture, Capsule, read_arm
from foretouch.settings import SIMULATED, is_simulated

FROM, FAR = np.array((0.3, -0.9, 0.3)), 2.1
"""Where the camera stands that sees a whole arm, from the middle of it, and how far off for the arm's size."""
APART = 1e-3  # Distance of any link from where it is heard of at which the arm of now is drawn, too [m]
SMALLEST_CHANGE = np.array((2e-5, 2e-5, 2e-5, 1e-4, 1e-4, 1e-4, 1e-4))
"""Changes of a link's place [m] and turn below these are not drawn."""
ROD = 0.7e-3  # Radius of the arm's own probe, within that of the delayed robot [m]
ROUND = np.linspace(0.0, 0.5 * np.pi, 5)  # Angles of the rings of an end [rad]


class ArmView:
    """Both arms of the session that is looked at; none along a line, and none of a robot that tells of no joints.

    Attributes:
        problem: Reason that the arm is not drawn, in a sentence; "" where it is, and where there is none.
        camera: From where the whole arm is seen, and the point looked at [scene units]; None where it is not asked for.
    """

    def __init__(self, server: Any) -> None:
        self._scene, self._gui, self._name, self.problem = server.scene, server.gui, "", ""
        self.camera: tuple[Vector, Vector] | None = None
        self._offered = self._wanted = False  # a key for it, and the whole arm
        self._picture: ArmPicture | None = None
        self._arms: tuple[DrawnArm, ...] = ()

    def draw(self, shown: Watched) -> None:
        """Draw the arm as heard of with the operator's delay, and where it is now if that is elsewhere."""
        robot = shown.space.follower_at(shown.telemetry_sequence)
        heard, now = () if robot is None else robot.joints, shown.joints
        in_space = shown.leader_space is not NOWHERE
        if in_space:
            self._find(shown.settings.get("robot", SIMULATED))
        picture, poses = self._picture, [np.empty((0, 7))] * 2
        if picture is not None:
            poses = [_poses(picture, joints) for joints in (heard, now)]
            if len(poses[0]) and len(poses[1]) and _apart(*poses) < APART:
                poses[1] = poses[1][:0]
        for arm, where in zip(self._arms, poses, strict=False):
            arm.draw(where)
        known = max(poses, key=len)
        if not (self._wanted and len(known)):
            self.camera = None
        elif self.camera is None:
            self.camera = _camera(known)

    def _toggle(self, event: Any = None) -> None:
        self._wanted = not self._wanted

    def _find(self, name: str) -> None:
        """Another robot has another picture; none where its description is not here."""
        if name == self._name:
            return
        if self._arms:
            self._scene.remove_by_name("/arm")
        self._name, self._picture, self._arms, self.problem = name, None, (), ""
        if name == SIMULATED or not is_simulated(name):
            return
        try:
            self._picture = ArmPicture(read_arm(name))
        except (ForetouchError, OSError) as error:  # a file that only the other machine has, or nothing to read it with
            self.problem = f"The arm cannot be drawn here: {error}"
            return
        if not self._offered:
            self._offered = True
            add_keys(self._gui, (*WHOLE_ARM, self._toggle))
        meshes = [_link(link) for link in (*self._picture.links[:-1], _holder(self._picture.links[-1]))]
        self._arms = (
            DrawnArm(self._scene, "/arm/delayed", meshes, ARM_DELAYED),
            DrawnArm(self._scene, "/arm/now", meshes, ARM_NOW, opacity=0.4),
        )


class DrawnArm:
    """The links of one arm, each a mesh of its own that moves."""

    def __init__(self, scene: Any, root: str, meshes: list[Mesh], colour: Colour, opacity: float | None = None) -> None:
        self._root = scene.add_frame(root, show_axes=False, visible=False)
        self._links = [add_body(scene, f"{root}/{number}", mesh, colour, opacity) for number, mesh in enumerate(meshes)]
        self._drawn = np.full((len(meshes), 7), np.inf)

    def draw(self, poses: Array) -> None:
        """Put the links at places [m] and turns, shape (n, 7); none of them hides the arm."""
        self._root.visible = len(poses) > 0
        for number, pose in enumerate(poses):
            if (np.abs(pose - self._drawn[number]) > SMALLEST_CHANGE).any():
                self._drawn[number] = pose
                self._links[number].position, self._links[number].wxyz = tuple(UNITS * pose[:3]), tuple(pose[3:])


def _camera(poses: Array) -> tuple[Vector, Vector]:
    """From where all links and the scene are seen, and the middle of them [scene units]."""
    places = UNITS * np.vstack((np.zeros(3), poses[:, :3]))
    low, high = places.min(axis=0), places.max(axis=0)
    middle = 0.5 * (low + high)
    x, y, z = (middle + FAR * float(np.linalg.norm(high - low)) * FROM).tolist()
    return (x, y, z), (*middle.tolist(),)


def _poses(picture: ArmPicture, joints: tuple[float, ...]) -> Array:
    """Of each link a place [m] and a quaternion, shape (n, 7); none where the joints are not those of this arm."""
    return np.hstack(picture.poses(joints)) if len(joints) == picture.joints else np.empty((0, 7))


def _apart(one: Array, other: Array) -> float:
    """Largest distance of a link from itself [m]."""
    return float(np.linalg.norm(one[:, :3] - other[:, :3], axis=1).max())


def _holder(probe: tuple[Capsule, ...]) -> tuple[Capsule, ...]:
    """What holds the probe: down from the height at which the rods of all robots end, it is as thin as they are."""
    ((begin, end, radius),) = probe
    low, high = sorted((begin[2], end[2]))
    middle = max(high - HANDLE_HEIGHT / UNITS - radius, low)
    thick = Capsule((0.0, 0.0, low), (0.0, 0.0, middle), radius)
    return thick, Capsule((0.0, 0.0, middle), (0.0, 0.0, high), ROD)


def _link(capsules: tuple[Capsule, ...]) -> Mesh:
    """The capsules of a link as one mesh [scene units]."""
    meshes = [_capsule(capsule) for capsule in capsules]
    first = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = [corners + np.uint32(before) for (_, corners), before in zip(meshes, first[:-1], strict=True)]
    return np.concatenate([vertices for vertices, _ in meshes]), np.concatenate(faces).astype(np.uint32)


def _capsule(capsule: Capsule) -> Mesh:
    begin, end = UNITS * np.array(capsule.begin), UNITS * np.array(capsule.end)
    radius, way = UNITS * capsule.radius, end - begin
    length = float(np.linalg.norm(way))
    lower = [(radius * np.sin(angle), -radius * np.cos(angle)) for angle in ROUND]
    upper = [(radius * np.cos(angle), length + radius * np.sin(angle)) for angle in ROUND]
    vertices, faces = lathe([*lower, *upper], 20)
    w, *turn = along(way.tolist() if length > 0.0 else (0.0, 0.0, 1.0))
    twice = 2.0 * np.cross(turn, vertices)
    turned = vertices + w * twice + np.cross(turn, twice)
    return (turned + begin).astype(np.float32), faces
