"""Meshes of the arms for their picture: fetched once from where they were published, and read link by link.

Nothing of a simulation needs them. They are MuJoCo Menagerie's, at the commit from which the description has its
figures. Their checksums are not known here: the commit in the address and TLS are what a download goes by, and whether
MuJoCo makes the arm of what came, with links that stand where those of the description do.
"""

from __future__ import annotations

import contextlib
import os
import shutil
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import DatasetError, MissingExtraError, UnknownNameError
from foretouch.files.origins import DATA_DIR, Origin, cache_of, fetch, in_data_dir
from foretouch.robot.arms.description import DRAWN, ArmDescription, Array, driven
from foretouch.robot.arms.reading import read_arm
from foretouch.robot.engine import load_mujoco


def _menagerie(commit: str, folder: str, licence: str, about: str) -> Origin:
    return Origin("google-deepmind/mujoco_menagerie", commit, folder, folder, licence, about)


ARM_MESHES: Final[dict[str, Origin]] = {
    "fr3": _menagerie(
        "0059d4335f8156206f63a35662313385f7ad6d74",
        "franka_fr3",
        "Apache License 2.0, from Franka's own description",
        "Franka FR3",
    ),
    "ur5e": _menagerie(
        "1b428b08bb26ca6024e7b21e8ff21a59f847eb87",
        "universal_robots_ur5e",
        "BSD 3-Clause License, Copyright 2018 ROS Industrial Consortium",
        "Universal Robots UR5e",
    ),
    "so101": _menagerie(
        "191a7ba5e6d5ca0af05303bf725a644bcceffb0c",
        "robotstudio_so101",
        "Apache License 2.0",
        "SO-101 follower, of RobotStudio and Hugging Face",
    ),
}
"""Where the meshes of each arm of the package were published, beside an MJCF file that is named after the arm."""

AWAY, TURNED = 1e-3, 1.0
"""A link of what was published may stand so far from that of the description [m], [degrees]: then it is the same."""
FARTHEST = 1.0
"""No vertex of a link is so far from the link's frame [m]: twice the length of the longest, the UR5e's upper arm. A
mesh in millimetres that is taken for metres is far beyond."""
POSES, SWAY = 8, 1.0  # Poses in which they are compared, the first at home, and how far the joints are from it [rad]


class LinkMesh(NamedTuple):
    """What is seen of a link, as triangles in its frame.

    Attributes:
        vertices: Places [m], shape (V, 3).
        faces: Numbers of the vertices of each triangle, shape (F, 3).
    """

    vertices: Array
    faces: NDArray[np.int64]


def fetch_arm_meshes(name: str) -> Path:
    """Path of the MJCF file of an arm whose meshes are here with it, fetched from their origin if they are not yet.

    Looked for in the folder that ``FORETOUCH_DATA_DIR`` names (there or in any folder below, as
    ``<folder of the origin>/<arm>.xml``, as in a checkout of MuJoCo Menagerie), then in the user's cache, then at the
    origin. What is fetched is read before it counts: of what cannot be used nothing stays.

    Args:
        name: One of `ARM_MESHES`.

    Raises:
        UnknownNameError: There is no such arm, or none whose meshes are known.
        DatasetError: They are not here and cannot be fetched, or are not those of this arm.
        MissingExtraError: MuJoCo is needed, or the package ``pooch``, and not installed.
    """
    if name not in ARM_MESHES:
        raise UnknownNameError("arm with meshes", name, ARM_MESHES)
    origin = ARM_MESHES[name]
    path = in_data_dir(f"{origin.local_folder}/{name}.xml")
    if path is not None:
        _read(path, read_arm(name))
        return path
    folder = cache_of(origin, by_commit=True)
    path = folder / f"{name}.xml"
    try:
        if path.is_file():
            _read(path, read_arm(name))
            return path
    except UnusableMeshesError:  # it was interrupted while it came, or something happened to it since
        shutil.rmtree(folder, ignore_errors=True)
    what = f"a file of the meshes of {name}"
    try:
        fetch(origin, path.name, what)
        for file in _files(_drawn(path), path):
            fetch(origin, file, what)
        _read(path, read_arm(name))
    except UnusableMeshesError:
        shutil.rmtree(folder, ignore_errors=True)
        raise
    finally:
        _leave_no_empty_folder(folder)
    return path


def _leave_no_empty_folder(folder: Path) -> None:
    """Take away what a download made and then had nothing for: below the folder of an arm, and the three above it."""
    inner = sorted((one for one in folder.rglob("*") if one.is_dir()), reverse=True)  # the inner ones first
    for one in (*inner, folder, folder.parent, folder.parent.parent):
        with contextlib.suppress(OSError):  # it has something, or is not there
            one.rmdir()


def read_arm_meshes(description: ArmDescription) -> tuple[LinkMesh, ...]:
    """What is seen of each link of an arm, from the base to the last one before the probe, where it is here.

    Nothing is fetched. It takes about a second, most of it without Python's lock: call it beside a loop, not in one.

    Returns:
        One for each of `ArmPicture.links` but the last, which is the probe; one without triangles where nothing was
        published for a link. Empty where no meshes are here, or none are known for this arm.

    Raises:
        DatasetError: What is here cannot be read, or is not this arm.
        MissingExtraError: MuJoCo is not installed.
    """
    origin = ARM_MESHES.get(description.name)
    if origin is None:
        return ()
    below = f"{description.name}.xml"
    path = in_data_dir(f"{origin.local_folder}/{below}")
    if path is None:
        try:
            path = cache_of(origin, by_commit=True) / below
        except MissingExtraError:  # nothing was fetched without it
            return ()
    return _read(path, description) if path.is_file() else ()


class UnusableMeshesError(DatasetError):
    """What is here is broken, not all there, or another arm."""

    def __init__(self, path: Path, problem: str) -> None:
        own = os.environ.get(DATA_DIR)  # while it names a folder that has the file, nothing is fetched
        first = f"unset {DATA_DIR} and " if own and path.is_relative_to(own) else ""
        whole = f"fetch it (foretouch arms meshes {path.stem}), or name a folder that has the whole of it as {DATA_DIR}"
        super().__init__(f"{path}: {problem}: {first}{whole}")


def _drawn(path: Path) -> Any:
    """The published arm with nothing but its joints and the meshes that are seen, none of them opened yet."""
    mujoco = load_mujoco()
    try:
        spec = mujoco.MjSpec.from_file(str(path))
    except ValueError as error:
        raise UnusableMeshesError(path, f"MuJoCo cannot read it: {_first(error)}") from None
    for geom in list(spec.geoms):
        if geom.type != mujoco.mjtGeom.mjGEOM_MESH or geom.group >= DRAWN:
            spec.delete(geom)
    if not spec.geoms:
        raise UnusableMeshesError(path, "it has no mesh that is drawn")
    seen = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name not in seen:
            spec.delete(mesh)
            continue
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # of an open surface, too: nothing weighs here
    return spec


def _files(spec: Any, path: Path) -> Iterator[str]:
    """Files of the meshes, below the folder of the arm."""
    for mesh in spec.meshes:
        if not mesh.file:  # its vertices stand in the MJCF file
            continue
        file = PurePosixPath(spec.meshdir, mesh.file)
        if file.is_absolute() or ".." in file.parts:
            raise UnusableMeshesError(path, f"it names the mesh {str(file)!r}, which is not in its folder")
        yield str(file)


def _read(path: Path, description: ArmDescription) -> tuple[LinkMesh, ...]:
    """The links, once it is clear that they are those of the description."""
    spec = _drawn(path)
    for file in _files(spec, path):
        _require_triangles(path, file)
    try:
        published = spec.compile()
    except ValueError as error:
        raise UnusableMeshesError(path, f"MuJoCo cannot make the arm of it: {_first(error)}") from None
    model = description.model(1e-3, backlash=False)
    joints = [model.joint(number).name for number in driven(model)]
    known = {published.joint(number).name for number in range(published.njnt)}
    if missing := [joint for joint in joints if joint not in known]:
        raise UnusableMeshesError(path, f"it has no joint {missing[0]!r}, as the description of {description.name} has")
    ours, theirs = _Links(model, joints), _Links(published, joints)
    _compare(path, ours, theirs, description.home)
    seen = zip(model.geom_bodyid.tolist(), model.geom_group.tolist(), strict=True)
    bodies = sorted({body for body, group in seen if group < DRAWN and body > 0})  # as `ArmPicture` draws them
    links = [ours.link_of(body) for body in bodies[:-1]]
    meshes = tuple(theirs.mesh(link) for link in links)
    for link, (vertices, _) in zip(links, meshes, strict=True):
        _require_size(path, link, vertices)
    return meshes


def _require_triangles(path: Path, file: str) -> None:
    """Refuse half a text file, where triangles stand behind the vertices: MuJoCo takes vertices alone for a hull."""
    mesh = path.parent / file
    if mesh.suffix == ".obj" and mesh.is_file() and b"\nf " not in mesh.read_bytes():
        raise UnusableMeshesError(path, f"its {file} has no triangles, so it is not all there")


def _require_size(path: Path, joint: str, vertices: Array) -> None:
    """Refuse a link that is larger than an arm's."""
    away = float(np.linalg.norm(vertices, axis=1).max(initial=0.0))
    if not away <= FARTHEST:
        which = f"link behind {joint}" if joint else "foot"
        problem = (
            f"the mesh of its {which} reaches {away:.3g} m from there, and a link of this arm less than {FARTHEST:g} m"
        )
        raise UnusableMeshesError(path, problem)


def _compare(path: Path, ours: _Links, theirs: _Links, home: Array) -> None:
    """Refuse an arm whose links stand elsewhere, from the base, when its joints are the same."""
    random = np.random.default_rng(0)
    for sway in (0.0, *[SWAY] * (POSES - 1)):
        joints = home + random.uniform(-sway, sway, len(home))
        ours.move(joints)
        theirs.move(joints)
        for joint in ours.joints:
            (place, turn), (other_place, other_turn) = ours.pose(joint), theirs.pose(joint)
            away = float(np.linalg.norm(place - other_place))
            # the angle between two turns, from the trace of the one that is between them
            turned = float(np.degrees(np.arccos(np.clip(0.5 * (np.sum(turn * other_turn) - 1.0), -1.0, 1.0))))
            if away > AWAY or turned > TURNED:
                problem = f"its link behind {joint} stands {1e3 * away:.1f} mm and {turned:.1f} degrees elsewhere"
                raise UnusableMeshesError(path, f"{problem} than that of the description: it is another arm or version")


class _Links:
    """The links of a model by the joints that move them; that of the base, which none moves, by ""."""

    def __init__(self, model: Any, joints: list[str]) -> None:
        self._model, self._data, self.joints = model, load_mujoco().MjData(model), joints
        self._bodies = {joint: int(model.joint(joint).bodyid[0]) for joint in joints}
        self._bodies[""] = int(model.body_parentid[self._bodies[joints[0]]])

    def move(self, angles: Array) -> None:
        """Put the joints at angles [rad]."""
        for joint, angle in zip(self.joints, angles, strict=True):
            self._data.joint(joint).qpos = angle
        load_mujoco().mj_kinematics(self._model, self._data)

    def link_of(self, body: int) -> str:
        """The joint that moves a body; "" where none does."""
        while body and not self._model.body_jntnum[body]:
            body = int(self._model.body_parentid[body])
        return str(self._model.joint(self._model.body_jntadr[body]).name) if body else ""

    def pose(self, joint: str) -> tuple[Array, Array]:
        """Place [m] and turn (3, 3) of a link in the frame of the base."""
        base, body = self._bodies[""], self._bodies[joint]
        turn = self._data.xmat[base].reshape(3, 3)
        return (self._data.xpos[body] - self._data.xpos[base]) @ turn, turn.T @ self._data.xmat[body].reshape(3, 3)

    def mesh(self, joint: str) -> LinkMesh:
        """All that is seen of a link, and of what is fixed to it, in its frame."""
        model, data, body = self._model, self._data, self._bodies[joint]
        vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0
        for geom in range(model.ngeom):
            if self.link_of(int(model.geom_bodyid[geom])) != joint:
                continue
            mesh = int(model.geom_dataid[geom])
            first, first_face = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
            corners = model.mesh_vert[first : first + model.mesh_vertnum[mesh]].astype(np.float64)
            places = corners @ data.geom_xmat[geom].reshape(3, 3).T + data.geom_xpos[geom]
            vertices.append((places - data.xpos[body]) @ data.xmat[body].reshape(3, 3))
            faces.append(count + model.mesh_face[first_face : first_face + model.mesh_facenum[mesh]].astype(np.int64))
            count += len(corners)
        return LinkMesh(np.concatenate(vertices), np.concatenate(faces))


def _first(error: Exception) -> str:
    return str(error).splitlines()[0]
