"""A follower and its simulated arm, commanded tick by tick, along a line over a network and in space; and scenes."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from hypothesis import strategies as st

from foretouch.link import Faults, FaultStage
from foretouch.messages import VERSION, Command, FixtureBelief, Status
from foretouch.quantities.pose import Vector
from foretouch.rendering.surfaces import TriangleMesh
from foretouch.robot import RobotSample, SpatialSample, make_robot
from foretouch.session import SessionSettings
from foretouch.session.spatial import make_scene
from foretouch.session.spatial.probe import ProbeInSpace
from foretouch.session.spatial.scenes import MIDDLE, Scene
from foretouch.session.steps import follower

MS = 1_000_000
CEILING = 15.0
NO_LIMIT = 1000.0
"""Of the drive [N]: none that counts."""

Place = tuple[float, ...]
X, Y, Z = MIDDLE


def mesh(corners: list[Vector], faces: list[tuple[int, int, int]]) -> TriangleMesh:
    return TriangleMesh([(X + x, Y + y, Z + z) for x, y, z in corners], faces)


def block(x: float, y: float, z: float) -> TriangleMesh:
    corners = [(a, b, c) for a in (-x, x) for b in (-y, y) for c in (-z, 0.0)]
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    return mesh(corners, [half for a, b, c, d in sides for half in ((a, b, c), (a, c, d))])


def groove() -> TriangleMesh:
    corners = [(x, y, -0.02 if x == 0.0 else 0.0) for x in (-0.03, 0.0, 0.03) for y in (-0.03, 0.03)]
    return mesh(corners, [(0, 2, 1), (1, 2, 3), (2, 4, 3), (3, 4, 5)])


SCENES = {name: make_scene(name) for name in ("plane", "hill", "phantom")} | {
    name: Scene(name, surface)
    for name, surface in (
        ("cube", block(0.02, 0.02, 0.04)),
        ("thin plate", block(0.02, 0.02, 0.002)),
        ("groove", groove()),
    )
}


def parts_with(troubles: tuple[str, ...]) -> st.SearchStrategy[list[tuple[Vector, int, str]]]:
    """Where something goes to in space [m], in how many ticks, and what happens meanwhile."""
    heights = st.sampled_from((-0.05, -0.01, -0.003, 0.004, 0.02))
    places = st.tuples(st.floats(-0.05, 0.05), st.floats(-0.03, 0.03), heights)
    part = st.tuples(places, st.sampled_from((1, 40, 120)), st.sampled_from(troubles))
    return st.lists(part, min_size=1, max_size=5)


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
            commands = [Command(VERSION, *output, place=tuple(place), telemetry_sequence=self.state.tick, run=1)]
        inputs = follower.Inputs(commands, self.seen(self.sample), MS, 0, beliefs=list(beliefs), **asked)
        self.state, acted = follower.step(self.state, inputs, now)
        self.path.append(acted.desired_position)
        self.sample = self.robot.exchange(acted.desired_position)
        self.forces.append(math.hypot(*self.sample.exact_force))
        return acted

    def seen(self, sample: SpatialSample) -> SpatialSample:
        return sample
