"""Sessions in three dimensions from the command line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typed_commands import run

from foretouch.errors import InputError, install_command
from foretouch.messages import VERSION, Hello
from foretouch.recordings import SessionWriter, read_session

TOUCHES = ("--fusion", "contact", "--displacement", 0.003, "--turn", 0.02)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One touch of a hill; the report of it is beside it."""
    path = tmp_path_factory.mktemp("scene") / "scene.mcap"
    options = ("--duration", 5.2, "--seed", 3, "--json")
    result = run("simulate", "--scene", "hill", *TOUCHES, *options, "--recording", path)
    assert result.exit_code == 0, result.output
    path.with_suffix(".json").write_text(result.stdout)
    return path


@pytest.mark.long  # tests/report/test_report_scene.py reports one without the command
def test_a_scene_is_simulated_recorded_and_reported_again(recorded: Path, tmp_path: Path) -> None:
    report = json.loads(recorded.with_suffix(".json").read_text())
    assert report["scene"]["pose"]["touches"] == 1
    again = run("report", recorded, "--json", "--report", tmp_path / "page")
    assert json.loads(again.stdout)["scene"] == report["scene"]
    assert (tmp_path / "page" / "index.html").stat().st_size > 50_000
    assert read_session(recorded).beliefs


@pytest.mark.long
def test_a_mesh_is_a_scene(tmp_path: Path) -> None:
    trimesh = pytest.importorskip("trimesh")
    block = trimesh.creation.box((0.08, 0.08, 0.02))
    block.apply_translation((0.075, 0.0, -0.01))
    block.export(tmp_path / "block.stl")
    result = run("simulate", "--scene", tmp_path / "block.stl", *TOUCHES, "--duration", 4.8, "--json")
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
    assert install_command("vision") in line
    assert line.endswith("the session goes on without it")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--scene", "nowhere"), "unknown scene 'nowhere'"),
        (("--scene", "absent.stl"), r"absent\.stl: no such file"),
        (("--scene", "plane", "--material", "bone"), "stiffest = 100000.0: must be at least 1.071e.05 N/m, which bone"),
        (("--scene", "phantom", "--material", "kelvin-voigt"), "most_damped = 500.0: must be at least 2000 N s/m"),
        (("--scene", "plane", "--stiffest", "100"), "stiffest = 100.0: must be at least "),
        (("--scene", "plane", "--operator", "gamepad"), "moves along one axis, and the scene plane is touched in"),
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


def columns(path: Path) -> list[bytes]:
    """Everything that was said, but for settings and what the computing took."""
    log = read_session(path)
    log.leader["compute_ns"] = log.follower["compute_ns"] = 0
    tables = (log.leader, log.follower, log.leader_space, log.follower_space)
    return [*(table.tobytes() for table in tables), repr((log.models, log.fields, log.beliefs)).encode()]


@pytest.mark.long
def test_a_scene_is_run_again_bit_by_bit_and_under_another_delay(recorded: Path) -> None:
    again, later = recorded.with_name("again.mcap"), recorded.with_name("later.mcap")
    result = run("replay", recorded, "--recording", again)
    assert result.exit_code == 0, result.output
    assert columns(again) == columns(recorded)
    assert "its fixture, camera and tracker are simulated again" in result.stdout
    assert run("replay", recorded, "--force-delay", 0.6, "--recording", later).exit_code == 0
    log, before = read_session(later), read_session(recorded)
    assert log.settings["force_delay"] == "0.6"
    assert log.leader_space["hand_z"].tobytes() == before.leader_space["hand_z"].tobytes()
    assert log.leader_space["fixture_x"].tobytes() != before.leader_space["fixture_x"].tobytes()


@pytest.mark.long
def test_a_held_scene_is_run_again_in_a_closed_loop(tmp_path: Path) -> None:
    path, again = tmp_path / "held.mcap", tmp_path / "again.mcap"
    run("simulate", "--scene", "plane", *TOUCHES, "--grip", "normal", "--duration", 2, "--recording", path)
    with pytest.raises(InputError, match="--closed-loop alone"):
        raise run("replay", path).exception or AssertionError
    assert run("replay", path, "--closed-loop", "--recording", again).exit_code == 0
    assert columns(again) == columns(path)


@pytest.mark.long  # the refusals themselves are of replay
def test_what_cannot_be_run_again_is_one_line(recorded: Path) -> None:
    with pytest.raises(InputError, match="in a closed loop the force moves a hand"):
        raise run("replay", recorded, "--closed-loop").exception or AssertionError
    log, path = read_session(recorded), recorded.with_name("real.mcap")
    with SessionWriter(path) as writer:
        texts = log.settings
        writer.write(Hello(VERSION, 1, 0, "leader", tuple(texts), tuple(texts.values())), 0)
        log.follower_space["exact_x"] = float("nan")
        for message in log.messages():
            writer.write(message, message.time_ns)
    with pytest.raises(InputError, match="is of a robot in three dimensions"):
        raise run("replay", path).exception or AssertionError
