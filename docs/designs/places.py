"""Designs of a material over a surface: one law with a scale, as shipped, and those that lost."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np
from designs.rasters import DELAY, PERIOD, Raster
from numpy.typing import NDArray

from foretouch.identification import ContactMap, ContactSample, Learner, LearntModel, ScaleFieldLearner, Status
from foretouch.identification.scale_field_kernel import CORRELATION, FIRST_DEVIATION, FORCE_NOISE, LAW_ERROR
from foretouch.models import ScaleField, advance
from foretouch.models.scale_field_kernel import REACH, SPACING, SPREAD

Array = NDArray[np.float64]

EVERY = 100  # Ticks between two states of what was learnt, from which late forces are predicted


class Design(Protocol):
    """Anything that learns from a raster and predicts it late, from what was learnt a delay before."""

    def learn(self, raster: Raster, tick: int) -> None:
        """Take the next sample."""

    def predict(self, raster: Raster, ticks: range) -> Array:
        """The forces in these ticks, from what is known now and the motion until then [N]."""


def predicted(design: Design, raster: Raster) -> Array:
    """Every force from what was learnt a delay before [N]."""
    forces = np.zeros(raster.time.size)
    for tick in range(forces.size - DELAY - EVERY):
        design.learn(raster, tick)
        if tick % EVERY == EVERY - 1:
            late = range(tick + DELAY + 1, tick + DELAY + EVERY + 1)
            forces[late.start : late.stop] = design.predict(raster, late)
    return forces


def along(learnt: LearntModel, raster: Raster, ticks: range) -> Array:
    """Forces of a law on the motion, whose state is that of a delay before the first of these ticks [N]."""
    if learnt.model is None:
        return np.zeros(len(ticks))
    depth, before = raster.depth - learnt.surface, ticks.start - DELAY
    state = learnt.model.remember(learnt.state, depth[before : ticks.start], np.full(DELAY, PERIOD))
    forces = np.zeros(len(ticks))
    for number, tick in enumerate(ticks):
        state, forces[number], _ = advance(
            learnt.model, state, float(depth[tick]), float(raster.velocity[tick]), PERIOD
        )
    return forces


class OneLaw:
    """One law for the whole surface."""

    def __init__(self) -> None:
        self.learner = Learner()

    def learn(self, raster: Raster, tick: int) -> None:
        self.learner.update(*(float(column[tick]) for column in (raster.time, raster.depth, raster.force)))

    def predict(self, raster: Raster, ticks: range) -> Array:
        return along(self.learner.learnt(), raster, ticks)


class LawAndScale(OneLaw):
    """One law and a scale at each place, as shipped."""

    def __init__(self) -> None:
        self.places = ScaleFieldLearner()
        self.learner = Learner(places=self.places)

    def learn(self, raster: Raster, tick: int) -> None:
        self.places.touch_at(raster.point[tick].tolist())
        super().learn(raster, tick)

    def predict(self, raster: Raster, ticks: range) -> Array:
        scales, _ = self.field().scales_at(raster.point[ticks.start : ticks.stop])
        return super().predict(raster, ticks) * scales

    def field(self) -> ScaleField:
        return self.places.field


class WithoutNeighbours(LawAndScale):
    """The same, but beyond what was touched the scale is 1 at once."""

    def predict(self, raster: Raster, ticks: range) -> Array:
        known, field = self.places.states[0].scales, self.places.field
        field.records["value"][0], field.records["variance"][0] = known.value, known.variance
        scales, _ = field.scales_at(raster.point[ticks.start : ticks.stop])
        return along(self.learner.learnt(), raster, ticks) * scales


class LawOfAll(LawAndScale):
    """The same, but the law learns all that the scale leaves, however unsure that is."""

    def __init__(self) -> None:
        super().__init__()
        share = self.places.share

        def all_of_it(force: float, expected: float, deviation: float, period: float) -> float:
            share(force, expected, deviation, period)
            scale, _ = self.places.field.scale_at(self.places.states[0].point)
            return force / scale

        self.places.share = all_of_it  # type: ignore[method-assign]
        self.learner = Learner(_Steps(), places=self.places)


class _Steps(ContactMap):
    """A contact map that is called from Python, step by step."""


class WholeProcess(LawAndScale):
    """One law and a Gaussian process over all nodes, with their whole covariance."""

    SIDE = 24

    def __init__(self) -> None:
        self.places = _Whole(self.SIDE)  # type: ignore[assignment]
        self.learner = Learner(_Steps(), places=self.places)

    def predict(self, raster: Raster, ticks: range) -> Array:
        scales = [math.exp(self.places.here(point)[0]) for point in raster.point[ticks.start : ticks.stop]]  # type: ignore[attr-defined]
        return along(self.learner.learnt(), raster, ticks) * scales


class _Whole(ScaleFieldLearner):
    """The filter of `ScaleFieldLearner` with no node left out; about the middle of where specimens are."""

    MIDDLE = 0.075, 0.0  # [m]

    def __init__(self, side: int) -> None:
        super().__init__()
        self._side, at = side, SPACING * (np.arange(side) - side // 2)
        self._nodes = np.stack(np.meshgrid(at + self.MIDDLE[0], at + self.MIDDLE[1], indexing="ij"), 2).reshape(-1, 2)
        apart = np.linalg.norm(self._nodes[:, None] - self._nodes[None], axis=2)
        self._covariance, self._mean = SPREAD**2 * np.exp(-apart / REACH), np.zeros(side * side)
        self._point, self._begun = np.zeros(2), False

    def touch_at(self, point: object) -> None:
        self._point = np.asarray(point, np.float64)[:2]

    def _weights(self, point: Array) -> Array:
        away = np.maximum(1.0 - np.abs(point[:2] - self._nodes) / SPACING, 0.0)
        return np.asarray(away[:, 0] * away[:, 1])

    def here(self, point: Array) -> tuple[float, float, Array]:
        """Logarithm of the scale at a point, its variance, and its covariance with the nodes."""
        weights = self._weights(point)
        used = weights > 0.0
        towards = self._covariance[:, used] @ weights[used]
        return float(weights @ self._mean), float(weights @ towards), towards

    def _update(self, error: float, noise: float) -> None:
        _, variance, towards = self.here(self._point)
        self._mean += towards * error / (variance + noise)
        self._covariance -= np.outer(towards, towards / (variance + noise))

    def share(self, force: float, expected: float, deviation: float, period: float) -> float:
        if not self._begun:
            self._begun = True
            self._update(0.0, FIRST_DEVIATION**2)
        value, variance, _ = self.here(self._point)
        scale = math.exp(value)
        if not expected * min(scale, 1.0) > FORCE_NOISE:
            return force / scale
        noise = LAW_ERROR**2 + (FORCE_NOISE / (scale * expected)) ** 2 + (deviation / expected) ** 2
        self._update(min(max(force / (scale * expected) - 1.0, -1.0), 3.0), noise * CORRELATION / period)
        left = force * math.exp(-self.here(self._point)[0])
        return expected + noise / (noise + variance) * (left - expected)


class LawInEachCell:
    """A law in each cell of 6 mm, which begins from nothing; elsewhere one of all samples."""

    CELL = 6e-3

    def __init__(self) -> None:
        self.all, self.cells = OneLaw(), {}

    def _cell(self, point: Array) -> tuple[int, ...]:
        return tuple(np.floor(point[:2] / self.CELL).astype(int).tolist())

    def learn(self, raster: Raster, tick: int) -> None:
        self.all.learn(raster, tick)
        cell, conditioned = self._cell(raster.point[tick]), self.all.learner.sample
        if conditioned.in_contact:
            estimator = self.cells.setdefault(cell, ContactMap())
            if estimator.update(ContactSample(*conditioned)) is Status.RESTARTED:
                estimator.reset()

    def predict(self, raster: Raster, ticks: range) -> Array:
        whole = self.all.learner.learnt()
        forces = along(whole, raster, ticks)
        for cell in {self._cell(point) for point in raster.point[ticks.start : ticks.stop]}:
            model = self.cells[cell].model if cell in self.cells else None
            if model is None:
                continue
            there = [self._cell(point) == cell for point in raster.point[ticks.start : ticks.stop]]
            before = raster.depth[max(ticks.start - DELAY - 3000, 0) : ticks.start - DELAY] - whole.surface
            state = model.remember(model.initial_state(), before, np.full(before.size, PERIOD))
            forces[there] = along(LearntModel(model, whole.surface, state, ""), raster, ticks)[there]
        return forces


class QuadraticField:
    r"""A law at each node of a lattice of 6 mm, of which a place has the blend; and a mean law.

    .. math:: F = \sum_n w_n (a_n x + b_n x^2 + c_n x \dot x)

    by the Kalman filter of the four nodes about the probe, each with its own covariance.
    """

    CELL, NOISE, SHARE = 6e-3, 0.05, 0.15
    UNITS = np.array([5e-3, 5e-3**2, 5e-3 * 0.05])

    def __init__(self) -> None:
        self.all, self.nodes = OneLaw(), {}
        self.mean, self.spread = np.zeros(3), 300.0**2 * np.eye(3)

    def _about(self, point: Array) -> list[tuple[tuple[int, int], float]]:
        u, v = point[:2] / self.CELL
        i, j = math.floor(u), math.floor(v)
        return [
            ((i + a, j + b), ((u - i) if a else (1.0 - u + i)) * ((v - j) if b else (1.0 - v + j)))
            for a in (0, 1)
            for b in (0, 1)
        ]

    def _node(self, key: tuple[int, int]) -> tuple[Array, Array]:
        new = np.outer(self.mean, self.mean) * 0.9 + 0.04 * np.diag(self.mean**2)
        return self.nodes.get(key, (self.mean, new))

    def learn(self, raster: Raster, tick: int) -> None:
        self.all.learn(raster, tick)
        sample = self.all.learner.sample
        if not sample.in_contact or tick % 5:
            return
        x = sample.depth
        h = np.array([x, x * x, x * sample.velocity]) / self.UNITS
        noise = self.NOISE**2 + (self.SHARE * sample.force) ** 2
        towards = self.spread @ h
        self.mean = self.mean + towards * (sample.force - h @ self.mean) / (h @ towards + noise)
        self.spread = self.spread - np.outer(towards, towards) / (h @ towards + noise)
        about = [(key, weight, *self._node(key)) for key, weight in self._about(raster.point[tick])]
        total = noise + sum(weight**2 * h @ spread @ h for _, weight, _, spread in about)
        error = sample.force - sum(weight * h @ mean for _, weight, mean, _ in about)
        for key, weight, mean, spread in about:
            gain = weight * spread @ h
            grown = spread * (1.0 + 2e-3 * weight)
            self.nodes[key] = mean + gain * error / total, grown - np.outer(gain, gain) / total

    def predict(self, raster: Raster, ticks: range) -> Array:
        surface = self.all.learner.learnt().surface
        forces = np.zeros(len(ticks))
        for number, tick in enumerate(ticks):
            x = raster.depth[tick] - surface
            if x > 0.0:
                law = sum(weight * self._node(key)[0] for key, weight in self._about(raster.point[tick]))
                forces[number] = max(float(np.array([x, x * x, x * raster.velocity[tick]]) / self.UNITS @ law), 0.0)
        return forces
