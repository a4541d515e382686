"""Meshes of the arms: fetched once, read link by link, and refused where they are not those of the arm.

A stand-in of Menagerie is served here, never the real one: see tests/menagerie.py.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from foretouch.errors import DatasetError, UnknownNameError
from foretouch.files import origins
from foretouch.robot import ARM_MESHES, ArmPicture, fetch_arm_meshes, read_arm, read_arm_meshes
from foretouch.settings import ARMS
from menagerie import write_arm

ARM = "ur5e"


@pytest.fixture
def published(www: Path) -> Path:
    """The folder of `ARM` where the real origin has it, whole and right."""
    return publish(ARM, www)


def publish(name: str, www: Path) -> Path:
    origin = ARM_MESHES[name]
    above = www / origin.repository / origin.commit
    write_arm(name, above)
    return above / origin.folder


def changed(folder: Path, old: str, new: str) -> None:
    path = folder / f"{ARM}.xml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def refused(said: str) -> str:
    """What is said of meshes that cannot be had: one line, and nothing of them counts as present."""
    with pytest.raises(DatasetError, match=said) as caught:
        fetch_arm_meshes(ARM)
    assert "\n" not in str(caught.value)
    return str(caught.value)


def test_every_arm_has_meshes_with_a_licence_at_the_commit_of_its_description() -> None:
    assert set(ARM_MESHES) == set(ARMS)
    for name, origin in ARM_MESHES.items():
        text = read_arm(name).path.read_text()
        assert f"{origin.folder}/{name}.xml" in text
        assert origin.commit in text
        assert origin.licence.split(",")[0] in text
        assert origins.address(origin, f"{name}.xml").startswith(
            "https://raw.githubusercontent.com/google-deepmind/mujoco_menage"
        )


@pytest.mark.parametrize("name", ARMS)
def test_each_link_has_its_vertices_in_its_own_frame(
    name: str, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bodies = write_arm(name, elsewhere / "store" / "a checkout")
    monkeypatch.setenv(origins.DATA_DIR, str(elsewhere / "store"))
    monkeypatch.setitem(sys.modules, "pooch", None)
    assert fetch_arm_meshes(name) == elsewhere / "store" / "a checkout" / ARM_MESHES[name].folder / f"{name}.xml"
    description = read_arm(name)
    links = read_arm_meshes(description)
    assert len(links) == len(bodies) == len(ArmPicture(description).links) - 1  # the last is the probe
    for (vertices, faces), expected in zip(links, bodies.values(), strict=True):
        apart = np.linalg.norm(vertices[:, None] - expected, axis=2)
        assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-6  # the jaw's are not among them
        assert len(faces) == 12 * len(expected) // 8
        corners = vertices[faces]
        outward = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        volume = np.sum(outward * corners[:, 0]) / 6.0
        boxes = expected.reshape(-1, 8, 3)
        sides = [boxes[:, corner] - boxes[:, 0] for corner in (4, 2, 1)]
        assert volume == pytest.approx(np.abs(np.sum(np.cross(sides[0], sides[1]) * sides[2], axis=1)).sum(), rel=1e-3)


@pytest.mark.parametrize("name", ARMS)
def test_what_is_seen_is_fetched_once_and_then_comes_from_the_cache(
    name: str, www: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = publish(name, www)
    assert read_arm_meshes(read_arm(name)) == ()  # looking for them fetches nothing
    path = fetch_arm_meshes(name)
    here = path.parent
    assert here.parent.name == ARM_MESHES[name].commit
    assert www.parent / "cache" in here.parents
    there = {one.relative_to(folder): one.read_bytes() for one in folder.rglob("*.*")}
    assert {one.relative_to(here): one.read_bytes() for one in here.rglob("*.*")} == there
    monkeypatch.setattr(origins, "HOST", "http://127.0.0.1:9")
    assert fetch_arm_meshes(name) == path
    assert len(read_arm_meshes(read_arm(name))) > 5


def test_without_network_one_line_says_what_to_do(elsewhere: Path) -> None:
    said = refused(r"is not here and could not be fetched.*refused.*FORETOUCH_DATA_DIR")
    assert "a folder that has universal_robots_ur5e/" in said
    assert read_arm_meshes(read_arm(ARM)) == ()
    assert not (elsewhere / "cache" / "foretouch").exists()  # not even empty folders
    with pytest.raises(UnknownNameError, match="choose one of fr3, so101, ur5e"):
        fetch_arm_meshes("simulated")


def test_a_mesh_that_is_missing_is_said_and_fetched_when_it_is_there(published: Path) -> None:
    mesh = published / "assets" / "forearm_link_1.obj"
    content = mesh.read_bytes()
    mesh.unlink()
    refused("a file of the meshes of ur5e is not here and could not be fetched.*404")
    with pytest.raises(DatasetError, match=r"forearm_link_1.obj.*foretouch arms meshes ur5e"):
        read_arm_meshes(read_arm(ARM))  # some are there: nothing is drawn with a part of an arm
    mesh.write_bytes(content)
    fetch_arm_meshes(ARM)
    assert len(read_arm_meshes(read_arm(ARM))) == 7


def test_a_transfer_that_ends_early_leaves_nothing_of_its_file(published: Path, www: Path) -> None:
    mesh = published / "assets" / "forearm_link_1.obj"
    mesh.rename(mesh.with_name("cut_short.obj"))
    changed(published, 'file="forearm_link_1.obj"', 'name="forearm_link_1" file="cut_short.obj"')
    refused("is not here and could not be fetched.*IncompleteRead")
    came = [one.name for one in (www.parent / "cache").rglob("*.*")]
    assert "forearm_link_0.obj" in came
    assert not [one for one in came if one == "cut_short.obj" or one.startswith("tmp")]


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda folder: cut(folder / "assets" / "forearm_link_1.obj"), "forearm_link_1.obj has no triangles"),
        (lambda folder: (folder / "assets" / "forearm_link_1.obj").write_text("<html>"), "has no triangles"),
        (lambda folder: cut(folder / "ur5e.xml"), "MuJoCo cannot read it"),
        (
            lambda folder: changed(folder, "0.425", "0.428"),
            "behind elbow_joint stands 3.0 mm and 0.0 degrees elsewhere",
        ),
        (lambda folder: changed(folder, "0.163", "0.165"), "behind shoulder_pan_joint stands 2.0 mm"),
        (
            lambda folder: changed(folder, 'pan_joint" axis="0 0 1"', 'pan_joint" axis="0 0 -1"'),
            "shoulder_pan_joint stands 0.0 mm and",
        ),
        (
            lambda folder: changed(folder, '"elbow_joint"', '"elbow"'),
            "it has no joint 'elbow_joint', as the description of ur5e",
        ),
        (lambda folder: changed(folder, 'file="base_0.obj"', 'file="../../base_0.obj"'), "not in its folder"),
        (
            lambda folder: changed(folder, 'meshdir="assets"', 'meshdir="/etc"'),
            "'/etc/base_0.obj', which is not in its",
        ),
        (
            lambda folder: magnified(folder / "assets" / "forearm_link_1.obj", 1000.0),
            r"the mesh of its link behind elbow_joint reaches \d+ m from there, and a link of this arm less than 1 m",
        ),
        (lambda folder: magnified(folder / "assets" / "base_0.obj", 20.0), r"of its foot reaches 3\.13 m from"),
        (lambda folder: changed(folder, 'group="2"', 'group="3"'), "it has no mesh that is drawn"),
    ],
)
def test_what_came_broken_or_of_another_arm_is_refused_and_nothing_of_it_stays(
    spoil: object, said: str, published: Path, www: Path
) -> None:
    spoil(published)  # type: ignore[operator]
    assert ": fetch it (foretouch arms meshes ur5e)" in refused(said)
    assert not (www.parent / "cache" / "foretouch").exists()  # not even empty folders
    assert read_arm_meshes(read_arm(ARM)) == ()


def test_what_broke_in_the_cache_is_fetched_again(published: Path) -> None:
    mesh = fetch_arm_meshes(ARM).parent / "assets" / "base_0.obj"
    cut(mesh)
    with pytest.raises(DatasetError, match=r"its assets/base_0\.obj has no triangles"):
        read_arm_meshes(read_arm(ARM))
    fetch_arm_meshes(ARM)
    assert mesh.read_bytes() == (published / "assets" / "base_0.obj").read_bytes()


def test_a_folder_of_ones_own_stays_as_it_is(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_arm(ARM, elsewhere)
    monkeypatch.setenv(origins.DATA_DIR, str(elsewhere))
    mesh = elsewhere / ARM_MESHES[ARM].folder / "assets" / "base_0.obj"
    cut(mesh)
    content = mesh.read_bytes()
    said = refused("or name a folder that has the whole of it as FORETOUCH_DATA_DIR")
    assert "unset FORETOUCH_DATA_DIR and fetch it (foretouch arms meshes ur5e)" in said  # else it would be read again
    assert mesh.read_bytes() == content


def magnified(path: Path, factor: float) -> None:
    """A mesh whose numbers are taken for another unit than they are in."""
    rows = [line.split() for line in path.read_text().splitlines()]
    lines = [
        f"v {' '.join(str(factor * float(one)) for one in row[1:])}" if row[0] == "v" else " ".join(row) for row in rows
    ]
    path.write_text("\n".join(lines) + "\n")


def cut(path: Path) -> None:
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
