"""Meshes with a colour and measured numbers at each vertex, as PLY files."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.rendering.surfaces.mesh_reading import MOST_BYTES, _short, _trimesh

Array = NDArray[np.float64]


def coloured_mesh(
    vertices: Array, faces: NDArray[np.int64], colours: NDArray[np.uint8], values: Mapping[str, Array]
) -> bytes:
    """Content of a binary PLY file: single precision, which is what viewers of meshes read.

    Args:
        vertices: Shape (n, 3) [m].
        faces: Indices of vertices, shape (m, 3).
        colours: Red, green, blue and opacity of each vertex, shape (n, 4).
        values: Named numbers of each vertex, each of shape (n,).

    Raises:
        MissingExtraError: trimesh is not installed.
    """
    mesh = _trimesh().Trimesh(vertices, faces, process=False, vertex_colors=colours)
    mesh.vertex_attributes.update({name: np.asarray(value, np.float32) for name, value in values.items()})
    content: bytes = mesh.export(file_type="ply")
    return content


def read_vertex_values(path: Path, *names: str) -> tuple[Array, dict[str, Array]]:
    """Vertices [m] of a PLY file, shape (n, 3), and its named numbers, each of shape (n,).

    Raises:
        InputError: No such file, no PLY file, one without these numbers, or a number in it that is none.
        MissingExtraError: trimesh is not installed.
    """
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    if path.stat().st_size > MOST_BYTES:
        raise InputError(f"{path}: {path.stat().st_size / 1e6:.0f} MB, at most {MOST_BYTES / 1e6:.0f} MB are read")
    trimesh = _trimesh()
    try:
        mesh = trimesh.load(path, force="mesh", process=False, file_type="ply")
        rows = mesh.metadata["_ply_raw"]["vertex"]["data"]
        known = rows.dtype.names or ()
        vertices = np.stack([np.asarray(rows[axis], np.float64) for axis in "xyz"], axis=1)
    except Exception as error:  # readers of foreign file formats raise all kinds of errors
        raise InputError(f"{path}: no mesh could be read from it ({_short(error)})") from None
    if missing := [name for name in names if name not in known]:
        raise InputError(f"{path}: its vertices have no {' and no '.join(missing)}: it is no map of touches")
    values = {name: np.asarray(rows[name], np.float64) for name in names}
    if not all(np.isfinite(column).all() for column in (vertices, *values.values())):
        raise InputError(f"{path}: a number in it is none")
    return vertices, values
