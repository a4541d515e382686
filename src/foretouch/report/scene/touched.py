"""A map of what was touched, as a file: the stiffness of each place, of one session or of several."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError
from foretouch.messages import SessionLog
from foretouch.models import FIELD_DEPTH, stiffness_at_rest
from foretouch.models.scale_field_kernel import SIDE, SPACING
from foretouch.quantities import FIXTURE, Array, ByValue
from foretouch.rendering.surfaces.mesh_files import coloured_mesh, read_vertex_values
from foretouch.report.rows import model_of
from foretouch.report.scene.map import height_of, learnt_field
from foretouch.report.scene.shape import scene_of
from foretouch.session.spatial import make_scene
from foretouch.settings import UNKNOWN

SAME_SURFACE = 1e-3  # Largest difference in height of one place of two maps [m]: half of what local stiffness is of

VALUES = "stiffness", "deviation"


@dataclass(frozen=True, eq=False)
class TouchedMap(ByValue):
    """Local stiffness at the places that were touched, 3 mm apart, in the fixture's frame.

    Attributes:
        points: Of the surface, shape (n, 3) [m].
        stiffness: Local stiffness at rest, 2 mm deep, shape (n,) [N/m], positive.
        deviation: Standard deviation of its logarithm, shape (n,): a relative one.
    """

    points: Array
    stiffness: Array
    deviation: Array

    @property
    def nodes(self) -> NDArray[np.int64]:
        """Row and column of each place in the lattice, shape (n, 2)."""
        return np.rint(self.points[:, :2] / SPACING).astype(np.int64) + SIDE // 2


def touched_map(log: SessionLog) -> TouchedMap:
    r"""What a session in a scene has learnt, at the places that it touched.

    .. math:: K(p) = s(p)\, \frac{\partial f}{\partial d}(d, 0), \quad d = 2\,\mathrm{mm}

    with the newest law f of the material and its scale s: see `foretouch.models.ScaleField`. Of a shape that nobody
    knew the points are where it was learnt.

    Raises:
        InputError: A session along a line, or one that has learnt nothing.
        ForetouchError: Its scene is not here.
    """
    name = str((log.settings or {}).get("scene", ""))
    if not name:
        raise InputError("it was recorded along a line: there is no map of a surface in it")
    field = learnt_field(log)
    newest = next((model for model in reversed(log.models) if model_of(model) is not None), None)
    law = None if newest is None else model_of(newest)
    if field is None or law is None or newest is None:
        raise InputError("nothing was learnt of a surface in it")
    scene, known = scene_of(log) if name == UNKNOWN else make_scene(name), field.touched
    if scene is None:
        raise InputError("nothing was learnt of its shape")
    places = SPACING * (known - SIDE // 2)
    points = np.array([(x, y, height_of(scene, x, y)) for x, y in places.tolist()])
    scales, deviations = field.scales_at(points)
    deeper = newest.surface if math.isfinite(newest.surface) else 0.0
    slope = stiffness_at_rest(law, max(FIELD_DEPTH - deeper, 0.0))
    if not slope > 0.0:
        raise InputError("the law that was learnt has no stiffness 2 mm deep: it was pressed too little")
    return TouchedMap(points, scales * slope, deviations)


def merged(maps: Sequence[TouchedMap]) -> TouchedMap:
    r"""One map of several of the same surface.

    .. math::
        \ln K = \frac{\sum_i w_i \ln K_i}{\sum_i w_i}, \quad w_i = \frac{1}{\sigma_i^2}, \quad
        \sigma^2 = \frac{1}{\sum_i w_i} \max\left(1, \frac{\sum_i w_i (\ln K_i - \ln K)^2}{n - 1}\right)

    where n of them have touched a place: what they do not agree about is known less (Birge (1932), The calculation of
    errors by the method of least squares, Physical Review 40(2), (9)).

    Raises:
        InputError: None at all; or two of other surfaces: a place that both have touched differs in height by 1 mm.
    """
    if not maps:
        raise InputError("no map to merge")
    nodes, place = np.unique(np.concatenate([each.nodes for each in maps]), axis=0, return_inverse=True)
    place, count = place.ravel(), len(nodes)
    points = np.concatenate([each.points for each in maps])
    logs = np.log(np.concatenate([each.stiffness for each in maps]))
    weights = np.concatenate([each.deviation for each in maps]) ** -2.0
    seen = np.bincount(place, minlength=count)
    height = np.bincount(place, points[:, 2], count) / seen
    apart = float(np.abs(points[:, 2] - height[place]).max())
    if 2.0 * apart > SAME_SURFACE:
        raise InputError(f"maps of other surfaces: the height of one place differs by {2e3 * apart:.3g} mm")
    total = np.bincount(place, weights, count)
    mean = np.bincount(place, weights * logs, count) / total
    scatter = np.bincount(place, weights * (logs - mean[place]) ** 2, count) / np.maximum(seen - 1, 1)
    variance = np.maximum(scatter, 1.0) / total
    flat = SPACING * (nodes - SIDE // 2)
    return TouchedMap(np.column_stack([flat, height]), np.exp(mean), np.sqrt(variance))


def map_file(touched: TouchedMap) -> bytes:
    """Content of a PLY file: the surface where it was touched, coloured by stiffness, with the numbers at each vertex.

    Colours go from the least stiffness, dark blue, to the largest, yellow, by its logarithm.

    Raises:
        MissingExtraError: trimesh is not installed.
    """
    from matplotlib import colormaps  # slow to import

    logs = np.log(touched.stiffness)
    low, high = float(logs.min()), float(logs.max())
    colours = colormaps["cividis"]((logs - low) / max(high - low, 1e-9), bytes=True)
    values = dict(zip(VALUES, (touched.stiffness, touched.deviation), strict=True))
    return coloured_mesh(touched.points, _faces(touched.nodes), colours, values, FIXTURE)


def read_map(path: Path) -> TouchedMap:
    """Open a file of `map_file` again.

    Raises:
        InputError: No such file, another kind of file, or a map in another frame than the fixture's.
        MissingExtraError: trimesh is not installed.
    """
    points, values = read_vertex_values(path, *VALUES, frame=FIXTURE)
    stiffness, deviation = (values[name] for name in VALUES)
    touched = TouchedMap(points, stiffness, deviation)
    off = np.abs(points[:, :2] - SPACING * (touched.nodes - SIDE // 2)).max(initial=0.0)
    if not len(points) or not (stiffness > 0.0).all() or not (deviation > 0.0).all() or off > 1e-5:
        raise InputError(f"{path}: no map of touches: each place has a stiffness and a deviation, {SPACING:g} m apart")
    return touched


def _faces(nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Two triangles for each square of the lattice whose four corners were touched, wound upwards."""
    at = {(int(i), int(j)): index for index, (i, j) in enumerate(nodes)}
    faces = []
    for (i, j), here in at.items():
        right, beyond, across = at.get((i + 1, j)), at.get((i, j + 1)), at.get((i + 1, j + 1))
        if right is not None and beyond is not None and across is not None:
            faces += [(here, right, across), (here, across, beyond)]
    return np.array(faces, np.int64).reshape(-1, 3)
