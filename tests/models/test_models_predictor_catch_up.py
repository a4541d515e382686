"""A predictor whose models come with a state of the past: it ends where one ends that had the model all along."""

from __future__ import annotations

import inspect
import math

import numpy as np
import pytest
from example_maps import example_map
from hypothesis import given, settings
from hypothesis import strategies as st

from foretouch.models import ContactMapModel, HuntCrossley, Predictor
from foretouch.models.contact_map.layout import MEMORY
from foretouch.models.predictor import HISTORY, SLICE, STATE_TOLERANCE

SURFACE = 0.012
MAP = example_map((0.0, 1.0, 0.0))
OTHER = example_map((0.2, 0.8, 0.0), seed=5)


class Course:
    """A motion in and out of contact, at uneven times, and predictors that are led along it."""

    def __init__(self, samples: int, seed: int = 0) -> None:
        random = np.random.default_rng(seed)
        self.time = np.cumsum(random.uniform(0.5e-3, 1.5e-3, samples))
        self.position = SURFACE + 4e-3 * np.sin(7.0 * self.time + random.uniform(0.0, 6.0)) + 2e-3

    def lead(self, predictor: Predictor, first: int, last: int) -> np.ndarray:
        """Forces of the samples with the numbers first + 1 to last."""
        columns = zip(self.time[first:last].tolist(), self.position[first:last].tolist(), strict=True)
        return np.array([predictor.update(time, place) for time, place in columns])


def states_of(course: Course, model: ContactMapModel, samples: int) -> list[tuple[float, ...]]:
    """What the material remembers after each sample, from the first one with a period on; the first is empty."""
    periods = np.diff(course.time, prepend=course.time[0])
    state, result = (), [(), ()]
    for depth, period in zip((course.position - SURFACE)[1:samples], periods[1:samples], strict=True):
        state = model.remember(state, np.array([depth]), np.array([period]))
        result.append(state)
    return result


@settings(max_examples=10)
@given(st.integers(400, 900), st.integers(2, 390), st.integers(0, 5))
def test_a_late_model_ends_as_one_that_was_always_there(now: int, late: int, seed: int) -> None:
    course = Course(1000, seed)
    always, newcomer = Predictor(), Predictor()
    always.adopt(MAP, SURFACE)
    course.lead(always, 0, now)
    course.lead(newcomer, 0, now)
    newcomer.adopt(MAP, SURFACE, states_of(course, MAP, now)[now - late], now - late)
    forces = course.lead(newcomer, now, 1000)
    np.testing.assert_array_equal(forces, course.lead(always, now, 1000))
    assert forces.max() > 0.5
    assert newcomer.standard_deviation == always.standard_deviation


def test_a_state_of_now_is_taken_as_it_is() -> None:
    course = Course(600)
    always, newcomer = Predictor(), Predictor()
    always.adopt(MAP, SURFACE)
    course.lead(always, 0, 300)
    course.lead(newcomer, 0, 300)
    newcomer.adopt(MAP, SURFACE, states_of(course, MAP, 300)[300])
    np.testing.assert_array_equal(course.lead(newcomer, 300, 600), course.lead(always, 300, 600))


def test_a_long_past_is_caught_up_with_in_slices_while_the_former_model_predicts() -> None:
    samples, behind = 5000, 3 * SLICE + 500
    now = 4500
    course = Course(samples)
    former, always, newcomer = Predictor(), Predictor(), Predictor()
    law = HuntCrossley(2000.0, 300.0, 1.2)
    former.adopt(law, SURFACE)
    always.adopt(MAP, SURFACE)
    newcomer.adopt(law, SURFACE)
    for predictor in (former, always, newcomer):
        course.lead(predictor, 0, now)
    newcomer.adopt(MAP, SURFACE, states_of(course, MAP, now)[now - behind], now - behind)
    rest, lawful, mapped, jumps, models = [], [], [], [], []
    for tick in range(now, samples):
        rest.append(course.lead(newcomer, tick, tick + 1)[0])
        lawful.append(course.lead(former, tick, tick + 1)[0])
        mapped.append(course.lead(always, tick, tick + 1)[0])
        jumps.append(newcomer.jump)
        models.append(newcomer.model)
    ticks = models.index(MAP)
    assert ticks == math.ceil(behind / SLICE) - 2  # a slice when the model arrives, one before each of the next samples
    assert rest[:ticks] == lawful[:ticks]
    assert rest[ticks:] == mapped[ticks:]
    assert jumps[ticks] == pytest.approx(mapped[ticks] - lawful[ticks], abs=1e-12)
    assert abs(jumps[ticks]) > 1e-3
    assert np.flatnonzero(jumps).tolist() == [ticks]


def test_models_that_come_at_every_tick_do_not_keep_it_from_catching_up() -> None:
    samples, now, behind = 5000, 4500, 3 * SLICE + 500
    course = Course(samples)
    always, newcomer = Predictor(), Predictor()
    always.adopt(MAP, SURFACE)
    course.lead(always, 0, now)
    course.lead(newcomer, 0, now)
    states = states_of(course, MAP, samples - behind)
    equal = []
    for tick in range(now, now + 40):
        newcomer.adopt(MAP, SURFACE, states[tick - behind], tick - behind)
        equal.append(course.lead(newcomer, tick, tick + 1)[0] == course.lead(always, tick, tick + 1)[0])
    assert equal[4:] == [True] * 36
    assert newcomer.force > 0.05


def test_no_slice_is_longer_than_a_tick_can_bear() -> None:
    course, predictor, reached = Course(6000), Predictor(), [1000]
    course.lead(predictor, 0, 5500)
    predictor.adopt(MAP, SURFACE, (0.0,) * MEMORY, 1000)
    for tick in range(5500, 5510):
        reached.append(predictor.records["waiting"]["arrivals"]["tick"][0, 0].item())
        course.lead(predictor, tick, tick + 1)
    lengths = np.diff(reached)
    assert lengths[:4].tolist() == [SLICE] * 4
    assert predictor.model == MAP
    assert predictor.records["waiting"]["arrivals"]["waits"].tolist() == [[0, 0]]


@pytest.mark.parametrize(("share", "kept"), [(0.9, True), (-0.9, True), (1.1, False), (-1.1, False)])
@pytest.mark.parametrize("index", range(MEMORY))
def test_a_state_close_to_the_own_one_is_the_own_one(index: int, share: float, kept: bool) -> None:
    """The robot is never exactly where the operator was; only a state that is really another one is taken over."""
    course = Course(800)
    predictor, own = Predictor(), Predictor()
    for each in (predictor, own):
        each.adopt(MAP, SURFACE)
        course.lead(each, 0, 500)
    state = list(states_of(course, MAP, 500)[490])
    state[index] += share * STATE_TOLERANCE
    predictor.adopt(MAP, SURFACE, tuple(state), 490)
    assert (predictor.state == own.state) is (
        kept or index == MEMORY - 1 or (index < 2 and _pushed(course, index))  # whether it sticks, where it is says
    )
    if kept:
        np.testing.assert_array_equal(course.lead(predictor, 500, 800), course.lead(own, 500, 800))


def _pushed(course: Course, index: int) -> bool:
    """Whether a play forgets where it began: it was at an edge since."""
    states = states_of(course, MAP, 500)
    return states[500][index] != states[490][index]


def test_a_new_model_that_agrees_goes_on_from_the_own_state() -> None:
    course = Course(900)
    predictor, always = Predictor(), Predictor()
    predictor.adopt(MAP, SURFACE)
    always.adopt(OTHER, SURFACE)
    course.lead(predictor, 0, 600)
    course.lead(always, 0, 600)
    predictor.adopt(OTHER, SURFACE, tuple(value + 1e-5 for value in states_of(course, MAP, 600)[400]), 400)
    np.testing.assert_array_equal(course.lead(predictor, 600, 900), course.lead(always, 600, 900))


def test_of_a_past_beyond_what_is_remembered_the_rest_is_run() -> None:
    """The averages have long forgotten where they began, so the start does not show."""
    samples = HISTORY + 1500
    course = Course(samples + 20)
    always, newcomer = Predictor(), Predictor()
    always.adopt(MAP, SURFACE)
    course.lead(always, 0, samples)
    course.lead(newcomer, 0, samples)
    newcomer.adopt(MAP, SURFACE, (1e-3,) * MEMORY, 10)
    expected, result = course.lead(always, samples, samples + 20), course.lead(newcomer, samples, samples + 20)
    needed = math.ceil((HISTORY - 1) / SLICE) - 2
    assert not result[:needed].any()  # no former model
    np.testing.assert_allclose(result[needed:], expected[needed:], rtol=0.05, atol=1e-3)
    assert expected.max() > 0.1


def test_a_sample_that_has_not_come_yet_counts_as_the_newest() -> None:
    course = Course(400)
    known, ahead = Predictor(), Predictor()
    for predictor, tick in ((known, 200), (ahead, 10_000)):
        course.lead(predictor, 0, 200)
        predictor.adopt(MAP, SURFACE, (2e-3,) * MEMORY, tick)
    np.testing.assert_array_equal(course.lead(ahead, 200, 400), course.lead(known, 200, 400))


def test_a_state_from_before_the_first_sample_is_run_from_there() -> None:
    """The first sample has no period: it moves the plays, and no time has passed."""
    course, predictor, other = Course(1000), Predictor(), Predictor()
    for each in (predictor, other):
        course.lead(each, 0, 300)
    state = (2e-3,) * MEMORY
    predictor.adopt(MAP, SURFACE, state, 0)
    periods = np.diff(course.time[:300], prepend=course.time[0])
    other.adopt(MAP, SURFACE, MAP.remember(state, course.position[:300] - SURFACE, periods))
    forces = course.lead(predictor, 300, 1000)
    np.testing.assert_array_equal(forces, course.lead(other, 300, 1000))
    assert 0.5 < forces.max() < 10.0


@settings(max_examples=8)
@given(st.integers(100, 400), st.integers(0, 90), st.integers(0, 9))
def test_the_jump_is_the_difference_at_that_sample_and_counted_once(now: int, late: int, seed: int) -> None:
    course = Course(1400, seed)
    kept, changed = Predictor(), Predictor()
    for predictor in (kept, changed):
        predictor.adopt(MAP, SURFACE)
        course.lead(predictor, 0, now)
    state = tuple(value + 1e-3 for value in states_of(course, MAP, now)[now - late])
    changed.adopt(OTHER, SURFACE - 1e-3, state, now - late)
    jumps, differences = [], []  # over a whole press at least
    for tick in range(now, 1400):
        after, before = course.lead(changed, tick, tick + 1), course.lead(kept, tick, tick + 1)
        jumps.append(changed.jump)
        differences.append(after[0] - before[0])
    assert jumps[0] == pytest.approx(differences[0], abs=1e-12)
    assert not np.any(jumps[1:])
    assert np.any(differences)


def test_the_same_model_again_makes_no_jump() -> None:
    course, predictor = Course(400), Predictor()
    predictor.adopt(MAP, SURFACE)
    course.lead(predictor, 0, 300)
    states = states_of(course, MAP, 300)
    for tick in range(300, 400):
        predictor.adopt(example_map((0.0, 1.0, 0.0)), SURFACE, states[200], 200)
        course.lead(predictor, tick, tick + 1)
        assert predictor.jump == 0.0


def test_a_predictor_is_never_told_a_force() -> None:
    """What goes in: time and motion, models and their states. A force could only come out late if it went in."""
    assert list(inspect.signature(Predictor.update).parameters) == ["self", "time", "position", "velocity"]
    assert list(inspect.signature(Predictor.adopt).parameters) == [
        "self",
        "model",
        "surface",
        "state",
        "tick",
        "message",
    ]
    public = {name for name in dir(Predictor) if not name.startswith("_") and callable(getattr(Predictor, name))}
    methods = {"update", "adopt", "catch_up", "shift", "change_place", "local_slopes", "leaving_work", "disown"}
    assert public == methods
