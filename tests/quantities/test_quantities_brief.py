"""Results show themselves in a few lines and can be compared, whatever arrays they hold."""

from __future__ import annotations

import copy
import dataclasses

import numpy as np
import pytest

import foretouch
from foretouch.comparison import Result, Results
from foretouch.identification import Identification
from foretouch.messages import SessionLog
from foretouch.quantities import Recording, brief_text
from foretouch.session import SimulatedSession

TIME = np.arange(900) * 1e-3
"""So short that NumPy itself would print every number."""


@pytest.fixture(scope="module")
def results() -> dict[str, object]:
    settings = foretouch.SessionSettings(material="hunt-crossley", seed=1, position_delay=0.02, force_delay=0.05)
    session = foretouch.simulate(settings, duration=1.5)
    depth = 0.01 * np.sin(2 * np.pi * 2.0 * TIME)
    recording = Recording(TIME, depth, 800.0 * np.maximum(depth, 0.0))
    learner = foretouch.Learner()
    simple = foretouch.Learner(foretouch.KelvinVoigtRLS())
    predicted = foretouch.predict(recording, simple, delay=0.1)
    result = foretouch.identify(recording, learner, keep_history=True)
    known = foretouch.delayed_force(recording.time, recording.force, 0.1)
    return {
        "settings": settings,
        "session": session,
        "log": session.log,
        "rows": session.log.rows(),
        "model": session.log.models[-1],
        "recording": recording,
        "identification": result,
        "map": result.model,
        "prediction": predicted,
        "scores": foretouch.score_prediction(
            TIME, recording.force, predicted.force, known, contact_floor=0.05, score_from=0.0
        ),
        "results": Results([Result(f"{n}.csv", "hunt-crossley", "rls", "ok") for n in range(50)]),
        "robot": foretouch.make_robot("hunt-crossley", seed=1),
        "learner": learner,
        "estimator": learner.estimator,
        "predictor": foretouch.Predictor(),
        "renderer": foretouch.Renderer(),
    }


def test_whatever_is_public_shows_itself_in_ten_lines(results: dict[str, object]) -> None:
    for name, result in results.items():
        lines = repr(result).splitlines()
        assert len(lines) <= 10, name
        assert max(map(len, lines)) <= 130, name
    assert repr(results["log"]).startswith("SessionLog(leader=<1,500 rows of ")
    assert repr(results["recording"]) == ("Recording(time=<900 float64>, position=<900 float64>, force=<900 float64>)")
    chosen = "material='foam-measured', model='contact-map', estimator='bank'"
    delays = "position_delay=0.08, force_delay=0.3"
    assert " ".join(repr(foretouch.SessionSettings()).split()) == f"SessionSettings({chosen}, {delays})"
    assert "material='hunt-crossley'" in repr(results["settings"])
    assert eval(repr(results["settings"]), {"SessionSettings": foretouch.SessionSettings}) == results["settings"]


def test_what_learns_and_what_predicts_say_what_they_know() -> None:
    learner = foretouch.Learner(foretouch.KelvinVoigtRLS(), surface=0.0, force_offset=0.0)
    assert repr(learner.estimator) == "KelvinVoigtRLS(name='rls', law='kelvin-voigt', updates=0)"
    predictor, renderer = foretouch.Predictor(), foretouch.Renderer()
    assert repr(predictor) == "Predictor(law=None, ticks=0, surface=0.0, position=0.0, force=0.0)"
    for tick, depth in enumerate(0.01 * np.sin(2 * np.pi * 2.0 * TIME[:400])):
        learner.update(1e-3 * tick, depth, 800.0 * max(depth, 0.0))
    learnt = learner.learnt()
    predictor.adopt(learnt.model, learnt.surface)
    predictor.update(0.0, 0.0)
    predictor.update(0.001, 0.005)
    renderer.adopt(learnt.model, learnt.surface)
    assert "stiffness=800.0, damping=" in repr(learner.estimator)
    assert repr(learner).startswith("Learner(estimator=KelvinVoigtRLS(name='rls', law='kelvin-voigt', updates=")
    assert "surface=0.0, force_offset=0.0" in " ".join(repr(learner).split())
    assert repr(predictor).startswith("Predictor(law='kelvin-voigt', ticks=2, surface=0.0, position=0.005, force=")
    assert "closed_loop=False, share=1.0, force=0.0" in " ".join(repr(renderer).split())


def test_the_reason_beside_a_good_model_is_of_the_newest_sample_alone() -> None:
    learner = foretouch.Learner(foretouch.KelvinVoigtRLS(), surface=0.0, force_offset=0.0)
    for tick, depth in enumerate(0.01 * np.sin(2 * np.pi * 2.0 * TIME[:400])):
        learner.update(1e-3 * tick, depth, 800.0 * max(depth, 0.0))
    learnt = learner.learnt()
    assert learnt.model is not None
    assert learnt.reason == "newest sample was not in contact"


@pytest.mark.parametrize("name", ["log", "session", "rows", "recording", "identification", "prediction", "scores"])
def test_results_are_equal_if_all_their_values_are(results: dict[str, object], name: str) -> None:
    one = results[name]
    other = copy.deepcopy(one)
    assert other is not one
    assert other == one
    assert hash(other) == hash(one)
    assert one in {other}
    assert one != "something else"
    array = next(field.name for field in dataclasses.fields(one) if field.name in CHANGED)  # type: ignore[arg-type]
    assert one != dataclasses.replace(one, **{array: CHANGED[array](getattr(one, array))})  # type: ignore[type-var]


CHANGED = {
    "log": lambda log: dataclasses.replace(log, settings={}),
    "leader": lambda rows: rows[:-1],
    "force": lambda force: force + 1.0,
    "residual": lambda residual: residual[::-1],
    "measured_force": lambda force: force + 1.0,
}


def test_results_are_equal_whatever_the_computer_took() -> None:
    one = Result("a.csv", "hunt-crossley", "rls", "ok", us_per_sample=1.0)
    assert one == dataclasses.replace(one, us_per_sample=2.0)
    assert one != dataclasses.replace(one, status="no_contact")


def test_a_part_of_a_session_is_another_session(results: dict[str, object]) -> None:
    log = results["log"]
    assert isinstance(log, SessionLog)
    part = dataclasses.replace(log, leader=log.leader[:500])
    assert log == log.longest()
    assert log != part
    assert len({log, part, log.longest()}) == 2


def test_the_classes_are_those_of_the_interface(results: dict[str, object]) -> None:
    assert isinstance(results["session"], SimulatedSession)
    assert isinstance(results["identification"], Identification)


def test_a_text_ends_after_ten_lines() -> None:
    text = brief_text("Many", ((f"name_{number}", "x" * 90) for number in range(100)))
    assert len(text.splitlines()) == 10
    assert text.endswith("...)")
