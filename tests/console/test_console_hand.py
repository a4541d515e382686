"""The console of a session whose force moves a hand, without a browser."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator

import pytest
from console_driver import PRESS_DEPTH, SURFACE

from foretouch.console import Console
from foretouch.console.panels.figures import RENDERED, numbers_html
from foretouch.console.panels.panel import felt
from foretouch.console.views.hold import STROKE
from foretouch.console.views.probes import UNITS
from foretouch.console.views.shapes import HANDLE_HEIGHT
from foretouch.devices import GRIPS, INTENDED_FORCE
from foretouch.messages import VERSION, Handle, Hello, LeaderState, Message, Status, Telemetry

pytest.importorskip("viser")


def hello(**settings: object) -> Hello:
    content = {"surface": SURFACE, "press_depth": PRESS_DEPTH, **settings}
    return Hello(VERSION, 1, 1, "leader", tuple(content), tuple(map(str, content.values())))


def leader(position: float, hand: float, intended: float) -> LeaderState:
    numbers = (position, 0.0, 1.0, 1.0, 0.5, 1, 1, 0.0, False, 1_000_000, 50_000)
    return LeaderState(VERSION, 1, 1, *numbers, hand_position=hand, intended_position=intended, energy=3.1e-3)


def telemetry(guarded: bool) -> Telemetry:
    numbers = (0.01, 0.01, 0.0, 1.0, 1.0, 1.0, True, False, 1, 1_000_000, 50_000, guarded)
    return Telemetry(VERSION, 1, 1, 1, *numbers, status=Status.GUARDED if guarded else Status.FOLLOWING)


def height(position: float) -> float:
    """Of a handle at this position in the probe's frame [scene units]."""
    return (SURFACE - position) * UNITS + HANDLE_HEIGHT


@pytest.fixture
def shown() -> Iterator[tuple[Console, list[Message]]]:
    published: list[Message] = []
    console = Console(0, published.append)
    yield console, published
    console.close()


def test_a_drag_moves_the_hand_from_where_it_wanted_to_be(shown):
    """The hand is 8 mm ahead of the probe, wants 4 mm more, and moves twice as far as the probe."""
    console, published = shown
    console.watch(hello(grip="normal", position_scale=0.5))
    console.watch(leader(position=0.010, hand=0.036, intended=0.040))
    console._draw_scene(console._watched.at_once(), True)
    taken = 0.010 + 0.5 * 0.004  # where the handle is drawn
    console._line.drag_to(height(taken), True)
    assert published[-1].held
    assert published[-1].position == pytest.approx(0.040)
    console._line.drag_to(height(taken + 0.003), True)
    assert published[-1].position == pytest.approx(0.046)
    console._line.drag_to(height(taken - 0.002), False)
    assert published[-1].position == pytest.approx(0.036)
    assert not published[-1].held


def test_the_handle_ends_where_a_hand_that_is_pushed_out_still_reaches(shown):
    console, published = shown
    console.watch(hello(grip="soft"))
    console.watch(leader(position=0.01, hand=0.01, intended=0.01))
    console._draw_scene(console._watched.at_once(), True)
    console._line.drag_to(height(1.0), True)
    deepest = SURFACE + 1.2 * (PRESS_DEPTH + INTENDED_FORCE / GRIPS["soft"].stiffness)
    assert published[-1].position == pytest.approx(deepest)


def test_before_hand_and_follower_have_met_it_draws_what_there_is(shown):
    console, _ = shown
    console.watch(hello(grip="normal"))
    console.watch(leader(position=math.nan, hand=0.0, intended=0.0))
    console._draw_scene(console._watched.at_once(), True)
    assert console._line.hold.position == 0.0
    console.watch(telemetry(guarded=False))
    console._draw_scene(console._watched.at_once(), True)
    assert console._line.hold.position == pytest.approx(0.01)  # where the robot is
    console._plot(console._watched.at_once())
    console._write(console._watched.at_once(), time.monotonic())


def test_the_clutch_says_so_until_it_is_let_go(shown):
    console, published = shown
    console._toggle_clutch()
    assert [message.clutched for message in published] == [True]
    console._line.hold.keep_alive(time.monotonic() + 1.0)
    assert [message.clutched for message in published] == [True, True]
    console._toggle_clutch()
    console._line.hold.keep_alive(time.monotonic() + 1.0)
    assert [message.clutched for message in published] == [True, True, False]
    assert all(isinstance(message, Handle) and not message.held for message in published)


def test_strokes_of_keys_move_the_hand_and_let_it_go_a_second_after_the_last(shown):
    console, published = shown
    console.watch(hello(operator="browser"))
    console.watch(leader(position=0.010, hand=0.010, intended=0.010))
    console._draw_scene(console._watched.at_once(), True)
    console._step(5e-4)
    console._step(5e-4)
    assert [message.position for message in published] == pytest.approx([0.0105, 0.0110])
    assert all(message.held for message in published)
    console._line.hold.keep_alive(time.monotonic() + 0.5 * STROKE)
    assert published[-1].held
    console._line.hold.keep_alive(time.monotonic() + 1.1 * STROKE)
    assert not published[-1].held
    assert published[-1].position == pytest.approx(0.0110)
    console.watch(hello(operator="scripted"))
    sent = len(published)
    console._step(5e-4)
    console._toggle_clutch()
    assert len(published) == sent  # nobody listens


def test_a_robot_that_holds_back_is_said_to(shown):
    console, _ = shown
    console.watch(hello(grip="normal"))
    console.watch(telemetry(guarded=True))
    assert "The robot touches what the leader does not know yet: holds back." in console._status(time.monotonic())
    console.watch(telemetry(guarded=False))
    assert "holds back" not in console._status(time.monotonic())


def test_a_hand_that_is_apart_from_the_probe_is_a_ring_in_the_picture_and_no_number(shown):
    console, _ = shown
    console.watch(hello(grip="normal"))
    console.watch(leader(position=0.010, hand=0.0077, intended=0.0077))
    moment = console._watched.at_once()
    console._draw_scene(moment, True)
    ring, probe = console._line._hand, console._line._probes.probe
    assert ring.visible
    assert (ring.position[2] - probe.position[2]) / UNITS == pytest.approx(0.0023)  # so much further out
    text = numbers_html(moment, moment.window(6.0), None, depth=0.01, status="", warnings=())
    assert "hand " not in re.sub(RENDERED.name, "", text)


def test_whom_the_force_moves_is_said():
    texts = {felt(grip, by_mouse) for grip in ("", "soft") for by_mouse in (True, False)}
    assert len(texts) == 4
    assert felt("soft", False) == "It moves a hand of the operator (soft grip)."
