"""A model whose long catch-up is overtaken by newer models comes into force all the same."""

from __future__ import annotations

import math

import numpy as np
import pytest
from example_maps import example_map

from foretouch.models import ContactState, Predictor
from foretouch.models.contact_map.layout import MEMORY
from foretouch.models.predictor import HISTORY, SLICE

PERIOD = 1e-4
STATE: ContactState = (0.0,) * MEMORY


def place_at(tick: int) -> float:
    return 0.004 + 0.003 * math.sin(2.0 * math.pi * PERIOD * tick)


def moved(ticks: int) -> Predictor:
    """A predictor without a model after so many samples of motion."""
    predictor = Predictor()
    for tick in range(1, ticks + 1):
        predictor.update(PERIOD * tick, place_at(tick))
    return predictor


@pytest.mark.parametrize("age", [SLICE // 2, 3 * SLICE, HISTORY + SLICE])
def test_models_that_come_with_every_sample_and_are_late_are_used(age: int) -> None:
    began = age + 50
    predictor = moved(began)
    forces = []
    for tick in range(began + 1, began + 61):
        predictor.adopt(example_map(), 0.0, STATE, tick - age)
        forces.append(predictor.update(PERIOD * tick, place_at(tick)))
    slices = math.ceil(min(age, HISTORY) / SLICE)
    assert not any(forces[: max(0, slices - 2)])  # a slice with the adoption, and one with each sample
    assert all(force > 0.1 for force in forces[slices + 1 :])


def test_of_those_that_wait_the_newest_is_next() -> None:
    age = 3 * SLICE
    predictor = moved(age + 1)
    first, second, third = (example_map(seed=seed) for seed in (1, 2, 3))
    for model in (first, second, third):
        predictor.adopt(model, 0.0, STATE, 1)
    used = []
    for tick in range(age + 2, age + 20):
        predictor.update(PERIOD * tick, place_at(tick))
        if predictor.model is not None and predictor.model not in used:
            used.append(predictor.model)
    assert used == [first, third]


def test_no_model_ends_all_waiting_at_once() -> None:
    age = 3 * SLICE
    predictor = moved(age + 1)
    for _ in range(2):
        predictor.adopt(example_map(), 0.0, STATE, 1)
    predictor.adopt(None, 0.0)
    forces = [predictor.update(PERIOD * tick, place_at(tick)) for tick in range(age + 2, age + 20)]
    assert not np.any(forces)
    assert predictor.model is None
