"""The models of the last seconds: the law's numbers, and how stiff the material is at one depth."""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from foretouch.console.history import NAN, Array
from foretouch.errors import InputError
from foretouch.messages import ModelUpdate
from foretouch.models import ContactModel, force_at_rest, make_model

STEP = 0.1  # Half the distance over which a local stiffness is taken, as a fraction of the depth
MOST, SPACING = 512, 0.1
"""Models whose figures are remembered, and the time between two that are drawn [s]."""


class ModelFigures(NamedTuple):
    """The law's parameters with their standard errors, NaN where not known, and the local stiffness at rest [N/m].

    Its standard deviation [N/m] is NaN where the model carries no uncertainty.
    """

    names: tuple[str, ...]
    parameters: tuple[float, ...]
    errors: tuple[float, ...]
    stiffness: float
    deviation: float


class ModelTrace(NamedTuple):
    """Models over time [s before now], shape (n,), as `ModelFigures`; parameters are NaN under another law."""

    time: Array
    stiffness: Array
    deviation: Array
    names: tuple[str, ...]
    parameters: Array
    errors: Array


def model_of(update: ModelUpdate) -> ContactModel | None:
    """The model of an update; None of one that cannot be run."""
    if not update.valid:
        return None
    try:
        return make_model(update.law, update.parameters, update.map)
    except InputError:
        return None


def figures_of(update: ModelUpdate, depth: float) -> ModelFigures | None:
    r"""The numbers of one model; None of one that cannot be run.

    .. math:: K = \frac{F(x + h) - F(x - h)}{2 h}, \quad \sigma_K = |K| \frac{\sigma_F(x)}{F(x)}

    with the probe at rest (`foretouch.models.force_at_rest`), h a tenth of x. The model's uncertainty is that of the
    force; that of the stiffness is taken in the same proportion, as if all forces were too large or too small by one
    factor. The depth x is below the model's surface [m].
    """
    model = model_of(update)
    if model is None:
        return None
    step = STEP * depth
    (force, uncertainty), (more, _), (less, _) = (force_at_rest(model, x) for x in (depth, depth + step, depth - step))
    stiffness = (more - less) / (2.0 * step)
    deviation = abs(stiffness) * uncertainty / force if force > 0.0 else NAN
    parameters, errors = model.parameters, update.standard_errors
    known = errors if len(errors) == len(parameters) else (NAN,) * len(parameters)
    return ModelFigures(model.parameter_names, parameters, known, stiffness, deviation)


class ModelsSeen:
    """The models of a session, the newest `most` of them: stored in a step, read as a trace, by another thread."""

    def __init__(self, most: int | None = MOST) -> None:
        self._most = most
        self._adopted: deque[tuple[float, int]] = deque(maxlen=most)
        self._updates: dict[int, ModelUpdate] = {}
        self._figures: dict[tuple[int, float], ModelFigures | None] = {}
        self._newest = self._run = 0

    def add(self, update: ModelUpdate) -> None:
        """A model has arrived here."""
        if update.run != self._run:  # a process that began anew counts from 1 again
            self._run = update.run
            self._updates, self._figures = {}, {}
        self._updates[update.sequence] = update
        if self._most is not None and len(self._updates) > self._most:
            self._updates.pop(next(iter(self._updates)))

    def adopt(self, time: float, sequence: int) -> None:
        """Store which model is the leader's newest at a time [s]."""
        if sequence != self._newest:
            self._newest = sequence
            self._adopted.append((time, sequence))

    def trace(self, depth: float, seconds: float, now: float) -> ModelTrace:
        """The last seconds before a moment [s] at a depth [m]; those that the leader rendered from, by `SPACING`."""
        times: list[float] = []
        shown: list[ModelFigures] = []
        for time, sequence in tuple(self._adopted):
            if not now - seconds <= time <= now or (times and time - times[-1] < SPACING):
                continue
            key, update = (sequence, depth), self._updates.get(sequence)
            if key not in self._figures and update is not None:
                if len(self._figures) > MOST:
                    self._figures.clear()
                self._figures[key] = figures_of(update, depth)
            if (one := self._figures.get(key)) is not None:
                times.append(time)
                shown.append(one)
        names = shown[-1].names if shown else ()
        unknown = ((NAN,) * len(names),) * 2
        laws = [(one.parameters, one.errors) if one.names == names else unknown for one in shown]
        parameters, errors = np.array(laws).reshape(len(shown), 2, len(names)).transpose(1, 0, 2)
        stiffness, deviation = np.array([(one.stiffness, one.deviation) for one in shown]).reshape(-1, 2).T
        return ModelTrace(np.array(times) - now, stiffness, deviation, names, parameters, errors)
