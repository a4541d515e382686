"""Meshes from files: every format, repaired, or refused in one line."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from solids import ball, follow, straight

trimesh = pytest.importorskip("trimesh")
pytest.importorskip("networkx")

from foretouch.errors import InputError, SettingError  # noqa: E402
from foretouch.rendering.surfaces import TriangleMesh, first_hit_from_above, read_mesh  # noqa: E402
from foretouch.rendering.surfaces.mesh_files import MOST_BYTES  # noqa: E402


def pressed(mesh: TriangleMesh) -> float:
    return follow(mesh, straight((0.01, 0.005, 0.06), (0.01, 0.005, 0.045)))[-1].depth


@pytest.mark.parametrize("ending", [".stl", ".obj", ".ply", ".STL"])
@pytest.mark.first
def test_a_box_in_millimetres_is_read(ending: str, tmp_path: Path) -> None:
    file = tmp_path / f"box{ending}"
    trimesh.creation.box((100.0, 100.0, 100.0)).export(file, file_type=ending.lower()[1:])
    mesh = read_mesh(file, scale=1e-3, closed=True)
    assert mesh.closed
    assert len(mesh.vertices) == 8  # an STL has every corner once a triangle
    assert pressed(mesh) == pytest.approx(0.005, abs=1e-9)


def test_what_is_broken_is_repaired(tmp_path: Path) -> None:
    """A face inside out, one missing, one twice, one without area, and a vertex of no face."""
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    vertices = np.vstack([box.vertices, (0.0, 0.0, 0.3)])
    faces = box.faces[:-1].copy()
    faces[3] = faces[3][::-1]
    faces = np.vstack([faces, faces[0], (0, 1, 1)])
    file = tmp_path / "broken.ply"
    trimesh.Trimesh(vertices, faces, process=False).export(file)
    with pytest.raises(SettingError):
        TriangleMesh(vertices, faces)
    mesh = read_mesh(file, closed=True)
    assert len(mesh.faces) == 12
    assert len(mesh.vertices) == 8
    assert pressed(mesh) == pytest.approx(0.005, abs=1e-7)


def test_a_mesh_that_is_inside_out_is_turned(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    box.invert()
    file = tmp_path / "inside_out.stl"
    box.export(file)
    assert pressed(read_mesh(file)) == pytest.approx(0.005, abs=1e-7)


def test_an_open_mesh_is_a_sheet_unless_a_body_is_asked_for(tmp_path: Path) -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.05)
    half = trimesh.Trimesh(ball.vertices, ball.faces[ball.triangles_center[:, 2] > 0.0], process=False)
    file = tmp_path / "half.ply"
    half.export(file)
    mesh = read_mesh(file)
    assert not mesh.closed
    assert pressed(mesh) == pytest.approx(0.05 - float(np.linalg.norm((0.01, 0.005, 0.045))), abs=3e-4)
    with pytest.raises(InputError, match=r"half.ply: the mesh has holes"):
        read_mesh(file, closed=True)


def write(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("mesh.txt", b"", "are read from"),
        ("empty.stl", b"", "mesh|triangle"),
        ("noise.stl", bytes(range(256)) * 3, "mesh|triangle"),
        ("noise.ply", b"ply\nformat ascii 1.0\nelement vertex 9\nend_header\nx", "mesh|triangle"),
        ("text.obj", b"hello", "mesh|triangle"),
        ("cut.stl", b" " * 80 + struct.pack("<I", 1000) + bytes(50), "mesh|triangle"),
        ("nan.stl", b" " * 80 + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, np.nan, 1, 0, 0), "finite"),
        ("flat.stl", b" " * 80 + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 1, 0, 0, 1, 0, 0, 0), "area.*in metres"),
        ("huge.stl", b" " * 80 + struct.pack("<I12fH", 1, 0, 0, 1, 0, 0, 0, 500, 0, 0, 0, 500, 0, 0), "500 m.*scale"),
        ("fin.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nv 0 -1 0\nf 1 2 3\nf 1 2 4\nf 1 2 5\n", r"\(0.5, 0, 0\) m"),
    ],
)
def test_what_is_no_mesh_is_refused_in_one_line(name: str, content: bytes, said: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=said) as error:
        read_mesh(write(tmp_path / name, content))
    assert "\n" not in str(error.value)
    assert name in str(error.value)


def test_holes_that_cannot_be_filled_stay_holes(tmp_path: Path) -> None:
    """Holes of a scan touch one another; filled one by one they would give an edge a third triangle."""
    block = trimesh.creation.box((0.1, 0.1, 0.1)).subdivide().subdivide().subdivide()
    random = np.random.default_rng(0)
    tried = 0
    for _ in range(20):
        holed = block.copy()
        holed.update_faces(random.random(len(holed.faces)) > 0.1)
        filled = holed.copy()
        trimesh.repair.fill_holes(filled)
        tried += int(np.bincount(filled.edges_unique_inverse).max() > 2)
        holed.export(tmp_path / "holed.stl")
        mesh = read_mesh(tmp_path / "holed.stl")
        assert len(mesh.faces) >= len(holed.faces)
        assert np.ptp(mesh.vertices, axis=0) == pytest.approx((0.1, 0.1, 0.1))
    assert tried > 0


def test_a_folder_and_a_file_that_is_too_large_are_not_read(tmp_path: Path) -> None:
    (tmp_path / "folder.stl").mkdir()
    with pytest.raises(InputError, match="folder"):
        read_mesh(tmp_path / "folder.stl")
    with (tmp_path / "large.stl").open("wb") as file:
        file.truncate(MOST_BYTES + 1)  # sparse: nothing is written
    with pytest.raises(InputError, match=r"400 MB.*reduce"):
        read_mesh(tmp_path / "large.stl")


def test_a_file_that_is_not_there_and_a_scale_that_is_none(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_mesh(tmp_path / "none.stl")
    with pytest.raises(SettingError, match="scale"):
        read_mesh(tmp_path / "none.stl", scale=0.0)


@pytest.mark.parametrize("place", [(0.0, 0.0), (0.011, -0.023), (-0.03, 0.02), (0.049, 0.0)])
def test_a_ray_from_above_hits_the_top_of_a_ball_and_nothing_beside_it(place: tuple[float, float]) -> None:
    made = ball(0.05)
    hit = first_hit_from_above(made, *place)
    corners = made.vertices[made.faces[hit]]
    assert corners[:, 2].mean() > 0.0  # the near side of two
    shares = np.linalg.solve(np.vstack([corners[:, :2].T, np.ones(3)]), (*place, 1.0))
    assert (shares > -1e-9).all()  # the ray goes through it
    assert first_hit_from_above(made, place[0] + 0.2, place[1]) == -1
