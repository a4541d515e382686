"""Measure what crosses a thin network, and what it costs: bytes a second beside the error of the prediction.

Usage: `.venv/bin/python docs/measure_network.py [--seeds 9001-9008] [--materials NAME ...] [SECTION ...]`, without
names for all sections. `models` takes twenty minutes on two cores: every material, by seeds that nothing was chosen on,
with all models and with those alone that are felt. `parts` is the sensitivity that the change of force was chosen by at
which a model is sent, on other seeds.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from measuring import Row, figure, table

from foretouch.messages import Command, ModelUpdate
from foretouch.report import session_figures
from foretouch.robot import material_names
from foretouch.session import SessionSettings
from foretouch.session.runners import simulated
from foretouch.session.thin.models.heard import ModelsHeard
from foretouch.session.thin.models.said import PART, ModelsSaid

DURATION = 20.0  # Of a session [s]
LEARNING = 5.0  # After the first valid model, and after each change of the material [s]: the rest is steady
CHOSEN_ON = range(101, 105)  # Seeds that parts were chosen on
PARTS = (0.1, 0.2, 0.4, 0.8)


class ThinModels:
    """Both ends of a thin link for models, around a simulated network."""

    def __init__(self, part: float) -> None:
        self.said, self.heard = ModelsSaid(part), ModelsHeard()
        self.acknowledged, self.asks_ns = 0, -1
        self.times: list[float] = []
        self.sizes: list[int] = []
        self.began = np.inf
        self.changes: list[float] = []

    def around_leader(self, leads: Any, delay_ns: int) -> None:
        """Let models cross as bytes on their way to the leader."""
        push, pop = leads.arriving.push, leads.arriving.pop_due

        def say(now_ns: int, message: Any) -> None:
            if type(message) is not ModelUpdate:
                push(now_ns, message)
                return
            self._note(message, now_ns)
            if 0 <= self.asks_ns <= now_ns:
                self.said.ask_whole()
                self.asks_ns = -1
            data = self.said.offer(message, self.acknowledged, now_ns)
            if data is not None:
                self.times.append(now_ns * 1e-9)
                self.sizes.append(len(data))
                push(now_ns, data)

        def hear(now_ns: int) -> list[Any]:
            came = [self.heard.take(each) if type(each) is bytes else each for each in pop(now_ns)]
            if self.heard.wants_whole and self.asks_ns < 0:
                self.asks_ns = now_ns + delay_ns
            return [each for each in came if each is not None]

        leads.arriving.push, leads.arriving.pop_due = say, hear

    def around_follower(self, follows: Any) -> None:
        """Learn from commands which model the leader renders from."""
        pop = follows.arriving.pop_due

        def hear(now_ns: int) -> list[Any]:
            came: list[Any] = pop(now_ns)
            known = [each.acknowledged_model for each in came if type(each) is Command]
            self.acknowledged = max([self.acknowledged, *known])
            return came

        follows.arriving.pop_due = hear

    def _note(self, update: ModelUpdate, now_ns: int) -> None:
        now = now_ns * 1e-9
        if update.valid:
            self.began = min(self.began, now)
        if update.reason.startswith("the material changed") and (not self.changes or now > self.changes[-1] + 2.5):
            self.changes.append(now)

    def rates(self, duration: float) -> tuple[float, float, float, float]:
        """Bytes and models a second, while learning and in steady contact."""
        grid = np.arange(0.0, duration, 0.02)
        starts = [self.began, *self.changes]
        learns = np.any([(grid >= start) & (grid < start + LEARNING) for start in starts], axis=0)
        steady = (grid >= self.began) & ~learns
        times, sizes = np.array(self.times), np.array(self.sizes)
        among = learns[np.minimum((times / 0.02).astype(int), grid.size - 1)]
        late = (times >= self.began) & ~among
        seconds = 0.02 * max(learns.sum(), 1), 0.02 * max(steady.sum(), 1)
        return (
            float(sizes[among].sum() / seconds[0]),
            float(sizes[late].sum() / seconds[1]),
            float(among.sum() / seconds[0]),
            float(late.sum() / seconds[1]),
        )


@contextmanager
def thinned(thin: ThinModels | None, settings: SessionSettings) -> Iterator[None]:
    """Simulated sessions with the ends of a thin link; None for none."""
    runner: Any = simulated
    drive_leader, drive_follower = runner.drive_leader, runner.drive_follower

    def leads(*arguments: Any) -> Any:
        made = drive_leader(*arguments)
        if thin is not None:
            thin.around_leader(made, round(settings.position_delay * 1e9))
        return made

    def follows(*arguments: Any) -> Any:
        made = drive_follower(*arguments)
        if thin is not None:
            thin.around_follower(made)
        return made

    runner.drive_leader, runner.drive_follower = leads, follows
    try:
        yield
    finally:
        runner.drive_leader, runner.drive_follower = drive_leader, drive_follower


class Session(NamedTuple):
    """What is measured of a session: bytes and models a second are 0 where all models crossed."""

    error: float
    learning: float = 0.0
    steady: float = 0.0
    models_learning: float = 0.0
    models_steady: float = 0.0


def session(material: str, seed: int, part: float | None) -> Session:
    """One session with a hand that feels it; a part of None sends every model as it is."""
    settings = SessionSettings(material=material, grip="normal", seed=seed)
    thin = None if part is None else ThinModels(part)
    with thinned(thin, settings):
        log = simulated.simulate(settings, duration=DURATION).log
    error = session_figures(log)["prediction_error_percent"]
    return Session(float("nan") if error is None else error, *(thin.rates(DURATION) if thin else ()))


def sessions(materials: list[str], seeds: range, parts: tuple[float | None, ...], jobs: int) -> Any:
    """The figures, shape (materials, parts, seeds, 5)."""
    cases = [(material, seed, part) for material in materials for part in parts for seed in seeds]
    found = Parallel(n_jobs=jobs)(delayed(session)(*case) for case in cases)
    return np.array(found).reshape(len(materials), len(parts), len(seeds), 5)


def models(materials: list[str], seeds: range, jobs: int) -> str:
    """Bytes a second of the models, and the error of the prediction with all of them and with those that are felt."""
    found = sessions(materials, seeds, (None, PART), jobs)
    rows: list[Row] = []
    for material, (now, thin) in zip(materials, found, strict=True):
        worst = thin[:, 1].max(), thin[:, 2].max()
        rows.append([f"`{material}`", *map(figure, _row_of(now, thin, worst))])
    now, thin = found[:, 0].reshape(-1, 5), found[:, 1].reshape(-1, 5)
    rows.append(["all", *map(figure, _row_of(now, thin, (thin[:, 1].max(), thin[:, 2].max())))])
    heads = (
        "Material",
        "Learning [B/s]",
        "Worst",
        "Steady [B/s]",
        "Worst",
        "Error, all models [%]",
        "Felt ones [%]",
        "Models/s, learning",
        "Steady",
    )
    return table(heads, rows)


def _row_of(now: Any, thin: Any, worst: tuple[float, float]) -> tuple[float, ...]:
    mean = thin.mean(axis=0)
    return mean[1], worst[0], mean[2], worst[1], now[:, 0].mean(), mean[0], mean[3], mean[4]


def parts(materials: list[str], seeds: range, jobs: int) -> str:
    """The same over parts of the just noticeable difference, all materials together."""
    found = sessions(materials, CHOSEN_ON, (None, *PARTS), jobs)
    rows = []
    for number, part in enumerate(("all models", *map(figure, PARTS))):
        mean, added = found[:, number].mean(axis=(0, 1)), found[:, number, :, 0] - found[:, 0, :, 0]
        rows.append([part, *map(figure, (mean[0], added.mean(axis=1).max(), *mean[1:]))])
    heads = ("Part", "Error [%]", "Most added, of a material", "Learning [B/s]", "Steady [B/s]")
    return table((*heads, "Models/s, learning", "Steady"), rows)


SECTIONS: dict[str, Callable[[list[str], range, int], str]] = {"models": models, "parts": parts}


def main() -> None:
    """Measure the sections that are named."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("sections", nargs="*", choices=[[], *SECTIONS])
    asked.add_argument("--seeds", default="9001-9008")
    asked.add_argument("--materials", nargs="*", default=list(material_names()))
    asked.add_argument("--jobs", type=int, default=2)
    given = asked.parse_args()
    first, last = map(int, given.seeds.split("-"))
    for name in given.sections or SECTIONS:
        print(f"{name}, seeds {given.seeds}\n\n{SECTIONS[name](given.materials, range(first, last + 1), given.jobs)}")


if __name__ == "__main__":
    main()
