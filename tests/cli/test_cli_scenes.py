"""Sessions in three dimensions from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner, Result

from foretouch.cli.app import app
from foretouch.errors import InputError
from foretouch.recordings import read_session

TOUCHES = ("--fusion", "contact", "--displacement", 0.003, "--turn", 0.02)


def run(*arguments: object) -> Result:
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_a_scene_is_simulated_recorded_and_reported_again_and_repeats(tmp_path: Path) -> None:
    options = ("simulate", "--scene", "hill", *TOUCHES, "--duration", 5.5, "--seed", 3, "--json")
    first = run(*options, "--recording", tmp_path / "a.mcap")
    assert first.exit_code == 0, first.output
    report = json.loads(first.stdout)
    assert report["scene"]["pose"]["touches"] == 1
    again = run("report", tmp_path / "a.mcap", "--json", "--report", tmp_path / "page")
    assert json.loads(again.stdout)["scene"] == report["scene"]
    assert (tmp_path / "page" / "index.html").stat().st_size > 50_000
    run(*options, "--recording", tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()
    assert read_session(tmp_path / "a.mcap").beliefs


def test_a_mesh_is_a_scene(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    block = trimesh.creation.box((0.08, 0.08, 0.02))
    block.apply_translation((0.075, 0.0, -0.01))
    block.export(tmp_path / "block.stl")
    result = run("simulate", "--scene", tmp_path / "block.stl", *TOUCHES, "--duration", 5.2, "--json")
    assert result.exit_code == 0, result.output
    assert json.loads(result.stdout)["max_follower_force_N"] > 0.05


def test_without_what_draws_images_it_goes_on_and_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    import foretouch.session.spatial.making as making
    from foretouch.errors import MissingExtraError

    class NoCamera:
        def __init__(self, *_: object, **__: object) -> None:
            raise MissingExtraError("cv2", "vision")

    monkeypatch.setattr(making, "SimulatedCamera", NoCamera)
    result = run("simulate", "--scene", "plane", "--duration", 0.3, "--json")
    assert result.exit_code == 0
    (line,) = result.stderr.strip().splitlines()
    assert "pip install 'foretouch[vision]'" in line
    assert line.endswith("the session goes on without it")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--scene", "nowhere"), "unknown scene 'nowhere'"),
        (("--scene", "absent.stl"), r"absent\.stl: no such file"),
        (("--scene", "plane", "--material", "sponge"), "remembers what was done to it"),
        (("--scene", "plane", "--operator", "recorded"), "is for sessions along a line"),
        (("--scene", "plane", "--operator", "browser"), "needs real time"),
        (("--scene", "plane", "--fusion", "luck"), "unknown fusion 'luck'"),
        (("--scene", "plane", "--image-fault", "hand:3"), "KIND:BEGIN:END"),
        (("--scene", "plane", "--bump", -1), "bump = -1"),
    ],
)
def test_bad_input_is_refused_before_anything_is_written(
    options: tuple[object, ...], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    result = run("simulate", *options, "--duration", 0.2, "--recording", "s.mcap")
    assert isinstance(result.exception, InputError)
    with pytest.raises(InputError, match=said):
        raise result.exception
    assert not list(tmp_path.iterdir())


def test_a_scene_is_not_replayed_and_one_line_says_so(tmp_path: Path) -> None:
    run("simulate", "--scene", "plane", *TOUCHES, "--duration", 0.3, "--recording", tmp_path / "s.mcap")
    result = run("replay", tmp_path / "s.mcap", "--force-delay", 0.6)
    with pytest.raises(InputError, match="three dimensions"):
        raise result.exception or AssertionError
