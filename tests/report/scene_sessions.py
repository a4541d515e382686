"""Sessions in three dimensions made from columns, with every number known."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from foretouch.messages import (
    FOLLOWER_DTYPE,
    FOLLOWER_SPACE_DTYPE,
    LEADER_DTYPE,
    LEADER_SPACE_DTYPE,
    VERSION,
    FieldUpdate,
    ModelUpdate,
    SessionLog,
)
from foretouch.session.spatial import make_scene

TICK = 1_000_000
POSITION_DELAY = 80
NOMINAL = (-0.075, 0.0, 0.0, 0.0, 0.0, 0.0)
AXES = ("x", "y", "z", "rx", "ry", "rz")


def put(table: np.ndarray, name: str, values: Any) -> None:
    """Write vectors or poses, shape (n, 3) or (n, 6) or one for all, into the columns of that name."""
    values = np.broadcast_to(values, (table.size, np.shape(values)[-1]))
    for column, axis in enumerate(AXES[: values.shape[1]]):
        table[f"{name}_{axis}"] = values[:, column]


def make_scene_session(ticks: int = 4000, *, apart_ns: int = 0, scene: str = "plane", **settings: str) -> SessionLog:
    """A session in which nothing happens: each command is applied 80 ms later; everything can be written over."""
    leader, hand = np.zeros(ticks, LEADER_DTYPE), np.zeros(ticks, LEADER_SPACE_DTYPE)
    follower, probe = np.zeros(ticks, FOLLOWER_DTYPE), np.zeros(ticks, FOLLOWER_SPACE_DTYPE)
    number = np.arange(1, ticks + 1)
    for table, start in ((leader, 0), (hand, 0), (follower, apart_ns), (probe, apart_ns)):
        table["sequence"], table["time_ns"] = number, start + (number - 1) * TICK
    leader["epoch"] = leader["run"] = hand["epoch"] = 1
    follower["epoch"] = follower["run"] = probe["run"] = 1
    leader["engaged"], leader["period_ns"] = True, TICK
    follower["command_sequence"] = np.maximum(number - POSITION_DELAY, 0)
    for table, name in ((hand, "fixture"), (probe, "fixture"), (probe, "exact")):
        put(table, name, NOMINAL)
    put(hand, "hand", make_scene("plane").nominal[:3])
    for table in (hand, probe):
        put(table, "normal", (0.0, 0.0, 1.0))
    hand["stiffness"] = math.nan
    chosen = {"scene": scene, "material": "kelvin-voigt", "operator": "scripted", "position_delay": "0.08"}
    chosen |= {"grip": "none", "fusion": "full"} | settings
    return SessionLog(leader, follower, (), chosen, leader_space=hand, follower_space=probe)


def model(number: int, tick: int, *, surface: float = 0.0, friction: tuple[float, ...] = ()) -> ModelUpdate:
    """A valid model that is sent in a tick of the follower."""
    rest = ("kelvin-voigt", (6000.0, 0.0), (), surface, True, "", "rls", b"", 1, 1, NOMINAL, (1e-4,) * 6)
    return ModelUpdate(VERSION, number, tick * TICK, 1, *rest, 0.1, friction)


def field_update(nodes: bytes) -> FieldUpdate:
    return FieldUpdate(VERSION, 1, 0, nodes, 1)
