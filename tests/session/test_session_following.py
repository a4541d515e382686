"""A follower without Python: the compiled step along a line does what the step of a session does, to the last bit."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from lap import MS, Lap

from foretouch.export.beginnings import following_of
from foretouch.messages import Command, ModelUpdate, Telemetry, encode
from foretouch.session.network.freshness import Arrival
from foretouch.session.steps import follower
from foretouch.session.steps.following import publish, published, take, tick


class WithoutPython:
    """A follower that is driven by compiled code alone, from the same initial records."""

    def __init__(self, state: follower.State) -> None:
        self.records = following_of(state)

    def tick(self, inputs: follower.Inputs, now_ns: int) -> None:
        record = self.records[0]
        for one in inputs.commands:
            self.take(one, now_ns)
        stop, release = bool(inputs.stop), inputs.release
        tick.entry(record, inputs.sample[:8], now_ns, inputs.period_ns, stop, release, inputs.ended)

    def take(self, command: Command, now_ns: int) -> int:
        received, name = self.records["received"][0], command.holder.encode()
        for field in received.dtype.names[2:]:
            received[field] = getattr(command, field)
        received["holder"][: len(name)], received["holder_size"] = np.frombuffer(name, np.uint8), len(name)
        return take.entry(self.records[0], now_ns)

    def model(self, now_ns: int) -> np.void | None:
        return self.records["published"][0, 0] if publish.entry(self.records[0], now_ns) else None


class Twin(Lap):
    """A session whose follower has a twin without Python, which is compared with it in every tick."""

    def start_follower(self, run: int, *, robot: bool = False) -> None:
        super().start_follower(run, robot=robot)
        self.twin = WithoutPython(self.following)
        self.models = 0

    def _follow(self) -> Telemetry:
        commands = self.commands.pop_due(self.now)
        inputs = follower.Inputs(commands, self.sample, MS, 0, self.stop, self.release)
        self.stop, self.release = "", False
        self.following, outputs = follower.step(self.following, inputs, self.now)
        self.twin.tick(inputs, self.now)
        compare(self.twin, outputs, self.now)
        self.models += outputs.model is not None
        self.sample = self.robot.exchange(outputs.desired_position)
        for one in self.leaders:
            one.returned.push(self.now, outputs.telemetry)
            if outputs.model is not None:
                one.returned.push(self.now, outputs.model)
        return outputs.telemetry


NUMBERS = ("desired_position", "position", "velocity", "sensor_force", "force")
OTHERS = ("in_contact", "guarded", "status", "validity", "command_sequence", "sequence")


def same(one: float, other: float) -> bool:
    return np.float64(one).tobytes() == np.float64(other).tobytes() or (math.isnan(one) and math.isnan(other))


def compare(twin: WithoutPython, outputs: follower.Outputs, now_ns: int) -> None:
    shown, telemetry, model = twin.records["shown"][0], outputs.telemetry, twin.model(now_ns)
    for name in NUMBERS:
        assert same(shown[name], getattr(telemetry, name)), (telemetry.sequence, name)
    for name in OTHERS:
        assert int(shown[name]) == int(getattr(telemetry, name)), (telemetry.sequence, name)
    assert (model is None) == (outputs.model is None), telemetry.sequence
    if model is not None and outputs.model is not None:
        compare_models(model, outputs.model)
        published.entry(twin.records[0], len(encode(outputs.model)))


def compare_models(model: Any, update: ModelUpdate) -> None:
    for name in ("sequence", "command_sequence", "epoch", "valid"):
        assert int(model[name]) == int(getattr(update, name)), (update.sequence, name)
    assert same(model["surface"], update.surface)
    if update.valid:
        assert model["map"][: model["count"]].astype("<f4").tobytes() == update.map
        assert model["parameters"].tolist() == list(update.parameters)
        assert model["state"].tolist() == list(update.state)


@pytest.mark.parametrize("material", ["hunt-crossley", "foam", "kelvin-voigt"])
@pytest.mark.long
def test_a_follower_without_python_gives_the_same_bits(material: str) -> None:
    lap = Twin.led(4.0, material=material, grip="normal", first_touch="guarded")
    assert lap.models > 100


@pytest.mark.long
def test_also_with_another_leader_and_an_emergency_stop_that_is_released() -> None:
    lap = Twin.led(2.0, grip="normal")
    lap.stop = "somebody pressed it"
    lap.run(1.0)
    lap.release = True
    lap.run(1.0)
    lap.leaders.clear()  # silence: it holds, and unloads
    lap.run(1.5)
    lap.start_leader("bert", 12)
    lap.run(2.0)
    assert lap.following.lease.holder == "bert"


@pytest.mark.long
def test_also_where_the_sensor_fails_and_is_mended() -> None:
    lap = Twin.led(2.0)
    for _ in range(40):
        lap.sample = lap.sample._replace(position=lap.sample.position + 0.05)
        lap.run(0.001)
    lap.run(0.5)
    lap.release = True
    lap.run(1.0)


def test_a_command_that_is_stale_or_of_nobody_is_not_obeyed() -> None:
    lap = Twin.led(0.5)
    twin, now, newest = lap.twin, lap.now, lap.leaders[0].state.sequence
    assert twin.take(Command(2, 10**6, now, 0.02, 0, False, "", 3), now) < 0  # a leader without a name
    assert twin.take(Command(2, newest, now, 0.02, 0, False, "bert", 12), now) < 0  # another one has control
    sent = now + 1 * MS, now + 600 * MS
    assert twin.take(Command(2, newest + 1, sent[0], 0.02, 0, False, "anna", 11), now + 600 * MS) == Arrival.STALE
    assert twin.take(Command(2, newest + 2, sent[1], 0.02, 0, False, "anna", 11), now + 625 * MS) == Arrival.FRESH
    assert twin.take(Command(2, newest + 2, sent[1], 0.02, 0, False, "anna", 11), now + 626 * MS) == Arrival.OVERTAKEN
