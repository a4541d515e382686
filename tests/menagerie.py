"""A small stand-in of MuJoCo Menagerie: the arms with boxes for meshes, in files of the same structure.

The real meshes were never here: what is tested with this is the way that they take, not how they look.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from foretouch.robot import ARM_MESHES, read_arm

Array = NDArray[np.float64]

CORNERS = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (0.0, 1.0)])
QUADS = ((0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3))
FACES = np.array([(a, *two) for a, b, c, d in QUADS for two in ((b, c), (c, d))])
FILE_FRAME = np.array((0.03, -0.02, 0.05)), np.array((0.8, 0.2, -0.4, 0.4))
"""Place [m] and turn of a geom, in which the vertices of its file are."""


def write_arm(name: str, folder: Path, *, fine: int = 1) -> dict[str, Array]:
    """Write an arm as Menagerie has it, below a folder, and give the vertices of each body in its own frame [m].

    Args:
        name: Of the arm.
        folder: What a checkout of Menagerie would be.
        fine: Triangles along the edge of a box's face, so that a mesh may be as large as a real one.
    """
    here = folder / ARM_MESHES[name].local_folder
    (here / "assets").mkdir(parents=True)
    suffix = ".stl" if name == "so101" else ".obj"
    root = ET.parse(read_arm(name).path).getroot()
    for tag in ("default", "actuator", "keyframe", "custom"):
        for element in root.findall(tag):
            root.remove(element)
    root.find("compiler").attrib |= {"meshdir": "assets", "autolimits": "true"}  # type: ignore[union-attr]
    root.insert(0, ET.fromstring('<default><default class="visual"><geom type="mesh" contype="0" conaffinity="0" '
                                 'group="2"/></default><default class="collision"><geom type="mesh" group="3"/>'
                                 '</default></default>'))  # fmt: skip
    assets, motors = ET.SubElement(root, "asset"), ET.SubElement(root, "actuator")
    ET.SubElement(assets, "mesh", name="coarse", file="coarse.stl")  # for contacts: never asked for
    expected: dict[str, Array] = {}
    for body in list(root.iter("body")):
        expected[body.attrib["name"]] = _dress(body, assets, here / "assets", suffix, fine)
        for joint in body.findall("joint"):
            joint.attrib.pop("class", None)
            if joint.attrib["name"].endswith("_backlash"):
                body.remove(joint)
            else:
                joint.attrib["axis"] = joint.attrib.get("axis", "0 1 0" if name == "ur5e" else "0 0 1")
                ET.SubElement(motors, "position", name=joint.attrib["name"], joint=joint.attrib["name"], kp="100")
        for site in body.findall("site"):
            body.remove(site)
    if name == "fr3":
        _behind_a_plain_base(root)
    if name == "so101":
        _with_a_jaw(root, motors)
    ET.ElementTree(root).write(here / f"{name}.xml")
    return expected


def _dress(body: Any, assets: Any, folder: Path, suffix: str, fine: int) -> Array:
    """Boxes for the capsules of a body, the first with a coarse mesh for contacts; the vertices."""
    all_vertices = []
    for number, geom in enumerate(body.findall("geom")):
        body.remove(geom)
        ends = np.array(geom.attrib["fromto"].split(), float)
        vertices, faces = box(ends[:3], ends[3:], float(geom.attrib["size"]), fine)
        mesh = f"{body.attrib['name']}_{number}"
        place, turn = FILE_FRAME
        write_mesh(folder / f"{mesh}{suffix}", (vertices - place) @ turned(turn), faces)
        ET.SubElement(assets, "mesh", file=f"{mesh}{suffix}")
        frame = {"pos": " ".join(map(str, place)), "quat": " ".join(map(str, turn))}
        ET.SubElement(body, "geom", {"class": "visual", "mesh": mesh} | frame)
        all_vertices.append(vertices)
    ET.SubElement(body, "geom", {"class": "collision", "mesh": "coarse"})
    return np.concatenate(all_vertices)


def _behind_a_plain_base(root: Any) -> None:
    """The FR3's foot is a body of its own in a base that has nothing."""
    world = root.find("worldbody")
    foot = world.find("body")
    world.remove(foot)
    foot.attrib["name"] = "fr3_link0"
    ET.SubElement(world, "body", name="base").append(foot)


def _with_a_jaw(root: Any, motors: Any) -> None:
    """The SO-101 has a jaw with a motor of its own, and a camera on its gripper."""
    gripper = next(body for body in root.iter("body") if body.attrib["name"] == "gripper")
    jaw = ET.SubElement(gripper, "body", name="moving_jaw_so101_v1", pos="0.02 0.02 -0.02", quat="1 1 0 0")
    ET.SubElement(jaw, "inertial", pos="0 0 0", mass="0.01", diaginertia="1e-6 1e-6 1e-6")
    ET.SubElement(jaw, "joint", name="gripper", axis="0 0 1")
    ET.SubElement(jaw, "geom", {"class": "visual", "mesh": "gripper_0"})
    ET.SubElement(motors, "position", name="gripper", joint="gripper", kp="100")


def turned(quaternion: Array) -> Array:
    """The matrix (3, 3) of a quaternion, real part first."""
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion / np.linalg.norm(quaternion))
    return matrix.reshape(3, 3)


def box(begin: Array, end: Array, radius: float, fine: int = 1) -> tuple[Array, NDArray[np.int64]]:
    """A box about a capsule, wider one way than the other, so that no two of its axes are alike."""
    way = (end - begin) / np.linalg.norm(end - begin)
    across = np.cross(way, np.eye(3)[int(np.argmin(np.abs(way)))])
    across /= np.linalg.norm(across)
    frame = np.stack([radius * across, 0.8 * radius * np.cross(way, across), end - begin + 2.0 * radius * way])
    vertices, faces = CORNERS, FACES
    if fine > 1:
        from trimesh.remesh import subdivide

        while len(faces) < 12 * fine**2:
            vertices, faces = subdivide(vertices, faces)
    return vertices @ frame + begin - radius * way, faces


def write_mesh(path: Path, vertices: Array, faces: NDArray[np.int64]) -> None:
    """Write triangles as OBJ text or binary STL."""
    if path.suffix == ".obj":
        lines = [*(f"v {x:.9f} {y:.9f} {z:.9f}" for x, y, z in vertices), *(f"f {a} {b} {c}" for a, b, c in faces + 1)]
        path.write_text("\n".join(lines) + "\n")
        return
    triangles = np.zeros(len(faces), [("normal", "<3f4"), ("corners", "<(3,3)f4"), ("attribute", "<u2")])
    triangles["corners"] = vertices[faces]
    path.write_bytes(bytes(80) + np.uint32(len(faces)).tobytes() + triangles.tobytes())
