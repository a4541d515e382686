"""An arm in the picture of a scene: where its joints put it, as heard of and now, live and in a recording."""

from __future__ import annotations

import io
import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from console_driver import ARROW_SHARE, chromium, held_in_space, on_screen, open_page, wait_for

from foretouch.console import Console
from foretouch.console.playback import Playback
from foretouch.console.views.arms import MOST_TRIANGLES, ArmView, DrawnArm
from foretouch.console.views.hold import HOME
from foretouch.console.views.probes import UNITS
from foretouch.console.views.shapes import ARM_DELAYED, ARM_NOW
from foretouch.console.views.space import HANDLE_SIZE, SPACE_CAMERA
from foretouch.console.watched import Watched
from foretouch.messages import (
    VERSION,
    FollowerSpace,
    Handle,
    Hello,
    LeaderSpace,
    LeaderState,
    Message,
    SessionLog,
    Telemetry,
)
from foretouch.recordings import DATA_DIR, SessionWriter, read_session
from foretouch.robot import ArmPicture, ArticulatedArm, read_arm
from foretouch.robot.arms.kinematics import InverseKinematics
from foretouch.settings import ARMS, SIMULATED

pytest.importorskip("viser")
mujoco = pytest.importorskip("mujoco")
pytest.importorskip("mink")

Joints = tuple[float, ...]
Places = np.ndarray[Any, np.dtype[np.float64]]
TICKS = 40
HEARD = 20  # The tick of the follower that its operator has heard of last


def telemetry(tick: int, joints: Joints, place: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Telemetry:
    space = FollowerSpace(*place, *(0.0,) * 22, *(math.nan,) * 3, 0, *joints)
    return Telemetry(VERSION, tick, tick * 1_000_000, 0, *(0.0,) * 6, False, False, 0, 1, 1, run=1, space=space)


def leader_state(sequence: int, heard: int) -> LeaderState:
    line = (VERSION, sequence, sequence * 1_000_000, 0.0, 0.0, 0.0, 0.0, 0.0, heard, 0, math.nan, False, 1, 1)
    return LeaderState(*line, epoch=1, run=1, space=LeaderSpace(*(0.0,) * 28))


def hello(robot: str) -> Hello:
    return Hello.of("follower", 1, 1, {"operator": "browser", "scene": "plane", "robot": robot})


def joints_at(name: str, place: tuple[float, float, float]) -> Joints:
    return tuple(InverseKinematics(read_arm(name), 0.02).reach(place).tolist())


def moving(name: str) -> list[Joints]:
    """Its joints in one tick after the other: far enough for two pictures of it to differ."""
    first, last = (np.array(joints_at(name, place)) for place in ((0.0, 0.0, 0.03), (0.03, 0.0, 0.0)))
    return [tuple((first + (last - first) * tick / TICKS).tolist()) for tick in range(TICKS + 1)]


def messages(name: str) -> list[Message]:
    said: list[Message] = [telemetry(tick, joints) for tick, joints in enumerate(moving(name)) if tick]
    return [hello(name), *said, *(leader_state(tick, max(tick - HEARD, 0)) for tick in range(1, TICKS + 1))]


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Console]:
    made = Console(0, lambda message: None, recordings=tmp_path)
    yield made
    made.close()


def tip_of(arm: DrawnArm, length: float) -> Places:
    """Where the end of the drawn probe is [m]."""
    tool = arm._links[-1]
    w, *turn = np.asarray(tool.wxyz, np.float64)
    way = np.array((0.0, 0.0, length * UNITS))
    twice = 2.0 * np.cross(turn, way)
    end: Places = np.asarray(tool.position) + way + w * twice + np.cross(turn, twice)
    return end / UNITS


def draw(view: ArmView, *said: Message) -> Watched:
    watched = Watched()
    for message in said:
        watched.take(message, 0.0)
    view.draw(watched)
    return watched


def with_meshes(view: ArmView, *said: Message) -> None:
    """Draw until the meshes of the arm were looked for."""
    draw(view, *said)
    wait_for(lambda: view._reading is None or draw(view, *said) is None)


@pytest.mark.parametrize("name", ARMS)
def test_the_drawn_arm_is_where_the_arm_is(console: Console, name: str) -> None:
    arm = ArticulatedArm(read_arm(name), lambda place, velocity, elapsed: (0.0, 0.0, 0.0), seed=0)
    for _ in range(600):
        sample = arm.exchange((0.03, -0.02, 0.01))
    view = console._arm
    draw(view, hello(name), telemetry(1, sample.joints, sample.place), leader_state(1, 1))
    (delayed, now), length = view._arms, read_arm(name).probe[0]
    assert (delayed._root.visible, now._root.visible) == (True, False)  # it stands still: both would be the same
    assert tip_of(delayed, length) == pytest.approx(sample.exact_place, abs=1e-3)
    bodies = {arm.body.model.body(number).name: number for number in range(arm.body.model.nbody)}
    flange = arm.body.data.xpos[bodies["tool"]] - arm.body.origin
    assert np.asarray(delayed._links[-1].position) / UNITS == pytest.approx(flange, abs=1e-3)
    links = np.array([link.position for link in delayed._links]) / UNITS
    drawn = [number for number in range(1, arm.body.model.nbody) if arm.body.model.body_geomnum[number]]
    np.testing.assert_allclose(links, arm.body.data.xpos[drawn] - arm.body.origin, atol=1e-3)


def test_what_is_heard_of_is_drawn_as_late_as_it_is_and_what_is_now_besides(console: Console) -> None:
    view, picture, joints = console._arm, ArmPicture(read_arm("ur5e")), moving("ur5e")
    watched = draw(view, *messages("ur5e"))
    (delayed, now), length = view._arms, 0.16
    assert watched.telemetry_sequence == HEARD
    for arm, tick in ((delayed, HEARD), (now, TICKS)):
        assert arm._root.visible
        assert tip_of(arm, length) == pytest.approx(picture.tip(joints[tick]), abs=1e-4)
    far = np.linalg.norm(tip_of(now, length) - tip_of(delayed, length))
    assert far > 5e-3
    draw(view, hello("ur5e"), telemetry(1, joints[0]), leader_state(1, 0))  # nothing was heard of yet
    assert (delayed._root.visible, now._root.visible) == (False, True)


def test_there_is_an_arm_only_where_one_is_in_a_scene(console: Console) -> None:
    view, joints = console._arm, moving("so101")
    with_meshes(view, *messages("so101"))
    line = LeaderState(VERSION, 1, 1, 0.0, 0.0, 0.0, 0.0, 0.0, 1, 0, math.nan, False, 1, 1)
    draw(view, hello("so101"), line)
    assert not any(arm._root.visible for arm in view._arms)
    draw(view, hello("so101"), telemetry(1, joints[0]), leader_state(1, 1))
    assert view._arms[0]._root.visible
    draw(view, hello("so101"), telemetry(1, joints[0][:4]), leader_state(1, 1))  # joints of another arm
    assert not any(arm._root.visible for arm in view._arms)
    draw(view, hello(SIMULATED), telemetry(1, ()), leader_state(1, 1))
    assert (view._arms, view.problem) == ((), "")


def test_an_arm_of_ones_own_is_drawn_and_one_that_is_not_here_is_said(console: Console, tmp_path: Path) -> None:
    own = tmp_path / "own.xml"
    text = read_arm("ur5e").path.read_text()
    assert 'data="0.45 0.134 0.15"' in text
    own.write_text(text.replace('data="0.45 0.134 0.15"', 'data="0.4 0 0.1"'))  # the origin of the scene
    view, joints = console._arm, moving("ur5e")
    draw(view, hello(str(own)), telemetry(1, joints[0]), leader_state(1, 1))
    moved = np.array((0.45, 0.134, 0.15)) - (0.4, 0.0, 0.1)
    tip = ArmPicture(read_arm("ur5e")).tip(joints[0])
    assert tip_of(view._arms[0], 0.16) == pytest.approx(tip + moved, abs=1e-4)
    for message in (hello("only-there.xml"), telemetry(1, joints[0]), leader_state(1, 1)):
        console.watch(message)
    left = [4]
    console.run(lambda: left.__setitem__(0, left[0] - 1) or left[0] < 0)  # type: ignore[func-returns-value]
    assert view._arms == ()
    assert "The arm cannot be drawn here: only-there.xml" in console._panel.forces._text.content
    assert console._space._scene is not None  # all else is drawn


def test_a_recording_shows_the_arm_of_its_moment(console: Console, tmp_path: Path) -> None:
    with SessionWriter(tmp_path / "arm.mcap") as writer:
        for message in messages("fr3"):
            writer.write(message, message.time_ns)
    log = read_session(tmp_path / "arm.mcap")
    assert log.follower_space.tobytes() == SessionLog.from_messages(messages("fr3")).follower_space.tobytes()
    playback, view = Playback(log), console._arm
    picture, joints, length = ArmPicture(read_arm("fr3")), moving("fr3"), 0.16
    for tick in (HEARD + 5, TICKS, HEARD + 10):
        playback.go_to(1e-3 * (tick - 1))
        view.draw(playback.at_once())
        delayed, now = view._arms
        assert (delayed._root.visible, now._root.visible) == (True, False)  # what its operator heard of by then
        assert tip_of(delayed, length) == pytest.approx(picture.tip(joints[tick - HEARD]), abs=1e-4)


def seen(arm: DrawnArm, link: int) -> Places:
    """Where the vertices of a drawn link are in the scene [m]."""
    drawn = arm._links[link]
    w, *turn = np.asarray(drawn.wxyz, np.float64)
    vertices = np.asarray(drawn.vertices, np.float64)
    twice = 2.0 * np.cross(turn, vertices)
    places: Places = np.asarray(drawn.position) + vertices + w * twice + np.cross(turn, twice)
    return places / UNITS


@pytest.mark.parametrize("name", ARMS)
def test_meshes_that_are_here_are_drawn_where_the_links_are(
    console: Console, name: str, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from menagerie import write_arm

    bodies = write_arm(name, elsewhere / "store")
    monkeypatch.setenv(DATA_DIR, str(elsewhere / "store"))
    view, joints = console._arm, moving(name)
    with_meshes(view, *messages(name))
    assert view.problem == ""
    arm = ArticulatedArm(read_arm(name), lambda place, velocity, elapsed: (0.0, 0.0, 0.0), seed=0)
    model, data = arm.body.model, arm.body.data
    for drawn, tick in zip(view._arms, (HEARD, TICKS), strict=True):
        assert drawn._root.visible
        data.qpos[model.jnt_qposadr[model.actuator_trnid[:, 0]]] = joints[tick]
        data.qpos[[number for number in range(model.njnt) if model.joint(number).name.endswith("_backlash")]] = 0.0
        mujoco.mj_kinematics(model, data)
        for link, (body, vertices) in enumerate(bodies.items()):
            where = vertices @ data.body(body).xmat.reshape(3, 3).T + data.body(body).xpos - arm.body.origin
            apart = np.linalg.norm(seen(drawn, link)[:, None] - where, axis=2)
            assert max(apart.min(axis=0).max(), apart.min(axis=1).max()) < 1e-4
        assert tip_of(drawn, read_arm(name).probe[0]) == pytest.approx(
            ArmPicture(read_arm(name)).tip(joints[tick]), abs=1e-4
        )
    assert [link.color for link in (view._arms[0]._links[2], view._arms[1]._links[2])] == [ARM_DELAYED, ARM_NOW]


def test_meshes_that_are_another_arms_are_not_drawn_and_the_console_says_why(
    console: Console, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from menagerie import write_arm

    write_arm("ur5e", elsewhere)
    path = elsewhere / "universal_robots_ur5e" / "ur5e.xml"
    path.write_text(path.read_text().replace("0.425", "0.5"))  # the upper arm of a larger one
    monkeypatch.setenv(DATA_DIR, str(elsewhere))
    view, joints = console._arm, moving("ur5e")
    with_meshes(view, *messages("ur5e"))
    assert "The arm is drawn without its meshes: " in view.problem
    assert "behind elbow_joint stands 75.0 mm" in view.problem
    assert tip_of(view._arms[0], 0.16) == pytest.approx(ArmPicture(read_arm("ur5e")).tip(joints[HEARD]), abs=1e-4)
    assert len(view._arms[0]._links[2].vertices) > 100  # capsules
    with_meshes(view, *messages("so101"))  # of which there are none
    assert view.problem == ""
    assert len(view._arms[0]._links[2].vertices) > 100


@pytest.mark.long
def test_large_meshes_are_read_beside_the_loop_and_thinned(
    console: Console, elsewhere: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from menagerie import write_arm

    write_arm("ur5e", elsewhere, fine=32)
    monkeypatch.setenv(DATA_DIR, str(elsewhere))
    view, said, longest = console._arm, messages("ur5e"), 0.0
    draw(view, *said)
    while view._reading is not None:
        begun = time.perf_counter()
        draw(view, *said)
        longest = max(longest, time.perf_counter() - begun)
        time.sleep(0.005)
    counts = [len(link.faces) for link in view._arms[0]._links[:-1]]
    assert all(1000 < count <= MOST_TRIANGLES for count in counts)
    assert longest < 1.0  # 0.05 s on a machine that does nothing else


@pytest.mark.skipif(chromium() is None, reason="needs Chromium")
@pytest.mark.long
def test_an_arm_before_the_handle_is_seen_catches_no_mouse_and_is_seen_as_a_whole(tmp_path: Path) -> None:
    from PIL import Image

    published: list[Message] = []
    console = Console(0, published.append, recordings=tmp_path)
    x, y, z = (UNITS * value for value in HOME)
    grip, eye = np.array((x, y, z + ARROW_SHARE * HANDLE_SIZE)), np.array(SPACE_CAMERA[0])
    before = grip + 0.15 * (eye - grip)  # on the line of sight, in the middle of the probe's holder
    joints = joints_at("fr3", tuple((before / UNITS - (0.0, 0.0, 0.06)).tolist()))
    said = hello("fr3"), telemetry(1, joints), leader_state(1, 1)
    ended = threading.Event()

    def go_on() -> bool:
        for message in said:
            console.watch(message)
        return ended.is_set()

    drawing = threading.Thread(target=console.run, args=(go_on,))
    drawing.start()
    try:
        with open_page(console.url, 1280, 800, "Drag the arrows") as (page, _):
            wait_for(lambda: console._arm._arms and console._arm._arms[0]._root.visible, page=page)
            page.wait_for_timeout(1500)
            beside = on_screen(page, tuple(before - np.array((0.0, 0.0, 6.0))), SPACE_CAMERA)  # below the handle
            picture = Image.open(io.BytesIO(page.screenshot())).convert("RGB")
            red, green, blue = picture.getpixel((round(beside[0]), round(beside[1])))
            assert red > green > blue
            assert np.abs(np.subtract((red, green, blue), ARM_DELAYED)).max() < 60
            with held_in_space(page, 20.0):
                wait_for(lambda: any(isinstance(one, Handle) and one.held for one in published), page=page)
            page.get_by_label("Whole arm").check()
            wait_for(lambda: console._camera is console._arm.camera is not None, page=page)
            whole = [on_screen(page, tuple(link.position), console._camera) for link in console._arm._arms[0]._links]
            page.keyboard.press("a")
            wait_for(lambda: console._camera is SPACE_CAMERA, page=page)
    finally:
        ended.set()
        drawing.join()
        console.close()
    places = [one for one in published if isinstance(one, Handle) and one.held]
    wide, high = np.ptp(whole, axis=0)
    assert 100 < wide < 810  # of a scene that is as wide and 800 high
    assert 300 < high < 700
    assert all(0 < x < 810 and 0 < y < 800 for x, y in whole)
    assert min(one.place[2] for one in places) < HOME[2] - 0.01
