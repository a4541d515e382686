"""A map of what was touched, as a file: the stiffness of each place, of one session or of several."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import InputError, printable
from foretouch.messages import SessionLog
from foretouch.models import FIELD_DEPTH, stiffness_at_rest
from foretouch.models.scale_field_kernel import SIDE, SPACING
from foretouch.quantities import FIXTURE, Array, ByValue
from foretouch.rendering.surfaces.mesh_files import coloured_mesh, read_vertex_values, said_in_head
from foretouch.report.rows import model_of
from foretouch.report.scene.map import height_of, learnt_field
from foretouch.report.scene.shape import scene_of
from foretouch.session.spatial import make_scene
from foretouch.session.spatial.scenes import LARGEST_SIDE, MIDDLE, REACH
from foretouch.settings import UNKNOWN

SAME_SURFACE = 1e-3  # Largest difference in height of one place of two maps [m]: half of what local stiffness is of

LEAST, MOST = 0.1, 1e7
"""Local stiffness of places that can have been touched [N/m]: no sensor feels the one, 0.2 mN at 2 mm, and no robot
presses the other, 20 kN at 2 mm and a hundred times bone under a probe."""

VALUES = "stiffness", "deviation"

SESSION = "session"  # First word of the comment in a map's head that names one of the sessions that it is made of

MOST_SESSIONS = 500  # In one map: as many as are surely found in the beginning of a file that is searched for them


@dataclass(frozen=True, eq=False)
class TouchedMap(ByValue):
    """Local stiffness at the places that were touched, 3 mm apart, in the fixture's frame.

    Attributes:
        points: Of the surface, shape (n, 3) [m].
        stiffness: Local stiffness at rest, 2 mm deep, shape (n,) [N/m], positive.
        deviation: Standard deviation of its logarithm, shape (n,): a relative one.
        sessions: Those that it is made of: the name of the scene of each, "" where nothing says it, by an identity
            that depends on no file's name.
    """

    points: Array
    stiffness: Array
    deviation: Array
    sessions: Mapping[str, str] = field(default_factory=dict)

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
        InputError: A session along a line, one that has learnt nothing, or places or a stiffness that cannot be.
        ForetouchError: Its scene is not here.
    """
    name = str((log.settings or {}).get("scene", ""))
    if not name:
        raise InputError("it was recorded along a line, without a surface: give a session with --scene")
    learnt = learnt_field(log)
    newest = next((model for model in reversed(log.models) if model_of(model) is not None), None)
    law = None if newest is None else model_of(newest)
    if learnt is None or law is None or newest is None:
        raise InputError("nothing was learnt of a surface in it: give a session that has pressed and slid on one")
    scene, known = scene_of(log) if name == UNKNOWN else make_scene(name), learnt.touched
    if scene is None:
        raise InputError("nothing was learnt of its shape")
    places = SPACING * (known - SIDE // 2)
    points = np.array([(x, y, height_of(scene, x, y)) for x, y in places.tolist()])
    scales, deviations = learnt.scales_at(points)
    deeper = newest.surface if math.isfinite(newest.surface) else 0.0
    slope = stiffness_at_rest(law, max(FIELD_DEPTH - deeper, 0.0))
    if not slope > 0.0:
        raise InputError("the law that was learnt has no stiffness 2 mm deep: it was pressed too little")
    whole = TouchedMap(points, scales * slope, deviations, {_identity(log): _shown(name)})
    _check(whole)
    return whole


def _identity(log: SessionLog) -> str:
    """Of the process that has learnt a map: a follower's epoch is unique.

    One that goes on for a second recording has kept what it learnt, so its two maps are of one session. In a simulated
    session epochs count from 1; it is told by its settings, for the same ones make the same session again.
    """
    simulated = next((sorted(one.settings.items()) for one in log.reports if one.role == "simulation"), [])
    return _digest(json.dumps([log.fields[-1].run, simulated]).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()[:16]


def _shown(scene: str) -> str:
    """A scene's name, or that of its file without the folder, as a short line of ASCII."""
    return printable(Path(scene).name).encode("ascii", "replace").decode()[:40]


def _check(touched: TouchedMap, path: Path | None = None) -> None:
    """Raise `InputError` for a map of places that no scene has, or of a stiffness that nothing has."""
    where = "" if path is None else f"{path}: "
    middle, reach = np.array(MIDDLE), np.array([0.5 * LARGEST_SIDE + REACH] * 2 + [LARGEST_SIDE + REACH])
    away = touched.points - middle
    outside = (np.abs(away) > reach).any(axis=1) | (away[:, 2] > REACH)
    if outside.any():
        x, y, z = touched.points[int(outside.argmax())]
        raise InputError(
            f"{where}no specimen can be at ({x:.3g}, {y:.3g}, {z:.3g}) m, only within {reach[0]:g} m of {MIDDLE[:2]}, "
            f"at most {REACH:g} m high: give it in metres, in the fixture (scale by 0.001 what is in millimetres)"
        )
    least, most = float(touched.stiffness.min(initial=MOST)), float(touched.stiffness.max(initial=LEAST))
    if least < LEAST or most > MOST:
        wrong = least if least < LEAST else most
        rule = f"only {LEAST:g} to {MOST:g} N/m can be felt: give it in N/m"
        raise InputError(f"{where}a stiffness in it is {wrong:.3g} N/m, and {rule}")


def merged(maps: Sequence[TouchedMap], names: Sequence[str] = ()) -> TouchedMap:
    r"""One map of several of the same surface.

    .. math::
        \ln K = \frac{\sum_i w_i \ln K_i}{\sum_i w_i}, \quad w_i = \frac{1}{\sigma_i^2}, \quad
        \sigma^2 = \frac{1}{\sum_i w_i} \max\left(1, \frac{\sum_i w_i (\ln K_i - \ln K)^2}{n - 1}\right)

    where n of them have touched a place: what they do not agree about is known less (Birge (1932), The calculation of
    errors by the method of least squares, Physical Review 40(2), (9)).

    Args:
        maps: Of different sessions.
        names: What a refusal calls them, their files for example; else it gives their numbers.

    Raises:
        InputError: None at all; two that hold one session, which would count twice; more than 500 sessions; or two of
            other surfaces: a place that both have touched differs in height by 1 mm.
    """
    if not maps:
        raise InputError("no map to merge")
    sessions = _of_all(maps, names or [f"map {number}" for number in range(1, len(maps) + 1)])
    nodes, place = np.unique(np.concatenate([each.nodes for each in maps]), axis=0, return_inverse=True)
    place, count = place.ravel(), len(nodes)
    points = np.concatenate([each.points for each in maps])
    logs = np.log(np.concatenate([each.stiffness for each in maps]))
    weights = np.concatenate([each.deviation for each in maps]) ** -2.0
    seen = np.bincount(place, minlength=count)
    height = np.bincount(place, points[:, 2], count) / seen
    apart = float(np.abs(points[:, 2] - height[place]).max())
    if 2.0 * apart > SAME_SURFACE:
        differs = f"the height of one place differs by {2e3 * apart:.3g} mm"
        raise InputError(f"maps of other surfaces: {differs}: merge maps of one specimen")
    total = np.bincount(place, weights, count)
    mean = np.bincount(place, weights * logs, count) / total
    scatter = np.bincount(place, weights * (logs - mean[place]) ** 2, count) / np.maximum(seen - 1, 1)
    variance = np.maximum(scatter, 1.0) / total
    flat = SPACING * (nodes - SIDE // 2)
    return TouchedMap(np.column_stack([flat, height]), np.exp(mean), np.sqrt(variance), sessions)


def _of_all(maps: Sequence[TouchedMap], names: Sequence[str]) -> dict[str, str]:
    """All sessions of several maps; raise `InputError` where one is in two of them, or there are too many."""
    holders: dict[str, str] = {}
    for each, name in zip(maps, names, strict=True):
        if twice := [holders[session] for session in each.sessions if session in holders]:
            rule = "it would count twice: give each session once"
            raise InputError(f"{name}: a session in it is in {twice[0]}, too, and {rule}")
        holders |= dict.fromkeys(each.sessions, name)
    if len(holders) > MOST_SESSIONS:
        raise InputError(f"{len(holders)} sessions: one map is of at most {MOST_SESSIONS}")
    return {session: scene for each in maps for session, scene in each.sessions.items()}


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
    said = [f"{SESSION} {session} {scene}" for session, scene in touched.sessions.items()]
    return coloured_mesh(touched.points, _faces(touched.nodes), colours, values, FIXTURE, said)


def read_map(path: Path) -> TouchedMap:
    """Open a file of `map_file` again.

    One that names no session, as maps were before they did, counts as one session of its own.

    Raises:
        InputError: No such file, another kind of file, a map in another frame than the fixture's, or places or a
            stiffness that cannot be.
        MissingExtraError: trimesh is not installed.
    """
    points, values = read_vertex_values(path, *VALUES, frame=FIXTURE)
    stiffness, deviation = (values[name] for name in VALUES)
    said = [line.partition(" ") for line in said_in_head(path, SESSION)]
    own = {_digest(np.column_stack([points, stiffness, deviation]).tobytes()): ""}
    sessions = {session: _shown(scene) for session, _, scene in said if session}
    touched = TouchedMap(points, stiffness, deviation, sessions or own)
    rule = (
        f"places are {SPACING:g} m apart, each there once, with a stiffness and a deviation: merge the recordings again"
    )
    if not len(points) or not (stiffness > 0.0).all() or not (deviation > 0.0).all():
        raise InputError(f"{path}: no map of touches: {rule}")
    _check(touched, path)
    off = np.abs(points[:, :2] - SPACING * (touched.nodes - SIDE // 2)).max(initial=0.0)
    if off > 1e-5 or len(np.unique(touched.nodes, axis=0)) < len(points):
        raise InputError(f"{path}: no map of touches: {rule}")
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
