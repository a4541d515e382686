"""What every device that is felt has from its base, over a driver that notes what it is asked to push."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Iterator

import pytest

from foretouch.devices import DeviceSpecification
from foretouch.devices.felt import LOOKS, NO_FORCE, PATIENCE, FeltAlongAxis, FeltInSpace, HandleLink
from foretouch.devices.spatial import NOWHERE
from foretouch.quantities.pose import Vector


class Link(HandleLink):
    """Shows a place, and takes a while to push."""

    def __init__(self) -> None:
        self.here: Vector = (0.1, 0.2, 0.3)
        self.forces: list[Vector] = []
        self.slow, self.begun, self.closed = 0.0, threading.Event(), 0

    def place(self) -> Vector:
        return self.here

    def push(self, force: Vector) -> bool:
        self.begun.set()
        time.sleep(self.slow)
        self.forces.append(force)
        return self.here is not NOWHERE

    def close(self) -> None:
        self.closed += 1


class Line(FeltAlongAxis):
    name = "line"


class Space(FeltInSpace):
    name = "space"


SPECIFICATION = DeviceSpecification(damping=2.0, force_limit=8.0)


@pytest.fixture
def link() -> Link:
    return Link()


@pytest.fixture
def line(link: Link) -> Iterator[Line]:
    made = Line(link, SPECIFICATION)
    yield made
    made.close()


def test_it_is_felt_and_says_how_long_a_force_lasts(line: Line) -> None:
    assert (line.closed_loop, line.real_time, line.specification.pulls) == (True, True, True)
    assert line.specification.watchdog == PATIENCE + LOOKS
    assert not line.clutched
    assert not line.lost


def test_no_place_is_no_number_and_the_origin_stays(link: Link, line: Line) -> None:
    link.here = NOWHERE
    assert math.isnan(line.read(0))
    assert line.render(3.0) == 0.0
    link.here = (0.1, 0.2, 0.3)
    assert line.read(1) == 0.0
    link.here = NOWHERE
    assert math.isnan(line.read(2))
    link.here = (0.0, 0.0, 0.28)
    assert line.read(3) == pytest.approx(0.02)
    assert line.render(3.0) == 3.0


def test_where_nobody_renders_the_force_is_zero_within_fifty_milliseconds(link: Link, line: Line) -> None:
    end = time.monotonic() + 0.2
    while time.monotonic() < end:
        line.render(3.0)
        time.sleep(1e-3)
    rendered = time.monotonic()
    while link.forces[-1] != NO_FORCE:
        time.sleep(1e-3)
    assert PATIENCE - 2e-3 < time.monotonic() - rendered < 1.0  # this machine may be late
    line.render(3.0)
    assert link.forces[-1] == (0.0, 0.0, 3.0)


def test_a_force_that_is_under_way_when_another_thread_closes_is_not_the_last(link: Link) -> None:
    device = Line(link, SPECIFICATION)
    device.render(1.0)
    link.slow = 0.05
    link.begun.clear()
    loop = threading.Thread(target=device.render, args=(3.0,))
    loop.start()
    link.begun.wait(5.0)
    device.close()
    loop.join()
    assert link.forces[-2:] == [(0.0, 0.0, 3.0), NO_FORCE]
    assert device.render(3.0) == 0.0
    time.sleep(2.0 * PATIENCE)
    device.close()
    assert link.forces[-2:] == [(0.0, 0.0, 3.0), NO_FORCE]
    assert link.closed == 1


def test_in_space_the_limit_is_of_the_whole_force_and_the_last_place_stays_after_the_end(link: Link) -> None:
    device = Space(link, SPECIFICATION)
    assert device.read(0) == (0.1, 0.2, 0.3)
    device.render((0.0, 30.0, -40.0))
    assert link.forces[-1] == pytest.approx((0.0, 4.8, -6.4))
    for wrong in ((math.nan, 0.0, 0.0), (0.0, math.inf, 0.0)):
        device.render(wrong)
        assert link.forces[-1] == NO_FORCE
    link.here = NOWHERE
    assert device.read(1) is NOWHERE
    device.close()
    assert device.read(2) == (0.1, 0.2, 0.3)
