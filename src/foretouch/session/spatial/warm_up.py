"""Everything compiled that a session in three dimensions runs, before its loops begin."""

from __future__ import annotations

from foretouch.messages import VERSION, Command, FieldUpdate, ModelUpdate
from foretouch.quantities.pose import Vector
from foretouch.robot import RobotSpecification, SpatialSample
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings
from foretouch.session.spatial import follower, leader
from foretouch.session.spatial.scenes import make_scene

TICKS = 700
STIFFNESS, FRICTION = 400.0, 0.3
START, DEPTH, SLIDE = 0.002, 0.004, 0.01
"""A press and slide that exist nowhere else [m]."""

SPECIFICATION = RobotSpecification(SAMPLE_PERIOD, 15.0, 0.0, 0.0, 0.0, 0.0, 0.02, 0.0, 200.0, (-1.0, 1.0))


def warm_up_scene(settings: SessionSettings) -> None:
    """Press and slide once with both steps, and throw away what was learnt: compiled code is loaded, or made.

    Args:
        settings: Of the session that is to begin.
    """
    scene = make_scene(settings.scene)
    follows = follower.start(SPECIFICATION, settings, scene.surface, scene.nominal)
    leads = leader.start(settings, scene.surface, scene.nominal)
    models: list[ModelUpdate] = []
    fields: list[FieldUpdate] = []
    for tick in range(TICKS):
        now_ns = round(tick * SAMPLE_PERIOD * 1e9)
        place = _place(tick)
        pressed = max(-place[2], 0.0) * STIFFNESS
        rub = -FRICTION * pressed if place[0] > 0.0 else 0.0
        force = (rub, 0.0, pressed)
        command = Command(VERSION, tick + 1, now_ns, 0.0, 0, holder="warm-up", epoch=1, place=place)
        sample = SpatialSample(place, force, force, place, (), False)
        _, acted = follower.step(follows, follower.Inputs([command], sample, 1_000_000, 0, []), now_ns)
        models = [] if acted.model is None else [acted.model]
        fields = [] if acted.field is None else [acted.field]
        told = leader.Inputs(place, models, [acted.telemetry], [acted.space], fields, 1_000_000, 0)
        leader.step(leads, told, now_ns)


def _place(tick: int) -> Vector:
    """Down, then along."""
    down = min(tick / (0.5 * TICKS), 1.0)
    along = max(tick / (0.5 * TICKS) - 1.0, 0.0)
    return SLIDE * along, 0.0, START - (START + DEPTH) * down
