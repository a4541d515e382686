"""A simulated arm in the picture of a scene, as its joints stand: delayed, as its operator hears of it, and now.

It is drawn by its description, which is read where the console runs; nothing of its simulation is. Where its published
meshes are there, too, they take the place of the description's capsules once they are read.
"""

from __future__ import annotations

import threading
from typing import Any

import numpy as np

from foretouch.console.history import Array
from foretouch.console.panels.stop import WHOLE_ARM, add_keys
from foretouch.console.plots import put
from foretouch.console.views.probes import UNITS
from foretouch.console.views.shapes import ARM_DELAYED, ARM_NOW, HANDLE_HEIGHT, Mesh, add_body, along, lathe, thinned
from foretouch.console.watched import NOWHERE, Watched
from foretouch.errors import ForetouchError
from foretouch.quantities.colours import Colour
from foretouch.quantities.pose import Vector
from foretouch.robot import ArmDescription, ArmPicture, Capsule, LinkMesh, read_arm, read_arm_meshes
from foretouch.settings import SIMULATED, is_simulated

FROM, FAR = np.array((0.3, -0.9, 0.3)), 2.1
"""Where the camera stands that sees a whole arm, from the middle of it, and how far off for the arm's size."""
APART = 1e-3  # Distance of any link from where it is heard of at which the arm of now is drawn, too [m]
SMALLEST_CHANGE = np.array((2e-5, 2e-5, 2e-5, 1e-4, 1e-4, 1e-4, 1e-4))
"""Changes of a link's place [m] and turn below these are not drawn."""
ROD = 0.7e-3  # Radius of the arm's own probe, within that of the delayed robot [m]
MOST_TRIANGLES = 8000  # Of a link that is drawn by its meshes: a browser may be far away
EDGED = {"material": "standard", "flat_shading": True}  # Links of few triangles have edges: they are not rounded
ROUND = np.linspace(0.0, 0.5 * np.pi, 5)  # Angles of the rings of an end [rad]


class ArmView:
    """Both arms of the session that is looked at; none along a line, and none of a robot that tells of no joints.

    Attributes:
        problem: Reason that the arm is not drawn, or without the meshes that are here, in a sentence; "" where it is as
            it should be, and where there is none.
        camera: From where the whole arm is seen, and the point looked at [scene units]; None where it is not asked for.

    Args:
        server: Of the page.
        whole: The page's box that asks for the whole arm.
    """

    def __init__(self, server: Any, whole: Any) -> None:
        self._scene, self._gui, self._name, self.problem = server.scene, server.gui, "", ""
        self.camera: tuple[Vector, Vector] | None = None
        self._whole, self._offered = whole, False
        self._picture: ArmPicture | None = None
        self._arms: tuple[DrawnArm, ...] = ()
        self._capsules: list[Mesh] = []
        self._reading: MeshReading | None = None

    def draw(self, shown: Watched) -> None:
        """Draw the arm as heard of with the operator's delay, and where it is now if that is elsewhere."""
        robot = shown.space.follower_at(shown.telemetry_sequence)
        heard, now = () if robot is None else robot.joints, shown.joints
        in_space = shown.leader_space is not NOWHERE
        if in_space:
            self._take_meshes()
            self._find(shown.settings.get("robot", SIMULATED))
        picture, poses = self._picture, [np.empty((0, 7))] * 2
        if picture is not None:
            poses = [_poses(picture, joints) for joints in (heard, now)]
            if len(poses[0]) and len(poses[1]) and _apart(*poses) < APART:
                poses[1] = poses[1][:0]
        for arm, where in zip(self._arms, poses, strict=False):
            arm.draw(where)
        known = max(poses, key=len)
        put(self._whole, visible=len(known) > 0)
        if not (self._whole.value and len(known)):
            self.camera = None
        elif self.camera is None:
            self.camera = _camera(known)

    def _toggle(self, event: Any = None) -> None:
        self._whole.value = not self._whole.value

    def _find(self, name: str) -> None:
        """Another robot has another picture; none where its description is not here.

        It waits for meshes that are being read: loading MuJoCo sets the environment for a moment, which no two threads
        may do at once.
        """
        if name == self._name or self._reading is not None:
            return
        self._show([])
        self._name, self._picture, self._reading, self.problem = name, None, None, ""
        if name == SIMULATED or not is_simulated(name):
            return
        try:
            description = read_arm(name)
            self._picture = ArmPicture(description)
        except (ForetouchError, OSError) as error:  # a file that only the other machine has, or nothing to read it with
            self.problem = f"The arm cannot be drawn here: {error}"
            return
        if not self._offered:
            self._offered = True
            add_keys(self._gui, (*WHOLE_ARM, self._toggle))
        self._capsules = [_link(link) for link in (*self._picture.links[:-1], _holder(self._picture.links[-1]))]
        self._show(self._capsules)
        self._reading = MeshReading(description)

    def _take_meshes(self) -> None:
        """Draw the meshes in place of the capsules, once they are read; a link that has none keeps its capsules."""
        reading = self._reading
        if reading is None or not reading.ended:
            return
        self._reading, self.problem = None, reading.problem
        if reading.meshes:
            pairs = zip(reading.meshes, self._capsules[:-1], strict=True)
            links = [mesh if len(mesh[1]) else capsules for mesh, capsules in pairs]
            self._show([*links, self._capsules[-1]], edged=True)

    def _show(self, meshes: list[Mesh], *, edged: bool = False) -> None:
        """Draw other links, the last of which is the probe; none of them draws no arm."""
        if self._arms:
            self._scene.remove_by_name("/arm")
        self._arms = ()
        if meshes:
            self._arms = (
                DrawnArm(self._scene, "/arm/delayed", meshes, ARM_DELAYED, edged=edged),
                DrawnArm(self._scene, "/arm/now", meshes, ARM_NOW, opacity=0.4, edged=edged),
            )


class MeshReading:
    """The meshes of an arm, being read beside the console's loop, which goes on meanwhile.

    Attributes:
        meshes: One for each link but the probe; none where no meshes are here, or they cannot be read.
        problem: Reason that those which are here are not drawn, in a sentence.
    """

    def __init__(self, description: ArmDescription) -> None:
        self.meshes: list[Mesh] = []
        self.problem = ""
        self._thread = threading.Thread(target=self._read, args=(description,), daemon=True)
        self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether they are read, as far as they can be."""
        return not self._thread.is_alive()

    def _read(self, description: ArmDescription) -> None:
        try:
            self.meshes = [_drawn(mesh) for mesh in read_arm_meshes(description)]
        except (ForetouchError, OSError) as error:
            self.problem = f"The arm is drawn without its meshes: {error}"


class DrawnArm:
    """The links of one arm, each a mesh that moves; those before the probe may be `edged`, with flat faces."""

    def __init__(
        self,
        scene: Any,
        root: str,
        meshes: list[Mesh],
        colour: Colour,
        opacity: float | None = None,
        *,
        edged: bool = False,
    ) -> None:
        self._root = scene.add_frame(root, show_axes=False, visible=False)
        looks = [EDGED if edged else {}] * (len(meshes) - 1) + [{}]
        self._links = [
            add_body(scene, f"{root}/{number}", mesh, colour, opacity, **look)
            for number, (mesh, look) in enumerate(zip(meshes, looks, strict=True))
        ]
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


def _drawn(mesh: LinkMesh) -> Mesh:
    """The mesh of a link with as many triangles as a browser is sent [scene units]."""
    vertices, faces = mesh
    if len(faces) > MOST_TRIANGLES:
        vertices, faces = thinned(vertices, faces, MOST_TRIANGLES)
    return (UNITS * vertices).astype(np.float32), faces.astype(np.uint32)


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
