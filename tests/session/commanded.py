"""A follower and its simulated arm, commanded tick by tick: along a line over a network, and in space."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from foretouch.link import Faults, FaultStage
from foretouch.messages import VERSION, Command, FixtureBelief, Status
from foretouch.robot import RobotSample, SpatialSample, make_robot
from foretouch.session import SessionSettings
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.steps import follower

MS = 1_000_000
CEILING = 15.0
NO_LIMIT = 1000.0
"""Of the drive [N]: none that counts."""

Place = tuple[float, ...]


class Commanded:
    """Along a line; the forces are the simulator's own, once a tick [N]."""

    def __init__(
        self,
        material: str,
        network: Faults = Faults(0.0),  # noqa: B008
        *,
        seed: int = 1,
        force_limit: float = NO_LIMIT,
        first_touch: str = "follow",
    ) -> None:
        self.settings = SessionSettings(material=material, model="kelvin-voigt", first_touch=first_touch)
        self.robot = make_robot(material, seed=seed, force_limit=force_limit)
        self.network: FaultStage[Command] = FaultStage(network)
        self.sample = self.robot.read()
        self.now = self.sequence = self.runs = self.acknowledged = 0
        self.epoch, self.place = 1, 0.0
        self.path: list[float] = []
        self.forces: list[float] = []
        self.statuses: list[Status] = []
        self.begin()

    def begin(self) -> None:
        """The follower's process begins, perhaps again; the arm stays where it is."""
        self.runs += 1
        self.following = follower.start(self.robot.specification, self.settings, run=self.runs)

    def tick(self, position: float | None, *, stop: str = "", release: bool = False, **fields: Any) -> follower.Outputs:
        """One tick, with a command or without one."""
        self.now += MS
        if position is not None:
            self.sequence += 1
            self.place = position if math.isfinite(position) else self.place
            self.say(Command(VERSION, **self._fields(position) | fields))
        inputs = follower.Inputs(self.network.pop_due(self.now), self.sample, MS, 0, stop, release)
        self.following, outputs = follower.step(self.following, inputs, self.now)
        self.path.append(outputs.desired_position)
        raw = self.robot.exchange(outputs.desired_position)
        self.forces.append(raw.exact_force)
        self.statuses.append(self.following.safety.status)
        self.sample = self.seen(raw)
        return outputs

    def go(self, position: float | None, ticks: int) -> None:
        for _ in range(ticks):
            self.tick(position)

    def _fields(self, position: float) -> dict[str, Any]:
        """Of a command that acknowledges all that was said: else nothing after a release is obeyed."""
        return {
            "sequence": self.sequence,
            "time_ns": self.now,
            "position": position,
            "acknowledged_model": self.acknowledged,
            "holder": "enemy",
            "epoch": self.epoch,
            "telemetry_sequence": self.following.tick,
            "run": self.runs,
        }

    def say(self, command: Command) -> None:
        self.network.push(self.now, command)

    def seen(self, sample: RobotSample) -> RobotSample:
        return sample


class CommandedInSpace:
    """The same in space; in a silent tick a command was lost, or was not sent."""

    numbers_silence = True

    def __init__(self, robot: Any, settings: SessionSettings, surface: Any, nominal: Place) -> None:
        self.robot, self.settings, self.surface, self.nominal = robot, settings, surface, nominal
        self.sample: SpatialSample = robot.read()
        self.ticks = self.sequence = 0
        self.forces: list[float] = []
        self.begin()

    def begin(self) -> None:
        """A follower that is started, perhaps again: the path begins where the robot is then."""
        self.state = follower.start(
            self.robot.specification, self.settings, probe=ProbeInSpace(self.surface, self.nominal)
        )
        self.path = [self.sample.place]

    def tick(self, place: Place | None, *, beliefs: Iterable[FixtureBelief] = (), **asked: Any) -> follower.Outputs:
        self.ticks += 1
        self.sequence += place is not None or self.numbers_silence
        now = self.ticks * MS
        commands = []
        if place is not None:
            output = (self.sequence, now, 0.0, 0, False, "test", 1)
            commands = [Command(VERSION, *output, place=place, telemetry_sequence=self.state.tick, run=1)]
        inputs = follower.Inputs(commands, self.seen(self.sample), MS, 0, beliefs=list(beliefs), **asked)
        self.state, acted = follower.step(self.state, inputs, now)
        self.path.append(acted.desired_position)
        self.sample = self.robot.exchange(acted.desired_position)
        self.forces.append(math.hypot(*self.sample.exact_force))
        return acted

    def seen(self, sample: SpatialSample) -> SpatialSample:
        return sample
