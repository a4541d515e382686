"""Everything compiled, before a loop begins that has no time for it."""

from __future__ import annotations

from foretouch.identification import Learner
from foretouch.models import ContactMap, make_model
from foretouch.session import leader
from foretouch.session.settings import SAMPLE_PERIOD, SessionSettings

__all__ = ["warm_up"]

TICKS = 500
DEPTH, STIFFNESS, SURFACE = 2e-3, 500.0, 0.01
"""Of a press [m, N/m, m] that exists nowhere else."""


def warm_up(settings: SessionSettings) -> None:
    """Learn a press that is thrown away, and render from what was learnt: compiled code is loaded, or made.

    Args:
        settings: Of the session that is to begin.
    """
    if settings.scene:
        from foretouch.session.spatial.warm_up import warm_up_scene

        warm_up_scene(settings)
    learner = Learner(settings.make_estimator(), surface=SURFACE, force_offset=0.0)
    renderer = leader.start(settings).renderer
    renderer.engage(0.0, SURFACE - DEPTH)
    for tick in range(TICKS):
        depth = DEPTH * (2.0 * tick / TICKS - 1.0)
        time, position = tick * SAMPLE_PERIOD, SURFACE + depth
        learner.update(time, position, STIFFNESS * max(depth, 0.0))
        if tick % 20 == 19:
            learnt = learner.learnt()
            if learnt.model is not None:
                content = learnt.model.map if isinstance(learnt.model, ContactMap) else b""
                model = make_model(learnt.model.law, learnt.model.parameters, content)
                renderer.adopt(model, learnt.surface, learnt.state, tick // 2, message=tick)
        renderer.update(time, (depth + DEPTH) / settings.position_scale, SAMPLE_PERIOD)
