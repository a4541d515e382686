"""Maps of what was touched: merged, written as a mesh, and opened again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from foretouch.errors import InputError
from foretouch.models.scale_field_kernel import SPACING
from foretouch.rendering.surfaces import read_mesh
from foretouch.report import TouchedMap, map_file, merged, read_map


def touched(stiffness: float, deviation: float, rows: range = range(4), height: float = 0.002) -> TouchedMap:
    """A square of the lattice, four nodes wide, all of one stiffness."""
    nodes = np.array([(i, j) for i in rows for j in range(4)])
    points = np.column_stack([SPACING * nodes, np.full(len(nodes), height)])
    return TouchedMap(points, np.full(len(nodes), stiffness), np.full(len(nodes), deviation))


def test_one_map_stays_as_it_is() -> None:
    whole = merged([touched(300.0, 0.1)])
    assert whole.stiffness == pytest.approx(np.full(16, 300.0))
    assert whole.deviation == pytest.approx(np.full(16, 0.1))


@given(st.floats(50.0, 5000.0), st.floats(0.5, 1.5), st.floats(0.02, 0.5), st.floats(0.02, 0.5))
def test_two_maps_count_as_much_as_they_are_sure(stiffness: float, ratio: float, one: float, other: float) -> None:
    whole = merged([touched(stiffness, one), touched(ratio * stiffness, other)])
    weight = other**2 / (one**2 + other**2)  # of the first
    assert np.log(whole.stiffness / stiffness) == pytest.approx(np.full(16, (1.0 - weight) * np.log(ratio)), abs=1e-9)
    alone = one * other / np.hypot(one, other)
    off = abs(np.log(ratio)) / np.hypot(one, other)  # in standard deviations of the difference
    assert whole.deviation == pytest.approx(np.full(16, alone * max(1.0, off)))
    swapped = merged([touched(ratio * stiffness, other), touched(stiffness, one)])
    assert swapped.stiffness == pytest.approx(whole.stiffness)


def test_where_only_one_has_been_it_counts_alone() -> None:
    whole = merged([touched(300.0, 0.1), touched(600.0, 0.2, range(4, 6))])
    assert len(whole.points) == 24
    assert sorted(set(np.round(whole.stiffness).tolist())) == [300.0, 600.0]


def test_another_surface_is_one_line() -> None:
    with pytest.raises(InputError, match="height of one place differs by 3 mm"):
        merged([touched(300.0, 0.1), touched(300.0, 0.1, height=0.005)])
    with pytest.raises(InputError, match="no map"):
        merged([])


def test_it_is_a_mesh_that_opens_again(tmp_path: Path) -> None:
    known, path = touched(300.0, 0.1), tmp_path / "map.ply"
    known.stiffness[5] = 900.0
    path.write_bytes(map_file(known))
    again = read_map(path)
    assert again.points == pytest.approx(known.points, abs=1e-8)
    assert again.stiffness == pytest.approx(known.stiffness, rel=1e-6)
    assert again.deviation == pytest.approx(known.deviation, rel=1e-6)
    mesh = read_mesh(path)
    assert len(mesh.faces) == 18
    a, b, c = mesh.vertices[mesh.faces[0]]
    assert np.cross(b - a, c - a)[2] > 0.0  # it faces up, as a specimen does


def test_it_says_its_frame_and_another_is_one_line(tmp_path: Path) -> None:
    content, path = map_file(touched(300.0, 0.1)), tmp_path / "map.ply"
    assert b"\ncomment frame fixture\n" in content.partition(b"end_header")[0]
    path.write_bytes(content.replace(b"comment frame fixture", b"comment frame base"))
    with pytest.raises(InputError, match=r"map.ply: is in the frame base \(at the arm's foot, z up\), and .* fixture"):
        read_map(path)
    path.write_bytes(content.replace(b"comment frame fixture", b"comment frame table"))
    with pytest.raises(InputError, match=r"frame table \(unknown here; there are world, base, .*") as refused:
        read_map(path)
    assert "\n" not in str(refused.value)
    path.write_bytes(content.replace(b"comment frame fixture\n", b""))  # as maps were before they named it
    assert len(read_map(path).points) == 16


@pytest.mark.parametrize(
    ("content", "problem"),
    [(b"", "no mesh"), (b"ply\nformat ascii 1.0\nend_header\n", "no mesh"), (None, "no such file")],
)
def test_another_file_is_one_line(tmp_path: Path, content: bytes | None, problem: str) -> None:
    path = tmp_path / "map.ply"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=problem):
        read_map(path)


def test_a_mesh_without_stiffness_is_no_map(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    path = tmp_path / "box.ply"
    path.write_bytes(trimesh.creation.box().export(file_type="ply"))
    with pytest.raises(InputError, match="no stiffness and no deviation"):
        read_map(path)


def test_a_number_that_is_none_is_refused(tmp_path: Path) -> None:
    wrong, path = touched(300.0, 0.1), tmp_path / "map.ply"
    wrong.deviation[3] = np.nan
    path.write_bytes(map_file(wrong))
    with pytest.raises(InputError, match="is none"):
        read_map(path)
