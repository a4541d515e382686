"""What the steps of sessions took and gave, as the program of C reads it (`session_ticks.c`) and has to give it."""

from __future__ import annotations

import struct
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from enum import IntEnum
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from foretouch.export.beginnings import following_of
from foretouch.identification import SENSOR_SENTENCES, ContactMap, SensorState
from foretouch.messages import Command, Message, ModelUpdate, Telemetry, encode
from foretouch.session import SessionSettings, simulate
from foretouch.session.network.model_sender import ModelSender
from foretouch.session.runners.warm_up import warm_up_once
from foretouch.session.steps import follower, leader
from foretouch.session.steps.following import ShownFollower
from foretouch.session.steps.leading import Shown

SOURCE = Path(__file__).with_name("session_ticks.c")
SESSIONS: dict[str, dict[str, Any]] = {
    "hunt-crossley": {},
    "foam, normal grip": {"material": "foam", "grip": "normal"},
    "kelvin-voigt, stiff grip, guarded": {"material": "kelvin-voigt", "grip": "stiff", "first_touch": "guarded"},
    "jitter, loss and outages": {"grip": "normal", "jitter": 0.05, "loss": 0.2, "outage": 1.0},
    "one second each way": {"position_delay": 1.0, "force_delay": 1.0, "grip": "soft"},
    "clutch": {"grip": "normal", "clutch": "2:3,5:6"},
    "sensor that fails": {"sensor_fault": "stuck:4:6"},
    "another seed and frames": {"seed": 7, "leader_frame": "0.1,-1", "position_scale": 2.0, "grip": "normal"},
    "no delay": {"position_delay": 0.0, "force_delay": 0.0, "material": "foam"},
    "law of the paper, leader alone": {"model": "continuous-switching", "estimator": "fprls", "grip": "normal"},
    "law of Hunt and Crossley, leader alone": {"model": "hunt-crossley", "estimator": "log-rls", "grip": "normal"},
}
"""The golden sessions: settings beside the defaults. A follower of C learns a contact map alone."""

SHOWN, SHOWN_FOLLOWER = Shown.layout, ShownFollower.layout
RECORDED = {"step_by_models": "update_step", "jump": "model_jump"}
"""What a leader's own record calls what its step came to, where not by its name."""


class Log:
    """What one leader and one follower took, and what they gave in each tick."""

    def __init__(self) -> None:
        self.taken = bytearray()
        self.given: list[tuple[Any, ...]] = []

    def lead(self, inputs: leader.Inputs, now_ns: int, outputs: leader.Outputs) -> None:
        for message in inputs.arrived:
            if isinstance(message, Telemetry | ModelUpdate):
                self.taken += letter_of(message)
        flags = inputs.clutched, inputs.stopping
        self.taken += b"t" + struct.pack("<qdqBB", now_ns, inputs.position, inputs.period_ns, *flags)
        shown = plain(getattr(outputs.record, RECORDED.get(name, name)) for name in SHOWN.names or ())
        self.given.append((shown, fields(outputs.command)))

    def follow(self, inputs: follower.Inputs, now_ns: int, outputs: follower.Outputs) -> None:
        for command in inputs.commands:
            content = encode(command)
            self.taken += b"c" + struct.pack("<qI", now_ns, len(content)) + content
        self.taken += b"s" + sample_bytes(inputs.sample)
        flags = bool(inputs.stop), inputs.release, inputs.ended
        self.taken += struct.pack("<qqqBBB", now_ns, inputs.period_ns, inputs.compute_ns, *flags)
        telemetry, model = outputs.telemetry, outputs.model
        shown = plain(getattr(telemetry, name) for name in SHOWN_FOLLOWER.names or ())
        self.given.append((shown, None if model is None else fields(model), fields(telemetry)))


def sample_bytes(sample: Any) -> bytes:
    return struct.pack("<6dBd", *sample[:6], sample[6], sample[7])


def letter_of(message: Message) -> bytes:
    content = encode(message)
    return (b"h" if isinstance(message, Telemetry) else b"a") + struct.pack("<I", len(content)) + content


def plain(values: Any) -> str:
    """Numbers by their bits, and whatever is no number as the same."""
    return " ".join(repr(float(value)) for value in values)


def fields(message: Message) -> str:
    values = msgspec.structs.astuple(message)
    return repr([int(value) if isinstance(value, IntEnum) else value for value in values])


@contextmanager
def watched(log: Log) -> Iterator[None]:
    """While it lasts, the steps of sessions are written down; models say what those of C say."""
    steps = leader.step, follower.step
    begun: dict[str, Any] = {}

    def lead(state: leader.State, inputs: leader.Inputs, now_ns: int) -> tuple[leader.State, leader.Outputs]:
        if begun.get("leader") is not state:
            assert state.holder == "anna" or not begun.get("leader"), "one name alone"
            begun["leader"], state.holder = state, "anna"
            log.taken += b"L" + state.records.tobytes()
        state, outputs = steps[0](state, inputs, now_ns)
        log.lead(inputs, now_ns, outputs)
        return state, outputs

    def follow(state: follower.State, inputs: follower.Inputs, now_ns: int) -> tuple[follower.State, follower.Outputs]:
        learns = type(state.learner.estimator) is ContactMap
        if learns and begun.get("follower") is not state:
            begun["follower"] = state
            log.taken += b"F" + following_of(state).tobytes()
        state, outputs = steps[1](state, inputs, now_ns)
        if learns:
            log.follow(inputs, now_ns, outputs)
        return state, outputs

    def reason(_: ModelSender, __: Any, sensors: SensorState, ___: int) -> str:
        return "" if sensors is SensorState.GOOD else f"nothing is learnt: {SENSOR_SENTENCES[sensors]}"

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(leader, "step", lead)
        patch.setattr(follower, "step", follow)
        patch.setattr(ModelSender, "_reason", reason)
        patch.setattr(ModelSender, "_errors_of", lambda *_: ())
        yield


def read_given(output: bytes, log: Log) -> list[tuple[Any, ...]]:
    """What the program gave in each tick, in the form of `Log.given`."""
    at, result = 0, []

    def record(layout: np.dtype[Any]) -> str:
        nonlocal at
        one = np.frombuffer(output, layout, 1, at)[0]
        at += layout.itemsize
        return plain(one[name] for name in layout.names or ())

    def message(kind: type[Message]) -> str | None:
        nonlocal at
        (size,) = struct.unpack_from("<I", output, at)
        content = output[at + 4 : at + 4 + size]
        at += 4 + size
        return fields(msgspec.msgpack.decode(content, type=kind)) if size else None

    for given in log.given:
        if len(given) == 2:
            result.append((record(SHOWN), message(Command)))
        else:
            result.append((record(SHOWN_FOLLOWER), message(ModelUpdate), message(Telemetry)))
    return result


def differing(one: list[tuple[Any, ...]], other: list[tuple[Any, ...]]) -> int:
    """How many ticks differ."""
    assert len(one) == len(other)
    return sum(a != b for a, b in zip(one, other, strict=True))


def logged(name: str, seconds: float) -> Log:
    log, settings = Log(), replace(SessionSettings(), **SESSIONS[name])
    warm_up_once(settings)  # which runs the steps, too
    with watched(log):
        simulate(settings, duration=seconds, say=lambda _: None)
    return log


def given_by(command: list[object], log: Log) -> list[tuple[Any, ...]]:
    done = subprocess.run(list(map(str, command)), input=bytes(log.taken), capture_output=True, check=False)
    assert done.returncode == 0, done.stderr.decode()[-2000:]
    return read_given(done.stdout, log)
