"""The sides of a session in three dimensions as the loops in real time drive them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from foretouch.devices import SpatialBrowserOperator, SpatialDevice, SpatialHand
from foretouch.link import ZenohLink
from foretouch.messages import (
    Command,
    FieldUpdate,
    FixtureBelief,
    FollowerSpace,
    Handle,
    Message,
    ModelUpdate,
    Telemetry,
)
from foretouch.quantities.pose import Vector, add, norm, scaled, subtract
from foretouch.robot import SpatialRobot
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial import follower, leader
from foretouch.session.spatial.scenes import make_scene
from foretouch.session.steps import follower as along_the_line


class SpaceFollower:
    """A follower in three dimensions; see `foretouch.session.runners.driven.DrivenFollower`.

    Args:
        robot: To command.
        settings: Of the session.
        run: Epoch of this process.
    """

    channels: tuple[str, ...] = ("fixture",)

    def __init__(self, robot: SpatialRobot, settings: SessionSettings, run: int) -> None:
        scene = make_scene(settings.scene)
        self._robot = robot
        self._whole = follower.start(robot.specification, settings, scene.surface, scene.nominal, run=run)
        self.state = self._whole.inner
        self._beliefs: list[FixtureBelief] = []
        self.sample = robot.read()
        self._desired = self.sample.place
        self._back = settings.return_speed * SAMPLE_PERIOD

    def exchange(self) -> None:
        """Let a sample period of the robot pass, with the newest command."""
        self.sample = self._robot.exchange(self._desired)

    def listen(self, link: ZenohLink) -> None:
        """Take what the tracker says."""
        self.believe([belief for _, belief in link.take("fixture")])

    def believe(self, beliefs: list[FixtureBelief]) -> None:
        """Take what is believed of the fixture, for the next tick."""
        self._beliefs = beliefs

    def tick(
        self,
        commands: list[Command],
        period_ns: int,
        compute_ns: int,
        now_ns: int,
        *,
        stop: str = "",
        release: bool = False,
        ended: bool = False,
    ) -> list[Message]:
        """One tick: what it says."""
        beliefs, self._beliefs = self._beliefs, []
        inputs = follower.Inputs(commands, self.sample, period_ns, compute_ns, beliefs, stop, release, ended)
        _, acted = follower.step(self._whole, inputs, now_ns)
        self._desired = acted.desired
        said = (acted.telemetry, acted.space, acted.model, acted.field)
        return [message for message in said if message is not None]

    def back_off(self) -> None:
        """Where a tick raises: go back along the force that the newest sample feels, whatever is believed."""
        force = subtract(self.sample.force, self._whole.bias)
        size = norm(force)
        if 0.0 < size < math.inf:
            along_the_line.feel_plainly(self.state, size)
            self._desired = add(self._desired, scaled(force, self._back / size))
            self._whole.last.begin(self._desired)


class SpaceLeader:
    """A leader in three dimensions; see `foretouch.session.runners.driven.DrivenLeader`.

    Args:
        operator: Moves it.
        settings: Of the session.
        holder: Name of this leader.
        epoch: Of this process.
    """

    channels: tuple[str, ...] = ("follower-space", "field")

    def __init__(self, operator: SpatialDevice, settings: SessionSettings, holder: str, epoch: int) -> None:
        scene = make_scene(settings.scene)
        self.nowhere = 0
        self._operator = operator
        self._whole = leader.start(settings, scene.surface, scene.nominal, holder=holder, epoch=epoch)
        self.state = self._whole.inner
        moved = operator.intention_device if isinstance(operator, SpatialHand) else operator
        self._mouse = moved if isinstance(moved, SpatialBrowserOperator) else None
        self._apart: Vector = (0.0, 0.0, 0.0)  # of hand and world, when the handle was taken

    def take(self, handle: Handle, now_ns: int) -> None:
        """Take what the browser says of its handle: a place in the world, which may be apart from the hand's own."""
        mouse = self._mouse
        if mouse is None:
            return
        if not mouse.held:
            self._apart = self._whole.apart
        place: Sequence[float] = handle.place
        if len(place) == 3:
            here = add((place[0], place[1], place[2]), self._apart)
            place = scaled(here, 1.0 / self._whole.position_scale)
        mouse.take(place, handle.held, now_ns, clutched=handle.clutched)

    def tick(
        self, arrived: Sequence[Message], operator_ns: int, period_ns: int, compute_ns: int, now_ns: int, *, stop: bool
    ) -> list[Message]:
        """One tick: what it says, the command first."""
        operator = self._operator
        operator.see(self._whole.line.pose)
        place = operator.read(operator_ns)
        if not all(map(math.isfinite, place)):
            self.nowhere += 1
        inputs = leader.Inputs(
            place,
            [message for message in arrived if type(message) is ModelUpdate],
            [message for message in arrived if type(message) is Telemetry],
            [message for message in arrived if type(message) is FollowerSpace],
            [message for message in arrived if type(message) is FieldUpdate],
            period_ns,
            compute_ns,
            operator.clutched,
            stop,
            operator.exact_place,
            operator.intention,
        )
        _, led = leader.step(self._whole, inputs, now_ns)
        operator.render(led.force)
        return [led.command, led.record, led.space]
