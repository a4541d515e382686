"""Images over a thin link: they take what is left over, and what is felt comes as it does without them."""

from __future__ import annotations

import functools
import random
from typing import Any

import msgspec
import numpy as np
import pytest
from thin_serial import BothEnds, SerialLink, image_at
from thin_ticks import MS, telemetry_at

from foretouch.errors import MissingExtraError
from foretouch.messages import CameraImage, FollowerPacket, Message, ModelUpdate, decode, encode
from foretouch.session import SessionSettings
from foretouch.session.spatial import make_camera, make_scene
from foretouch.session.spatial.camera import LARGEST_SMALL, small_image
from foretouch.session.thin import FollowerEnd, LeaderEnd
from foretouch.vision.camera import opencv

BUDGET = 2000.0
STILL = 3000


def still(tick: int) -> Message:
    """Telemetry of a robot that stands still."""
    now = telemetry_at(tick)
    changes = {"sequence": tick, "time_ns": tick * MS, "command_sequence": max(tick - 90, 0)}
    return msgspec.structs.replace(telemetry_at(STILL, space=True), model_sequence=now.model_sequence, **changes)


def images_of(shown: list[tuple[int, Message]]) -> list[tuple[int, CameraImage]]:
    return [(tick, message) for tick, message in shown if isinstance(message, CameraImage)]


def said(budget: float, seconds: int, **changes: Any) -> tuple[list[int], BothEnds]:
    """When models came over a serial link of the budget, and both ends after that."""
    both = BothEnds(budget, (SerialLink(budget, 30 * MS), SerialLink(budget, 30 * MS)), **changes)
    models = []
    for _ in range(1000 * seconds):
        _, came = both.run(1)
        models += [both.tick for one in came if isinstance(one, ModelUpdate)]
    return models, both


@pytest.mark.parametrize("noise", [0.0, 1e-4, 2e-3])
@pytest.mark.first
def test_models_and_signs_of_life_come_as_they_do_without_images(noise: float) -> None:
    """Over a serial link each may stand behind one packet."""
    packet = round(1e3 * (0.02 + 11 / BUDGET)) + 1  # [ms]
    without, _ = said(BUDGET, 12, space=True, heavy=True, noise=noise, seed=3)
    within, both = said(BUDGET, 12, space=True, heavy=True, noise=noise, seed=3, images=True)
    assert len(within) >= len(without) - 1
    assert max(np.diff(within)) <= max(np.diff(without)) + 2 * packet
    assert both.links[1].longest_queue <= 3 * packet * 1e-3


@pytest.mark.parametrize("noise", [0.0, 0.02])
@pytest.mark.first
def test_an_image_comes_beside_lines_that_take_all(noise: float) -> None:
    """The force of a robot in space is noisy, so that there is always a line that is worth saying."""
    follower, leader, draw = FollowerEnd(BUDGET), LeaderEnd(BUDGET), random.Random(1)
    shown: list[tuple[int, Message]] = []
    for tick in range(1, 40_000):
        if tick % 1000 == 500:
            follower.show(encode(image_at(tick)))
        message = telemetry_at(tick, space=True)
        assert message.space is not None
        force = {f"force_{axis}": draw.gauss(0.0, noise) for axis in "xyz"}
        message = msgspec.structs.replace(message, space=msgspec.structs.replace(message.space, **force))
        leader.deliver = lambda image, tick=tick: shown.append((tick, image))
        leader.heard(follower.said([message], tick * MS)[1:], tick * MS)
    ages = [tick - image.tick for tick, image in images_of(shown)]
    assert len(ages) >= 3
    assert max(ages) <= 12_000
    assert follower.sent <= BUDGET * 40.0 + 100.0


@pytest.mark.parametrize(("budget", "longest"), [(1000.0, 8.0), (2000.0, 4.0), (8000.0, 1.5)])
@pytest.mark.first
def test_an_image_of_a_robot_that_stands_still_takes_some_seconds(budget: float, longest: float) -> None:
    links = SerialLink(budget), SerialLink(budget)
    both = BothEnds(budget, links, space=True, images=True)
    both._of_follower = functools.partial(_camera_beside, both)  # type: ignore[method-assign]
    both.run(20_000)
    came = images_of(both.shown)
    assert len(came) >= 2
    for tick, image in came:
        assert image == image_at(image.tick)
        assert 1e-3 * (tick - image.tick) <= longest + 1.0  # a newer one waits meanwhile, for a second at most
    assert [image.tick for _, image in came] == sorted({image.tick for _, image in came})


def _camera_beside(both: BothEnds) -> list[Message]:
    if both.tick % 1000 == 500:
        both.follower.show(encode(image_at(both.tick)))
    return [still(both.tick)]


def test_an_image_that_lacks_pieces_is_left_out_and_the_next_one_comes() -> None:
    draw, leader, follower = random.Random(1), LeaderEnd(BUDGET), FollowerEnd(BUDGET)
    shown: list[Message] = []
    leader.deliver = shown.append
    for tick in range(1, 24_000):
        if tick in (100, 9000):
            follower.show(encode(image_at(tick)))
        packets = [one for one in follower.said([still(tick)], tick * MS) if isinstance(one, FollowerPacket)]
        leader.heard([one for one in packets if tick > 8000 or draw.random() > 0.2], tick * MS)
    assert shown == [image_at(9000)]


def test_what_is_no_image_is_shown_to_nobody() -> None:
    leader, follower = LeaderEnd(BUDGET), FollowerEnd(BUDGET)
    shown: list[Message] = []
    leader.deliver = shown.append
    follower.show(b"\x9b" + bytes(300))
    for tick in range(1, 8000):
        packets = follower.said([still(tick)], tick * MS)[1:]
        leader.heard(packets, tick * MS)
    assert not shown
    assert follower._outbox.is_empty


@pytest.mark.parametrize("scene", ["phantom", "hill"])
@pytest.mark.first
def test_a_small_image_is_readable_and_fits_a_packet(scene: str) -> None:
    try:
        cv2 = opencv()
    except MissingExtraError as error:
        pytest.skip(str(error))
    camera = make_camera(SessionSettings(scene=scene), make_scene(scene, 0.0), say=print)
    if camera is None:
        pytest.skip("nothing here draws")
    image = camera.take((0.0,) * 6, (0.0, 0.0, 0.03), 7, 0.0, 1, run=3)
    camera.close()
    for budget, width, most in ((BUDGET, 160, 1500), (8000.0, 320, LARGEST_SMALL)):
        data = small_image(image, budget)
        assert 300 < len(data) <= most
        small = decode(data, CameraImage)
        assert (small.tick, small.run, small.markers, small.camera) == (7, 3, image.markers, image.camera)
        grey = cv2.imdecode(np.frombuffer(small.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        true = cv2.imdecode(np.frombuffer(image.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert grey.shape[1] == width
        again = cv2.resize(grey, true.shape[::-1])
        assert np.abs(again.astype(float) - true).mean() < 8.0
    assert small_image(msgspec.structs.replace(image, jpeg=b""), BUDGET) == b""
    assert small_image(msgspec.structs.replace(image, jpeg=b"no image"), BUDGET) == b""
