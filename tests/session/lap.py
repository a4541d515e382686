"""Both sides' steps with a network between them, tick by tick: either can be ended and begun again."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Self

from foretouch.devices import GRIPS, Device, Hand, ScriptedOperator
from foretouch.link import Faults, FaultStage
from foretouch.messages import LeaderState, Telemetry
from foretouch.robot import Robot, make_robot
from foretouch.session import SessionSettings
from foretouch.session.steps import follower, leader

MS = 1_000_000


class Leader:
    def __init__(self, settings: SessionSettings, material: Any, name: str, epoch: int) -> None:
        press: Device = ScriptedOperator(material.surface, material.press_depth, settings.seed)
        self.hand = press if settings.grip == "none" else Hand(press, GRIPS[settings.grip], settings.device)
        self.state = leader.start(settings, holder=name, epoch=epoch)
        self.returned: FaultStage[Any] = FaultStage(Faults(settings.force_delay))
        self.stopping = False
        self.begun = -1
        self.records: list[LeaderState] = []

    def step(self, now_ns: int) -> leader.Outputs:
        if self.begun < 0:
            self.begun = now_ns
        arrived = self.returned.pop_due(now_ns)
        inputs = leader.Inputs(
            self.hand.read(now_ns - self.begun),
            arrived,
            MS,
            0,
            stopping=self.stopping,
        )
        self.state, outputs = leader.step(self.state, inputs, now_ns)
        self.hand.render(outputs.record.rendered_force)
        self.records.append(outputs.record)
        return outputs


class Lap:
    def __init__(self, **changes: Any) -> None:
        delays = {"position_delay": 0.02, "force_delay": 0.03}
        self.settings = replace(SessionSettings(material="hunt-crossley", **delays), **changes)
        self.robot: Robot = make_robot(self.settings.material, seed=0)
        self.material = make_robot(self.settings.material, seed=0).material
        self.leaders: list[Leader] = []
        self.now = 0
        self.commands: FaultStage[Any] = FaultStage(Faults(self.settings.position_delay))
        self.telemetry: list[Telemetry] = []
        self.stop, self.release = "", False
        self.forces: list[float] = []
        self.start_follower(1)

    def start_follower(self, run: int, *, robot: bool = False) -> None:
        """A new process of the follower; with a new robot where that began anew too."""
        if robot:
            self.robot = make_robot(self.settings.material, seed=0)
        self.following = follower.start(self.robot.specification, self.settings, run=run)
        self.sample = self.robot.read()

    def start_leader(self, name: str, epoch: int) -> Leader:
        one = Leader(self.settings, self.material, name, epoch)
        self.leaders.append(one)
        return one

    @classmethod
    def led(cls, seconds: float, **changes: Any) -> Self:
        """One in which anna has led for so long."""
        lap = cls(**changes)
        lap.start_leader("anna", 11)
        lap.run(seconds)
        return lap

    def run(self, seconds: float, *, follows: bool = True) -> list[Telemetry]:
        """Let time pass; returns what the follower said, which does not run where it does not follow."""
        output = []
        for _ in range(round(seconds * 1000)):
            self.now += MS
            if follows:
                output.append(self._follow())
            for one in self.leaders:
                self.commands.push(self.now, one.step(self.now).command)
        self.telemetry += output
        return output

    def _follow(self) -> Telemetry:
        inputs = follower.Inputs(self.commands.pop_due(self.now), self.sample, MS, 0, self.stop, self.release)
        self.stop, self.release = "", False
        self.following, outputs = follower.step(self.following, inputs, self.now)
        self.sample = self.robot.exchange(outputs.desired_position)
        self.forces.append(self.sample.exact_force)
        for one in self.leaders:
            one.returned.push(self.now, outputs.telemetry)
            if outputs.model is not None:
                one.returned.push(self.now, outputs.model)
        return outputs.telemetry
