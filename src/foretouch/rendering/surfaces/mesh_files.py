"""Meshes from files: read, repaired, or refused with a message of one line; and with colours into PLY files.

STL as text is read line by line, for trimesh skips what it cannot read, and a hole in a surface is felt.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError, MissingExtraError, SettingError
from foretouch.errors.checks import require
from foretouch.files import within_budget
from foretouch.quantities import wrong_frame
from foretouch.rendering.surfaces.mesh import LARGEST_COORDINATE, TriangleMesh

Array = NDArray[np.float64]

FACET: Final = ("facet normal", "outer loop", "vertex", "vertex", "vertex", "endloop", "endfacet")
"""First words of the lines of a triangle; a normal and each vertex have three numbers after them."""

_head = struct.Struct("<80sI")  # of a binary file: a free text, and the number of triangles of 50 bytes that follow


def is_text_stl(file: Path) -> bool:
    """Whether an STL is text: it begins with ``solid``, and its length is not that of its binary header."""
    if file.suffix.lower() != ".stl":
        return False
    with file.open("rb") as opened:
        head = opened.read(_head.size)
    if len(head) == _head.size and file.stat().st_size == _head.size + 50 * _head.unpack(head)[1]:
        return False
    return head.lstrip().lower().startswith(b"solid")


def read_text_stl(file: Path) -> Array:
    """Corners of the triangles, three each, shape (3 n, 3).

    Raises:
        InputError: A line is out of place, or its numbers are not numbers; the message names it.
    """
    corners: list[float] = []
    index = 0
    with file.open(encoding="ascii", errors="replace") as lines:
        for number, line in enumerate(lines, 1):
            words = line.split()
            if not words or (index == 0 and words[0].lower() in ("solid", "endsolid")):
                continue
            wanted = FACET[index]
            length = len(wanted.split())
            values = _numbers(words[length:])
            right = " ".join(words[:length]).lower() == wanted
            if not right or len(values) != (3 if wanted in ("vertex", "facet normal") else 0) or None in values:
                shown = " ".join(words)[:60]
                rule = f"this line of an STL is to be {wanted!r}" + " and three numbers" * (index in (0, 2, 3, 4))
                raise InputError(f"{file}, row {number}: {shown!r}: {rule}: export it again")
            if wanted == "vertex":
                corners += values  # type: ignore[arg-type]
            index = (index + 1) % len(FACET)
    if index:
        raise InputError(f"{file}: it ends within a triangle: it is cut off")
    return np.array(corners).reshape(-1, 3)


def _numbers(words: list[str]) -> list[float | None]:
    """None for a word that is not a number."""
    values: list[float | None] = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError:
            values.append(None)
    return values


FORMATS = (".stl", ".obj", ".ply")  # Suffixes of the files that are read

WITHOUT = {
    ".stl": "there is no triangle in it",
    ".obj": "it is a cloud of points without a triangle, or cut off",
    ".ply": "it is a cloud of points without a triangle",
}
"""What a file is in which no triangle was found, by its suffix: only OBJ does not say how long it is."""

MOST_TRIANGLES = 1_000_000
"""Largest number of triangles; larger meshes must be reduced first, as a hand does not feel the difference."""

MOST_BYTES = 400_000_000  # Size above which files are refused unread [bytes]: that of a million triangles as text


def read_mesh(
    path: str | Path, *, scale: float = 1.0, closed: bool = False, budget: float | None = None
) -> TriangleMesh:
    """Read a mesh and repair it.

    Vertices at one position are merged, faces without area and duplicate faces are removed, triangles are wound alike
    and outwards, and small holes (of three or four edges) are filled where that leaves a surface.

    Args:
        path: STL, OBJ or PLY file.
        scale: Size of a unit of the file [m]: 0.001 for millimetres.
        closed: Refuse a mesh that still has a border.
        budget: Factor on the usual memory and time for reading (`foretouch.files.budget_for`).

    Raises:
        InputError: There is no such file or no mesh, it is still broken, or over the budget; the line says where and
            what to do.
        MissingExtraError: trimesh is not installed.
    """
    require("scale", scale, above=0.0)
    file = Path(path)
    if file.suffix.lower() not in FORMATS:
        raise InputError(f"{file}: meshes are read from {', '.join(FORMATS)}: convert it")
    if not file.is_file():
        raise InputError(f"{file}: {'this is no file' if file.exists() else 'no such file'}")
    vertices, faces = within_budget(file, budget, _triangles, file, scale)
    try:
        surface = TriangleMesh(vertices, faces)
    except SettingError as error:
        raise InputError(f"{file}: still no surface after repair: {error}") from None
    if closed and not surface.closed:
        raise InputError(f"{file}: the mesh has holes that are too large to fill: close it in a mesh editor")
    return surface


def _triangles(file: Path, scale: float) -> tuple[Array, NDArray[np.int64]]:
    mesh = _loaded(file)
    mesh.apply_scale(scale)
    _check_unit(mesh, file)
    mesh = _repaired(mesh, file)
    return np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int64)


def first_hit_from_above(mesh: TriangleMesh, x: float, y: float) -> int:
    """Index of the triangle that a ray straight down (-z) hits first, from either side; -1 if it hits none.

    Only triangles about the ray at x, y [m] are tested: a large mesh needs no search tree.

    Raises:
        MissingExtraError: trimesh is not installed.
    """
    corners = mesh.vertices[mesh.faces]
    position = np.array([x, y])
    about = np.flatnonzero(
        ((corners[..., :2].min(axis=1) <= position) & (position <= corners[..., :2].max(axis=1))).all(axis=1)
    )
    if not about.size:
        return -1
    part, above = _trimesh().Trimesh(mesh.vertices, mesh.faces[about], process=False), corners[about, :, 2].max() + 1.0
    (hit,) = part.ray.intersects_first([[x, y, float(above)]], [[0.0, 0.0, -1.0]])
    return -1 if hit < 0 else int(about[hit])


def _trimesh() -> Any:
    try:
        import_module("networkx")  # trimesh's repairs need it
        return import_module("trimesh")
    except ImportError as error:
        raise MissingExtraError(error.name or "trimesh", "mesh") from None


def _check_unit(mesh: Any, file: Path) -> None:
    farthest = float(np.abs(mesh.vertices).max())
    if farthest > LARGEST_COORDINATE:
        raise InputError(
            f"{file}: it reaches to {farthest:g} m, at most {LARGEST_COORDINATE:g} m is taken: give it in metres "
            "(scale by 0.001 what is in millimetres)"
        )


def _loaded(file: Path) -> Any:
    trimesh = _trimesh()
    if file.stat().st_size > MOST_BYTES:
        raise InputError(
            f"{file}: {file.stat().st_size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} MB are read: reduce the mesh"
        )
    if fault := _fault_of_length(file):
        raise InputError(f"{file}: {fault}: export it again")
    try:
        if is_text_stl(file):
            corners = read_text_stl(file)
            mesh = trimesh.Trimesh(corners, np.arange(len(corners)).reshape(-1, 3), process=False)
        else:
            mesh = trimesh.load(file, force="mesh", process=False, file_type=file.suffix.lower()[1:])
    except InputError:
        raise
    except Exception as error:  # readers of foreign file formats raise all kinds of errors
        raise InputError(f"{file}: no mesh could be read from it ({_short(error)})") from None
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise InputError(f"{file}: {WITHOUT[file.suffix.lower()]}: export it as a mesh of triangles")
    _check_count(mesh, file)
    if not np.isfinite(mesh.vertices).all():
        raise InputError(f"{file}: some coordinates are no finite numbers: export it again")
    return mesh


def _fault_of_length(file: Path) -> str:
    """What the length of a file has against it before its content is read; "" for nothing."""
    size, ending = file.stat().st_size, file.suffix.lower()
    if size == 0:
        return "the file is empty"
    if ending == ".ply":
        with file.open("rb") as opened:
            whole = b"end_header" in opened.read(LONGEST_HEAD)
        return "" if whole else "its head has no end: it is cut off, or no PLY"
    if ending != ".stl" or is_text_stl(file):
        return ""
    if size < _head.size:
        return "it ends within its head: it is cut off, or no STL"
    with file.open("rb") as opened:
        said = _head.unpack(opened.read(_head.size))[1]
    there = (size - _head.size) / 50
    return (
        ""
        if there == said
        else f"its head says {said:,} triangles, and {there:,.5g} are there: it is cut off, or no STL"
    )


def _repaired(mesh: Any, file: Path) -> Any:
    try:
        mesh.merge_vertices(merge_tex=True, merge_norm=True)
        mesh.update_faces(mesh.nondegenerate_faces())
        mesh.update_faces(mesh.unique_faces())
        mesh.remove_unreferenced_vertices()
        repair = _trimesh().repair
        repair.fix_winding(mesh)
        if len(mesh.faces):
            mesh = _filled(mesh)
        if mesh.is_watertight:
            repair.fix_normals(mesh, multibody=True)
    except Exception as error:
        raise InputError(f"{file}: the mesh could not be repaired ({_short(error)}): export it again") from None
    if len(mesh.faces) == 0:
        raise InputError(f"{file}: no triangle in it has an area: is it in metres?")
    _check_count(mesh, file)  # of loose triangles each is a filled hole, too
    return mesh


def _check_count(mesh: Any, file: Path) -> None:
    if len(mesh.faces) > MOST_TRIANGLES:
        raise InputError(f"{file}: {len(mesh.faces)} triangles, at most {MOST_TRIANGLES} are taken: reduce it")


def _filled(mesh: Any) -> Any:
    """The mesh with small holes filled; unchanged where touching holes would give an edge a third triangle."""
    vertices, faces = mesh.vertices.copy(), mesh.faces.copy()
    _trimesh().repair.fill_holes(mesh)
    if np.bincount(mesh.edges_unique_inverse).max() <= 2:
        return mesh
    return _trimesh().Trimesh(vertices, faces, process=False)


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120] or type(error).__name__


FRAME = "frame"  # First word of the comment in a PLY file's head that names the frame of its vertices

LONGEST_HEAD = 65_536  # Beginning of a file in which comments are looked for [bytes]: a head takes a few hundred


def coloured_mesh(
    vertices: Array,
    faces: NDArray[np.int64],
    colours: NDArray[np.uint8],
    values: Mapping[str, Array],
    frame: str,
    comments: Sequence[str] = (),
) -> bytes:
    """Content of a binary PLY file: single precision, which is what viewers of meshes read.

    Args:
        vertices: Shape (n, 3) [m].
        faces: Indices of vertices, shape (m, 3).
        colours: Red, green, blue and opacity of each vertex, shape (n, 4).
        values: Named numbers of each vertex, each of shape (n,).
        frame: Name of the vertices' frame, which a comment of the file's head says.
        comments: More of them, each a line of ASCII; `said_in_head` finds them again by the first word.

    Raises:
        MissingExtraError: trimesh is not installed.
    """
    mesh = _trimesh().Trimesh(vertices, faces, process=False, vertex_colors=colours)
    mesh.vertex_attributes.update({name: np.asarray(value, np.float32) for name, value in values.items()})
    content: bytes = mesh.export(file_type="ply")
    kind, encoding, rest = content.split(b"\n", 2)
    said = [f"comment {comment}".encode("ascii") for comment in (f"{FRAME} {frame}", *comments)]
    return b"\n".join((kind, encoding, *said, rest))


def said_in_head(path: Path, word: str) -> list[str]:
    """What the comments in the head of a PLY file say that begin with a word, without it; none where there is none."""
    with path.open("rb") as file:
        head = file.read(LONGEST_HEAD).partition(b"end_header")[0]
    begin = f"comment {word} ".encode()
    return [line.removeprefix(begin).decode(errors="replace") for line in head.splitlines() if line.startswith(begin)]


def read_vertex_values(path: Path, *names: str, frame: str) -> tuple[Array, dict[str, Array]]:
    """Vertices [m] of a PLY file, shape (n, 3), and its named numbers, each of shape (n,).

    Args:
        path: Of the file.
        *names: Of the numbers.
        frame: The frame in which its vertices have to be; a file that says none is taken to be in it.

    Raises:
        InputError: No such file, no PLY file, one without these numbers, a number in it that is none, or another frame.
        MissingExtraError: trimesh is not installed.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: {path.stat().st_size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} MB are read")
    trimesh, said = _trimesh(), next(iter(said_in_head(path, FRAME)), "").strip()[:40]
    if said not in ("", frame):
        raise InputError(f"{path}: {wrong_frame(said, frame)}")
    try:
        loaded = trimesh.load(path, process=False, file_type="ply")  # points without a triangle are a map, too
        rows = loaded.metadata["_ply_raw"]["vertex"]["data"]
        known = rows.dtype.names or ()
        vertices = np.stack([np.asarray(rows[axis], np.float64) for axis in "xyz"], axis=1)
    except KeyError:
        raise InputError(f"{path}: no mesh could be read from it: no vertex is in it") from None
    except Exception as error:  # readers of foreign file formats raise all kinds of errors
        raise InputError(f"{path}: no mesh could be read from it ({_short(error)})") from None
    if missing := [name for name in names if name not in known]:
        raise InputError(f"{path}: its vertices have no {' and no '.join(missing)}: it is no map of touches")
    values = {name: np.asarray(rows[name], np.float64) for name in names}
    if not all(np.isfinite(column).all() for column in (vertices, *values.values())):
        raise InputError(f"{path}: a number in it is none")
    return vertices, values
