"""Sessions made from messages, with every number known: what the tests of the report look at."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import msgspec
import numpy as np

from foretouch.messages import VERSION, LeaderState, ModelUpdate, SessionLog, Telemetry
from foretouch.models import MotionFilter, Predictor, make_model

MATERIAL = make_model("hunt-crossley", (3000.0, 1500.0, 1.4))
POSITION_DELAY = 80
FORCE_DELAY = 300
TICK = 1_000_000


def hand(tick: int) -> float:
    """Two presses a second, 15 mm deep, from 5 mm above the surface [m]."""
    return -0.005 + 0.010 * (1.0 - np.cos(2 * np.pi * 2.0 * tick * 1e-3))


@cache
def make_session(
    duration: float = 4.0,
    *,
    stiffness: float = 1.0,
    offset: float = 1.3,
    noise: float = 0.0,
    lag: int = 0,
    limit: float = 1e9,
    touching: bool = True,
    valid: bool = True,
    exact: bool = True,
    models: bool = True,
    seed: int = 0,
) -> SessionLog:
    """A session on a Hunt-Crossley material whose models are right but for a factor; made once, and not to be changed.

    Offset and noise are the sensor's [N], the lag is the robot's [ticks], the limit that of the rendered force [N];
    one that is not touching has its surface out of reach.
    """
    rng = np.random.default_rng(seed)
    ticks = round(duration * 1000)
    surface = 0.0 if touching else 0.5
    feel = Predictor()
    feel.adopt(MATERIAL, surface)
    velocity = MotionFilter()
    leader, follower, sent = [], [], []
    start = 5_000_000_000  # the follower's clock is another one
    for tick in range(1, ticks + 1):
        command = max(0, tick - POSITION_DELAY)
        position = hand(max(1, command - lag))
        force = feel.update(tick * 1e-3, position)
        measured = force + rng.normal(0.0, noise)
        if models and tick % 20 == 0:
            numbers = (stiffness * MATERIAL.stiffness, stiffness * MATERIAL.damping, MATERIAL.exponent)
            law = (MATERIAL.law, numbers, (), surface, valid, "", "none", b"")
            sent.append(ModelUpdate(VERSION, len(sent) + 1, start + tick * TICK, command, *law))
        motion = (position, position, velocity.update(tick * 1e-3, position))
        forces = (measured + offset, measured, force if exact else float("nan"), force > 0.0, False)
        spent = (TICK if tick > 1 else 0, 180_000 + 1000 * (tick % 50))
        follower.append(Telemetry(VERSION, tick, start + tick * TICK, command, *motion, *forces, len(sent), *spent))
    render = Predictor()
    newest = 0
    for tick in range(1, ticks + 1):
        arrived = sum(model.time_ns <= start + (tick - FORCE_DELAY) * TICK for model in sent[newest : newest + 2])
        if arrived:
            newest += arrived
            update = sent[newest - 1]
            render.adopt(make_model(update.law, update.parameters) if update.valid else None, update.surface)
        predicted = render.update(tick * 1e-3, hand(tick))
        known = follower[tick - FORCE_DELAY - 1].force if tick > FORCE_DELAY else 0.0
        forces = (predicted, min(predicted, limit), known)
        model = (max(0, tick - FORCE_DELAY), newest, render.jump, predicted > limit)
        spent = (TICK if tick > 1 else 0, 120_000 + 1000 * (tick % 70))
        moment = (77_000_000 + tick * TICK, hand(tick), render.velocity)
        leader.append(LeaderState(VERSION, tick, *moment, *forces, *model, *spent))
    settings = {"material": "hunt-crossley", "operator": "scripted", "model": "continuous-switching"}
    settings |= {"position_delay": "0.08", "force_delay": "0.3"}
    log = SessionLog.from_messages([*leader, *follower, *sent], settings, {"leader_lost": 2, "follower_lost": 3})
    log.leader.flags.writeable = log.follower.flags.writeable = False
    return log


def repeated(log: SessionLog, times: int) -> SessionLog:
    """The same session repeated on end, as one of the same two processes."""
    ticks, models = int(log.leader["sequence"][-1]), len(log.models)
    nth = np.repeat(np.arange(times), log.leader.size)
    sides = []
    for rows, counted in (
        (log.leader, {"sequence": ticks, "telemetry_sequence": ticks, "model_sequence": models}),
        (log.follower, {"sequence": ticks, "command_sequence": ticks, "models_sent": models}),
    ):
        tiled = np.tile(rows, times)
        for name, step in {**counted, "time_ns": ticks * TICK}.items():
            if name in tiled.dtype.names:
                tiled[name] += nth * step
        sides.append(tiled)
    sent = tuple(later(model, turn * models, turn * ticks) for turn in range(times) for model in log.models)
    return replace(log, leader=sides[0], follower=sides[1], models=sent)


def later(model: ModelUpdate, models: int, ticks: int) -> ModelUpdate:
    """The same model, sent a number of models and ticks later."""
    return msgspec.structs.replace(
        model,
        sequence=model.sequence + models,
        time_ns=model.time_ns + ticks * TICK,
        command_sequence=model.command_sequence + ticks,
    )
