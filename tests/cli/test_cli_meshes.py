"""Files of meshes as scenes: what a hand can touch is taken, what it cannot is one line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typed_commands import run

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("networkx")

from foretouch.errors import InputError  # noqa: E402
from foretouch.rendering import SurfaceProxy  # noqa: E402
from foretouch.session.spatial import make_scene  # noqa: E402

SIDE, BUMP = 0.08, 0.003


def sheet(scale: float = 1.0, move: tuple[float, float, float] = (0.0, 0.0, 0.0), *, inverted: bool = False) -> Any:
    """A hill over a square of 8 cm, where specimens stand."""
    along = np.linspace(-0.5 * SIDE, 0.5 * SIDE, 11)
    x, y = np.meshgrid(along, along, indexing="ij")
    vertices = np.stack([x + 0.075, y, BUMP * np.exp(-(x**2 + y**2) / 0.02**2)], axis=-1).reshape(-1, 3)
    node = np.arange(121).reshape(11, 11)
    a, b, c, d = (part.ravel() for part in (node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    return trimesh.Trimesh(vertices * scale + move, faces[:, ::-1] if inverted else faces, process=False)


@pytest.mark.parametrize("inverted", [False, True])
def test_a_sheet_is_felt_from_above_whichever_way_it_was_wound(inverted: bool, tmp_path: Path) -> None:
    sheet(inverted=inverted).export(tmp_path / "sheet.stl")
    proxy = SurfaceProxy(make_scene(str(tmp_path / "sheet.stl")).surface)
    assert proxy.follow((0.075, 0.0, 0.01)).depth == pytest.approx(BUMP - 0.01, abs=1e-6)
    contact = proxy.follow((0.075, 0.0, 0.002))
    assert contact.depth == pytest.approx(BUMP - 0.002, abs=1e-4)
    assert contact.normal[2] > 0.9


@pytest.mark.parametrize(
    ("mesh", "said"),
    [
        (lambda: sheet(1000.0), "at most 100 m is taken: give it in metres"),
        (lambda: sheet(500.0), "40 m by 40 m.*scale by 0.001"),
        (lambda: sheet(1e-3, (0.075, 0.0, 0.0)), "8e-05 m by 8e-05 m.*in metres"),
        (lambda: sheet(move=(1.0, 1.0, 0.0)), r"about \(1.07, 1\) m.*within 0.04 m of \(0.075, 0.0, 0.0\)"),
        (lambda: sheet(move=(0.0, 0.0, 0.2)), "top at 0.203 m"),
        (lambda: trimesh.creation.annulus(0.036, 0.04, 0.01).apply_translation((0.075, 0.0, 0.0)), "close its holes"),
    ],
)
def test_what_no_hand_can_touch_is_refused_in_one_line(mesh: Any, said: str, tmp_path: Path) -> None:
    file = tmp_path / "mesh.stl"
    mesh().export(file)
    refused(file, said)


def refused(file: Path, said: str) -> None:
    result = run("simulate", "--scene", file, "--duration", 0.2)
    assert isinstance(result.exception, InputError)
    with pytest.raises(InputError, match=said):
        raise result.exception
    assert "\n" not in str(result.exception)
    assert str(file) in str(result.exception)


PROPERTIES = b"".join(b"property float %c\n" % axis for axis in b"xyz")
POINTS = b"ply\nformat ascii 1.0\nelement vertex 1\n" + PROPERTIES + b"end_header\n0 0 0\n"


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("empty.stl", lambda stl: b"", "the file is empty: export it again"),
        ("cut.stl", lambda stl: stl[:5084], "its head says 200 triangles, and 100 are there: it is cut off"),
        ("head.stl", lambda stl: stl[:60], "it ends within its head: it is cut off"),
        ("none.stl", lambda stl: bytes(84), "there is no triangle in it"),
        ("points.ply", lambda stl: POINTS, "it is a cloud of points without a triangle: export it as a mesh"),
        ("head.ply", lambda stl: POINTS[:60], "its head has no end: it is cut off"),
        ("points.obj", lambda stl: b"v 0 0 0\n", "it is a cloud of points without a triangle, or cut off"),
    ],
)
def test_a_file_without_a_mesh_says_what_it_is(name: str, content: Any, said: str, tmp_path: Path) -> None:
    file = tmp_path / name
    file.write_bytes(content(sheet().export(file_type="stl")))
    refused(file, said)
