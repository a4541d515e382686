"""Prediction with a contact map: causal, from motion and models alone; and what it reaches on recordings."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from presses import press

from foretouch.comparison import SIMULATED, simulate, unforeseeable
from foretouch.comparison.combination import score_outside
from foretouch.identification import (
    Learner,
    LearntModel,
    Motion,
    PredictedForce,
    Status,
    make_estimator,
    predict,
    predict_motion,
)
from foretouch.models import ContactMapModel, Predictor
from foretouch.quantities import Recording
from foretouch.recordings import list_datasets, read_recording
from foretouch.report import Scores, lowest_mean
from foretouch.report.forces import Forces, forces_under_delay

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
DELAY = 0.3


def learner(recording: Recording, force_offset: float | None = None) -> Learner:
    estimator = make_estimator("contact-map", "bank")
    return Learner(estimator, force_offset=force_offset, contact_floor=recording.contact_floor)


# --- from motion and models alone -------------------------------------------------------------------------------------


def changed(recording: Recording, *, force_from: float = math.inf, position_from: float = math.inf) -> Recording:
    """The same up to these times, then other forces and another motion."""
    force, position = recording.force.copy(), recording.position.copy()
    force[recording.time > force_from] = 9.0
    position[recording.time > position_from] = 0.05
    return Recording(recording.time, position, force)


@cache
def predicted_whole(delay: float) -> PredictedForce:
    recording = press(duration=3.0, noise=0.01)
    return predict(recording, learner(recording), delay=delay)


@settings(max_examples=6)
@given(st.sampled_from([0.0, 0.3, 1.0]), st.floats(1.2, 2.8))
def test_the_future_is_not_used(delay: float, now: float) -> None:
    recording, whole = press(duration=3.0, noise=0.01), predicted_whole(delay)
    other = changed(recording, force_from=now - delay + 1e-9, position_from=now)
    past = recording.time <= now
    cut = predict(other, learner(other), delay=delay)
    for column in ("force", "standard_deviation", "jump"):
        np.testing.assert_array_equal(getattr(cut, column)[past], getattr(whole, column)[past])


def test_the_newest_force_allowed_is_used() -> None:
    """The other side of causality: a sample is learnt from every 4 ms, and then it does change the prediction."""
    recording, now = press(duration=4.0, noise=0.01), 2.5
    whole, other = (
        predict(each, learner(each), delay=DELAY).force
        for each in (recording, changed(recording, force_from=now - DELAY - 0.0051))
    )
    index = int(np.searchsorted(recording.time, now))
    assert whole[index] > 0.5
    assert other[index] != whole[index]


def published(recording: Recording, until: float) -> list[tuple[int, LearntModel]]:
    """Every twentieth model up to a time, with the number of the sample that it belongs to."""
    result, source = [], learner(recording)
    columns = (recording.time.tolist(), recording.position.tolist(), recording.force.tolist())
    for tick, row in enumerate(zip(*columns, strict=True), start=1):
        if row[0] > until:
            break
        source.update(*row)
        if tick % 20 == 0:
            result.append((tick, source.learnt()))
    return result


def led(time: Array, position: Array, models: list[tuple[int, LearntModel]], late: int) -> Array:
    """What a leader predicts whose models arrive so many samples late: nothing else goes in."""
    predictor, arriving, forces = Predictor(), dict(models), np.empty(time.size)
    for index, (now, place) in enumerate(zip(time.tolist(), position.tolist(), strict=True)):
        tick = index + 1 - late
        if tick in arriving:
            learnt = arriving[tick]
            predictor.adopt(learnt.model, learnt.surface, learnt.state, tick)
        forces[index] = predictor.update(now, place)
    return forces


def test_forces_felt_after_the_last_model_change_nothing() -> None:
    recording = press(duration=5.0, noise=0.01)
    shouting = changed(recording, force_from=3.0)
    models, others = published(recording, 3.0), published(shouting, 3.0)
    assert [(tick, model.model) for tick, model in models] == [(tick, model.model) for tick, model in others]
    forces = led(recording.time, recording.position, models, 300)
    np.testing.assert_array_equal(forces, led(recording.time, recording.position, others, 300))
    assert forces[recording.time > 3.4].max() > 1.0
    for each in (recording, shouting):  # the same through the function that sessions are replayed with
        numbers = np.array([tick for tick, _ in models])
        motion = Motion(each.time, each.position, numbers - 1, each.time[numbers - 1] + 0.3, numbers)
        np.testing.assert_array_equal(predict_motion(each, learner(each), motion).force, forces)


def test_out_of_contact_nothing_of_the_delayed_force_is_felt() -> None:
    """The hand is in free air while the force that arrives is that of a press."""
    recording = press(duration=5.0, noise=0.01)
    away = recording.position.copy()
    away[recording.time > 3.5] = -0.05
    forces = led(recording.time, away, published(recording, 5.0), 300)
    assert forces[recording.time <= 3.5].max() > 1.0
    assert not forces[recording.time > 3.52].any()


# --- what it reaches --------------------------------------------------------------------------------------------------


@dataclass
class Reached:
    """A recording learnt and predicted once."""

    forces: Forces
    scores: Scores
    changes: int
    truth: Array
    judged: Flags

    def held(self) -> Array:
        """Errors of the judged samples, in standard deviations."""
        error = np.abs(self.forces.predicted - self.truth)[self.judged]
        deviation = self.forces.standard_deviation
        assert deviation is not None
        return error / np.maximum(deviation[self.judged], 1e-12)


MEASURED = {dataset.name: dataset.kind for dataset in list_datasets() if dataset.seen}
FOAM = [name for name, kind in MEASURED.items() if kind == "foam"]
SPRINGS = [name for name, kind in MEASURED.items() if kind == "spring"]
RIGID = [name for name, kind in MEASURED.items() if kind == "rigid"]
SKIN = [name for name, kind in MEASURED.items() if kind == "skin"]


HELD_OUT = (101, 102)
"""Seeds that nothing was chosen on."""


def missed(names: Iterable[str], reasons: dict[str, str], later: Iterable[str] = ()) -> list[Any]:
    """Parameters of a test, those that do not reach the mark yet with what they reach, and those that take long."""
    marks = {name: [pytest.mark.xfail(reason=reason)] for name, reason in reasons.items()}
    return [pytest.param(name, marks=[*marks.get(name, []), *([pytest.mark.long] * (name in later))]) for name in names]


@pytest.fixture(scope="module")
def reached(measured: Callable[[str], Path]) -> Callable[[str], Reached]:
    done: dict[str, Reached] = {}

    def of(name: str) -> Reached:
        if name not in done:
            done[name] = _measured(read_recording(measured(name)), MEASURED[name])
        return done[name]

    return of


def _measured(recording: Recording, kind: str) -> Reached:
    delay, score_from, score_to = (0.02, 0.5, 1.6) if kind == "skin" else (DELAY, 1.5, None)
    # The springs never leave contact. The zero that the scoring takes is the lowest mean of the whole file, which comes
    # near its end: nobody can know it before, so it is given. Without it the error is that of an offset that moves.
    offset = lowest_mean(recording.time, recording.force) if kind == "spring" else None
    source = learner(recording, offset)
    forces = forces_under_delay(recording, source, delay)
    scores = score_outside(forces, None, score_from=score_from, score_to=score_to)
    judged = scores.in_contact & (recording.time >= recording.time[0] + score_from)
    return Reached(forces, scores, source.estimator.changes, scores.measured_force, judged)


def _simulated(name: str, seed: int) -> Reached:
    made = simulate(name, seed=seed)
    recording, truth = made.recording, made.truth
    source = learner(recording)
    forces = forces_under_delay(recording, source, DELAY)
    hidden = unforeseeable(recording.time, truth.depth, DELAY, truth.changes)
    scores = score_outside(forces, hidden, score_from=3.0)
    judged = ~hidden & (recording.time >= 3.0) & (truth.force > recording.contact_floor)
    return Reached(forces, scores, source.estimator.changes, truth.force, judged)


def percent(found: Reached) -> float:
    assert found.scores.prediction_error_percent is not None
    return found.scores.prediction_error_percent


def better_than_late(found: Reached) -> bool:
    late = found.scores.delayed_force_error_percent
    assert late is not None
    return percent(found) <= late + 1.0


@pytest.mark.parametrize("name", FOAM)
@pytest.mark.first
def test_measured_foam(reached: Callable[[str], Reached], name: str) -> None:
    result = reached(name)
    assert percent(result) < 14.0
    assert better_than_late(result)
    assert result.changes == 0
    assert np.isfinite(result.forces.predicted).all()


@pytest.mark.long
def test_the_median_of_measured_foam(reached: Callable[[str], Reached]) -> None:
    assert np.median([percent(reached(name)) for name in FOAM]) < 8.5


@pytest.mark.parametrize("name", SPRINGS)
def test_measured_springs(reached: Callable[[str], Reached], name: str) -> None:
    assert percent(reached(name)) < 3.0
    assert reached(name).changes == 0


@pytest.mark.parametrize("name", RIGID)
def test_measured_rigid(reached: Callable[[str], Reached], name: str) -> None:
    assert percent(reached(name)) < 16.0
    assert better_than_late(reached(name))
    assert reached(name).changes == 0


@pytest.mark.parametrize("name", [name for name, kind in MEASURED.items() if kind == "free"])
def test_free_motion_gives_no_force(reached: Callable[[str], Reached], name: str) -> None:
    result = reached(name)
    assert result.scores.status == "no_contact"
    assert result.changes == 0
    assert result.forces.predicted.max() < 0.3


@pytest.mark.parametrize(
    "name",
    missed(SKIN, dict.fromkeys(SKIN[:1], "17 %, where half of the delay's error is 9: one press")),
)
def test_measured_skin(reached: Callable[[str], Reached], name: str) -> None:
    result = reached(name)
    late = result.scores.delayed_force_error_percent
    assert late is not None
    assert percent(result) < 0.5 * late
    assert result.changes == 0


@pytest.mark.parametrize("name", [name for name, kind in MEASURED.items() if kind != "free"])
def test_measured_messages_are_small(measured: Callable[[str], Path], name: str) -> None:
    """At fifty a second, 50 kB/s are 1000 bytes; all but the map are less than 200."""
    recording = read_recording(measured(name))
    models = [learnt.model for _, learnt in published(recording, 1e9)]
    sizes = [len(model.map) for model in models if isinstance(model, ContactMapModel)]
    assert len(sizes) > 10
    assert max(sizes) < 800


@pytest.fixture(scope="module")
def simulated() -> Callable[[str, int], Reached]:
    done: dict[tuple[str, int], Reached] = {}

    def of(name: str, seed: int) -> Reached:
        if (name, seed) not in done:
            done[name, seed] = _simulated(name, seed)
        return done[name, seed]

    return of


def most(name: str) -> float:
    """What a simulated recording may be wrong by [%]; a hand has bone in it."""
    return 12.0 if name == "hand" else 6.0


LATER = ("continuous-switching", "foam", "gradual-change", "hand", "kelvin-voigt", "sponge")
"""Simulated recordings that `make test` leaves out: laws that are learnt as the others are."""

MISSED = {"foam": "6.1 %", "gradual-change": "6.4 %", "kelvin-voigt": "10.8 %"}


@pytest.mark.parametrize("name", missed(SIMULATED, MISSED, later=LATER))
@pytest.mark.first
def test_simulated(simulated: Callable[[str, int], Reached], name: str) -> None:
    assert percent(simulated(name, 0)) < most(name)


@pytest.mark.parametrize(
    "name",
    missed(
        SIMULATED,
        {
            "kelvin-voigt": "9.5 %: late to prefer the law, which jumps at contact, so that one early press is wrong",
            "foam": "8.4 %",
        },
        later=set(SIMULATED) - {"hunt-crossley"},
    ),
)
@pytest.mark.first
def test_simulated_presses_held_out(simulated: Callable[[str, int], Reached], name: str) -> None:
    assert np.mean([percent(simulated(name, seed)) for seed in HELD_OUT]) < most(name)


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.long) for seed in HELD_OUT)])
@pytest.mark.parametrize("name", missed(SIMULATED, {}, later=LATER))
@pytest.mark.first
def test_simulated_is_sound(simulated: Callable[[str, int], Reached], name: str, seed: int) -> None:
    result = simulated(name, seed)
    assert better_than_late(result)
    # One that changes slowly may be said to have changed once, when the late predictions have become wrong.
    assert result.changes in {"sudden-change": (2,), "gradual-change": (0, 1)}.get(name, (0,))
    assert np.isfinite(result.forces.predicted).all()


def test_sudden_changes_are_said_when_they_are_felt() -> None:
    """Always in contact, so they are felt at once."""
    made = simulate("sudden-change")
    recording, source = made.recording, learner(made.recording)
    output = []
    for row in zip(recording.time.tolist(), recording.position.tolist(), recording.force.tolist(), strict=True):
        source.update(*row)
        if source.status is Status.CHANGED:
            output.append(row[0])
            assert source.learnt().reason == Status.CHANGED.value or source.learnt().model is None
    assert source.estimator.changes == len(output) == 2
    for moment, change in zip(output, made.truth.changes, strict=True):
        assert 0.0 < moment - change < 0.2


# --- uncertainty
# ------------------------------------------------------------------------------------------------------------


def test_uncertainty_on_measured_foam_is_honest(reached: Callable[[str], Reached]) -> None:
    held = np.concatenate([reached(name).held() for name in FOAM])
    assert 0.55 < np.mean(held <= 1.0) < 0.85
    assert 0.85 < np.mean(held <= 2.0) < 0.995


@pytest.mark.long
def test_uncertainty_on_presses_held_out_is_honest(simulated: Callable[[str, int], Reached]) -> None:
    held = np.concatenate([simulated(name, seed).held() for name in SIMULATED for seed in HELD_OUT])
    assert 0.55 < np.mean(held <= 1.0) < 0.9  # wider than honest, which is the safe side
    assert 0.85 < np.mean(held <= 2.0) < 0.995
