"""Maps of what was touched, from the command line: of recordings as sessions write them, and of files of others."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from typed_commands import good, output_of, refusal_of, run

from foretouch.errors import InputError
from foretouch.messages import VERSION, FieldUpdate, Hello, ModelUpdate
from foretouch.models.scale_field import packed
from foretouch.models.scale_field_kernel import SIDE
from foretouch.recordings import SessionWriter

NOMINAL = (-0.075, 0.0, 0.0, 0.0, 0.0, 0.0)
EPOCH = 4_000_000_000_000_000_000
"""Epoch of a follower's process; another one's is larger."""


def nodes(columns: range, scale: float) -> bytes:
    """Ten rows of the field, which were touched, as they are sent."""
    i, j = (part.ravel() for part in np.meshgrid(np.array(columns), np.arange(10), indexing="ij"))
    return packed(i + SIDE // 2, j + SIDE // 2, np.full(i.size, np.log(scale)), np.full(i.size, 1e-2))


def record(
    path: Path,
    process: int = EPOCH,
    columns: range = range(20, 30),
    scale: float = 1.0,
    role: str = "follower",
    **said: str,
) -> Path:
    """The recording of a session that has learnt ten rows of a scene, by a process of a follower."""
    texts = {"scene": "hill", "seed": "0"} | said
    rest = ("kelvin-voigt", (300.0, 0.0), (), 0.0, True, "", "rls", b"", 1, process, NOMINAL, (1e-4,) * 6)
    with SessionWriter(path) as writer:
        writer.write(Hello(VERSION, 1, 0, role, tuple(texts), tuple(texts.values())), 0)
        writer.write(ModelUpdate(VERSION, 1, 1, 1, *rest, 0.1, ()), 1)
        if said.get("scene") != "":
            writer.write(FieldUpdate(VERSION, 1, 2, nodes(columns, scale), process), 2)
    return path


@pytest.fixture
def monday(tmp_path: Path) -> Path:
    pytest.importorskip("trimesh")
    return record(tmp_path / "monday.mcap")


@pytest.fixture
def tuesday(tmp_path: Path) -> Path:
    return record(tmp_path / "tuesday.mcap", EPOCH + 1, range(25, 35), 1.2)


@pytest.mark.long
def test_different_sessions_are_merged_and_named_in_the_file(monday: Path, tuesday: Path, tmp_path: Path) -> None:
    out = tmp_path / "both.ply"
    figures = output_of("map", "merge", monday, tuesday, "--out", out)
    assert figures["sessions"] == 2
    assert figures["scenes"] == ["hill"]
    assert figures["places"] == 150
    head = out.read_bytes().partition(b"end_header")[0].decode().splitlines()
    assert sum(line.startswith("comment session ") and line.endswith(" hill") for line in head) == 2
    assert "monday" not in str(head)
    shown = good("map", "show", out).stdout
    assert "sessions   2, in hill\n" in shown
    assert "uncertain  by 10 % at the median (one standard deviation)" in shown
    assert "known to" not in shown
    once_more = output_of("map", "merge", monday, tuesday, "--out", out)  # a map may be written over
    assert once_more == figures


def test_a_session_counts_once_whatever_its_file_is_called(monday: Path, tuesday: Path, tmp_path: Path) -> None:
    copy, one, out = tmp_path / "copy.mcap", tmp_path / "one.ply", tmp_path / "out.ply"
    shutil.copy(monday, copy)
    good("map", "merge", monday, "--out", one)
    good("map", "merge", one, tuesday, "--out", tmp_path / "two.ply")
    twice = [(monday, monday), (monday, copy), (one, one), (one, monday), (copy, one), (tmp_path / "two.ply", tuesday)]
    for first, second in twice:
        line = refusal_of("map", "merge", first, second, "--out", out)
        assert line.startswith(f"{second}: a session in it is in {first}, too, and it would count twice: give each")
    later = record(tmp_path / "later.mcap", scale=1.1)  # the same process, which knew what it had learnt before
    assert "count twice" in refusal_of("map", "merge", monday, later, "--out", out)
    assert not out.exists()


def test_a_simulated_session_is_told_by_its_settings(monday: Path, tmp_path: Path) -> None:
    """Its processes count from 1, and the same settings make the same session again."""
    made = {
        name: record(tmp_path / f"{name}.mcap", 1, role="simulation", seed=seed)
        for name, seed in (("first", "0"), ("again", "0"), ("other", "1"))
    }
    out = tmp_path / "out.ply"
    assert "count twice" in refusal_of("map", "merge", made["first"], made["again"], "--out", out)
    assert output_of("map", "merge", made["first"], made["other"], monday, "--out", out)["sessions"] == 3


def test_a_map_that_names_no_session_counts_as_one(monday: Path, tuesday: Path, tmp_path: Path) -> None:
    old, copy, out = tmp_path / "old.ply", tmp_path / "copy.ply", tmp_path / "out.ply"
    good("map", "merge", monday, "--out", old)
    lines = old.read_bytes().split(b"\n")
    old.write_bytes(b"\n".join(line for line in lines if not line.startswith(b"comment session")))
    shutil.copy(old, copy)
    assert "count twice" in refusal_of("map", "merge", old, copy, "--out", out)
    assert "sessions   1; its file names none\n" in good("map", "show", old).stdout
    merged = good("map", "merge", old, tuesday, "--out", out).stdout
    assert "sessions   2, in hill; 1 of a map that names none: see that none counts twice\n" in merged
    assert "count twice" in refusal_of("map", "merge", out, copy, "--out", out)


def test_other_scenes_and_places_apart_are_said(monday: Path, tmp_path: Path) -> None:
    """A real robot's scene is only the shape that was given, so one specimen can have been touched under two names."""
    out = tmp_path / "out.ply"
    flat = record(tmp_path / "flat.mcap", EPOCH + 1, range(28, 30), scene="phantom")
    text = good("map", "merge", monday, flat, "--out", out).stdout
    assert "2, in hill and phantom: only their heights were compared; merge them if they are one specimen" in text
    assert "in common" not in text
    far = record(tmp_path / "far.mcap", EPOCH + 2, range(31, 33))
    assert (
        "no place: nothing shows that they are of one specimen"
        in good("map", "merge", monday, far, "--out", out).stdout
    )


@pytest.mark.parametrize(
    ("column", "values", "problem"),
    [
        ("x", lambda x: x + 0.3, r"no specimen can be at \(0\.366, 0, .*\) m, only within 0\.29 m of \(0\.075, 0\.0\)"),
        ("x", lambda x: 1e3 * x, "in millimetres"),
        ("z", lambda z: z + 0.05, r"at most 0\.04 m high"),
        ("stiffness", lambda k: 1e30 * k, r"a stiffness in it is 3e\+32 N/m, and only 0\.1 to 1e\+07 N/m can be felt"),
        ("stiffness", lambda k: 1e-9 * k, "only 0.1 to"),
        ("deviation", lambda s: 0.0 * s, "with a stiffness and a deviation: merge the recordings again"),
        ("y", lambda y: 0.0 * y, "each there once"),
    ],
)
def test_what_cannot_be_a_map_is_one_line(
    monday: Path, tmp_path: Path, column: str, values: object, problem: str
) -> None:
    out = tmp_path / "one.ply"
    good("map", "merge", monday, "--out", out)
    change_column(out, column, values)
    line = refusal_of("map", "show", out)
    assert line.startswith(f"{out}: ")
    with pytest.raises(InputError, match=problem):
        raise run("map", "show", out).exception or AssertionError
    assert line in refusal_of("map", "merge", monday, out, "--out", tmp_path / "two.ply")


def change_column(path: Path, column: str, values: object) -> None:
    """Write a column of the vertices of a map over."""
    assert callable(values)
    head, _, body = path.read_bytes().partition(b"end_header\n")
    names = [
        line.split()[1:] for line in head.decode().splitlines() if line.startswith("property ") and "list" not in line
    ]
    row = np.dtype([(name, "<f4" if kind == "float" else "u1") for kind, name in names])
    count = int(head.partition(b"element vertex ")[2].split()[0])
    table = np.frombuffer(body[: count * row.itemsize], row).copy()
    table[column] = values(table[column])
    path.write_bytes(head + b"end_header\n" + table.tobytes() + body[count * row.itemsize :])


def test_a_mesh_of_ones_own_is_not_written_over(monday: Path, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    mine = tmp_path / "box.ply"
    mine.write_bytes(trimesh.creation.box().export(file_type="ply"))
    before = mine.read_bytes()
    line = refusal_of("map", "merge", monday, "--out", mine)
    assert line == f"{mine}: is there and no map of touches: name another file, or remove it first"
    assert mine.read_bytes() == before
    (tmp_path / "folder.ply").mkdir()
    assert "no map of touches" in refusal_of("map", "merge", monday, "--out", tmp_path / "folder.ply")


def test_other_files_say_what_to_do(monday: Path, tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    points, empty, cut = tmp_path / "points.ply", tmp_path / "empty.mcap", tmp_path / "cut.mcap"
    points.write_bytes(trimesh.PointCloud([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]]).export(file_type="ply"))
    assert "its vertices have no stiffness and no deviation: it is no map of touches" in refusal_of(
        "map", "show", points
    )
    empty.touch()
    assert "is empty: its recorder wrote nothing: give another session's" in refusal_of("map", "show", empty)
    cut.write_bytes(monday.read_bytes()[:60])
    assert "nothing in it can be read or repaired: give another session's" in refusal_of("map", "show", cut)
    line = record(tmp_path / "line.mcap", scene="")
    assert "along a line, without a surface: give a session with --scene" in refusal_of("map", "show", line)


def test_a_single_row_of_touches_opens_again(tmp_path: Path) -> None:
    """It has no triangle, and is a map all the same."""
    pytest.importorskip("trimesh")
    row, out = record(tmp_path / "row.mcap", columns=range(20, 21)), tmp_path / "row.ply"
    figures = output_of("map", "merge", row, "--out", out)
    shown = output_of("map", "show", out)
    assert shown["places"] == figures["places"] == 10
