"""A surface whose heights become known at run time: a field of heights that is moved in place."""

from __future__ import annotations

import math

import numpy as np

from foretouch.core import compiled, kernel
from foretouch.models.shape_field import CORNER, LENGTH, ShapeField, basis
from foretouch.rendering.surfaces.geometry import FACE, Array, Triangle
from foretouch.rendering.surfaces.god_object import MESH, Mesh
from foretouch.rendering.surfaces.mesh import HeightField

SPACING = 3e-3
NODES = round(LENGTH / SPACING) + 1  # Vertices along each side

LARGEST_STEP = 1e-5
"""Largest motion of a vertex in one tick [m]: two neighbours turn the normal by 7 mrad, which turns 10 N by 0.07 N."""

SMALLEST = 2e-6
"""Distance from its height below which a vertex rests [m]: it need not follow every digit of what is learnt."""

FAR_STEP = 1e-4  # The same of one that the probe is nowhere near, and that is moved in turn [m]
NEAR, ROWS = 4, 5  # Vertices to each side of the probe that move in every tick, and rows of the others

STEEPEST, RELIEF = 0.5, 0.02
"""Sine of the largest slope that is expected of a surface that nobody knows, and its extent [m]."""


@compiled(error_model="numpy")
def _write_unit(normal: Array, x: float, y: float, z: float) -> None:
    """Write a direction, of length 1."""
    length = math.sqrt(x * x + y * y + z * z)
    normal[0], normal[1], normal[2] = x / length, y / length, z / length


@compiled(error_model="numpy")
def _turn_face(triangle: Triangle, vertices: Array) -> None:
    """Take the corners' heights, and the face's normal from them."""
    c = triangle.corners
    for k in range(3):
        c[k, 2] = vertices[triangle.vertices[k], 2]
    ax, ay, az = c[1, 0] - c[0, 0], c[1, 1] - c[0, 1], c[1, 2] - c[0, 2]
    bx, by, bz = c[2, 0] - c[0, 0], c[2, 1] - c[0, 1], c[2, 2] - c[0, 2]
    _write_unit(triangle.normals[FACE], ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


@compiled(error_model="numpy")
def _turn_corner(mesh: Mesh, corner: int) -> None:
    """Take a corner's normal from the faces about it, by their area: seen from above each has the same."""
    x = y = z = 0.0
    for f in range(mesh.starts[corner], mesh.starts[corner + 1]):
        face = mesh.triangles[mesh.fans[f]].normals[FACE]
        x, y, z = x + face[0] / face[2], y + face[1] / face[2], z + 1.0
    for f in range(mesh.starts[corner], mesh.starts[corner + 1]):
        triangle = mesh.triangles[mesh.fans[f]]
        for k in range(3):
            if triangle.vertices[k] == corner:
                _write_unit(triangle.normals[k], x, y, z)


@compiled(error_model="numpy")
def _turn_edges(mesh: Mesh, triangle: Triangle) -> None:
    """Take the normals of the edges: each the mean of both its faces."""
    own = triangle.normals[FACE]
    for k in range(3):
        beyond = triangle.neighbours[k]
        other = mesh.triangles[beyond].normals[FACE] if beyond >= 0 else own
        _write_unit(triangle.normals[3 + k], own[0] + other[0], own[1] + other[1], own[2] + other[2])


@compiled(error_model="numpy")
def _move_part(mesh: Mesh, vertices: Array, heights: Array, part: tuple[int, int, int, int], step: float) -> bool:
    """Move the vertices of some rows and columns, these two numbers of each included; whether any moved."""
    top, bottom, left, right = part
    moved = False
    for i in range(top, bottom + 1):
        for j in range(left, right + 1):
            n = NODES * i + j
            away = heights[n] - vertices[n, 2]
            if abs(away) > SMALLEST:
                vertices[n, 2] += min(max(away, -step), step)
                moved = True
    if not moved:
        return False
    half = mesh.triangles.shape[0] // 2  # of each cell one triangle is in the first half, and one in the second
    for ring in range(1, 3):
        for i in range(max(top - ring, 0), min(bottom + ring, NODES - 1)):
            for j in range(max(left - ring, 0), min(right + ring, NODES - 1)):
                for t in range((NODES - 1) * i + j, 2 * half, half):
                    if ring == 1:
                        _turn_face(mesh.triangles[t], vertices)
                    else:
                        _turn_edges(mesh, mesh.triangles[t])
    for i in range(max(top - 1, 0), min(bottom + 2, NODES)):
        for j in range(max(left - 1, 0), min(right + 2, NODES)):
            _turn_corner(mesh, NODES * i + j)
    return True


@kernel(f"b1({MESH}, f8[:, ::1], f8[::1], f8, f8, i8)", Triangle)
def move(mesh: Mesh, vertices: Array, heights: Array, x: float, y: float, turn: int) -> bool:
    """Move the vertices about a probe towards their heights, and in turn some of the others; whether any moved.

    Args:
        mesh: A field of heights, written.
        vertices: Its vertices, written.
        heights: Where they belong [m].
        x: Place of the probe, seen from above [m].
        y: The same.
        turn: Number of the call.
    """
    i = min(max(int((x - CORNER[0]) / SPACING), 0), NODES - 1) if math.isfinite(x) else 0
    j = min(max(int((y - CORNER[1]) / SPACING), 0), NODES - 1) if math.isfinite(y) else 0
    near = max(i - NEAR, 0), min(i + NEAR + 1, NODES - 1), max(j - NEAR, 0), min(j + NEAR + 1, NODES - 1)
    moved = _move_part(mesh, vertices, heights, near, LARGEST_STEP)
    first = ROWS * (turn % (1 + (NODES - 1) // ROWS))
    far = first, min(first + ROWS, NODES) - 1, 0, NODES - 1
    apart = far[1] < near[0] or far[0] > near[1]
    return _move_part(mesh, vertices, heights, far, FAR_STEP if apart else LARGEST_STEP) or moved


_ALONG = basis(SPACING * np.arange(NODES))  # of the vertices along one side


def surface_of(field: ShapeField) -> HeightField:
    """The surface of heights that are known, which does not move."""
    return HeightField(_ALONG @ field.coefficients @ _ALONG.T, SPACING, CORNER)


class LearntSurface(HeightField):
    """A surface that nobody knew, flat at first; its vertices move in place to what is learnt of their heights.

    Lines that follow it see the same triangles: after a move each has to follow its newest position again.

    Attributes:
        field: What is known of the heights.
    """

    def __init__(self) -> None:
        super().__init__(np.zeros((NODES, NODES)), SPACING, CORNER)
        self.field = ShapeField()
        self._heights, self._half = np.zeros(NODES * NODES), np.zeros((NODES, _ALONG.shape[1]))
        self._move, self._turn = move.entry, 0

    def aim(self) -> None:
        """Let the vertices go to where the field has them."""
        np.matmul(_ALONG, self.field.coefficients, out=self._half)
        np.matmul(self._half, _ALONG.T, out=self._heights.reshape(NODES, NODES))
        boxes, heights = self.mesh.shape.boxes, self.mesh.vertices[:, 2]
        boxes[:, 2] = min(heights.min(), self._heights.min())  # they hold it on all of its way there
        boxes[:, 5] = max(heights.max(), self._heights.max())

    def settle(self, x: float, y: float) -> bool:
        """Move them there by a step, with the probe at this place seen from above [m]; whether any moved."""
        self._turn += 1
        return self._move(self.mesh.shape, self.mesh.vertices, self._heights, x, y, self._turn)

    def relief(self) -> tuple[float, float]:
        """What is expected of a surface that nobody knows; see `Surface.relief`."""
        return STEEPEST, RELIEF
