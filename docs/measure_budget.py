"""Measure sessions over thin and over measured networks, and write docs/thin-links.md's tables and figure.

Usage: `.venv/bin/python docs/measure_budget.py [budgets] [losses] [traces] [cost]`, without names for all: an hour on
two cores. The seeds are 9001 to 9008; those of `losses`, which takes some minutes, the first three.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable
from functools import partialmethod
from itertools import product
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from measured_blocks import fill
from measuring import figure, table

from foretouch.link import NETWORK_NAMES, PUBLISHED_NETWORKS
from foretouch.messages import Command, SessionLog, Status
from foretouch.report import session_figures
from foretouch.robot import material_names
from foretouch.session import SessionSettings, simulate
from foretouch.session.thin import FollowerEnd, LeaderEnd
from foretouch.session.thin.ends import ENDS, PROTECTIONS

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURE = ROOT / "docs" / "thin-links.md", ROOT / "docs" / "images" / "thin-links.png"
SEEDS = range(9001, 9009)
DURATION = 20.0  # Of a session [s]
TRACED = 60.0  # Of one over a measured network [s]
BUDGETS = (1000.0, 2000.0, 8000.0)
MATERIAL = "foam-measured"
PRESSED = (MATERIAL, "hunt-crossley", "bone")  # Where packets are lost
LOSSES = ((0.0, 1.0), (0.05, 1.0), (0.1, 1.0), (0.2, 1.0), (0.1, 4.0))  # Ratio, and mean length of a burst [packets]
DEADBAND, DEADBAND_LEAST, SAMPLE_BYTES = 0.10, 0.05, 16
"""Of a codec of forces: the part of the force that it leaves out, the least [N], and bytes of a sample: ten around it,
a force and a time."""


class Ran(NamedTuple):
    """What is measured of a session."""

    error: float  # of the predicted force [%]
    delayed: float  # of the delayed one [%]
    within: float  # of the contact, prediction within the just noticeable difference [%]
    there: float  # bytes a second
    back: float
    stable: float  # 1 where the hand did not swing
    kept: float  # 1 where the certificate of energy held, no step failed, and no model was refused
    phantom: float  # force felt where there is no contact, RMS [N]
    stray: float  # RMS by which the robot's commands differ from the leader's at the same number [mm]
    codec: float  # error of the delayed force through a deadband [%]
    codec_back: float  # and its bytes a second
    stalls: float  # times without news
    peak: float  # largest force at the robot [N]


def run(material: str, seed: int, budget: float = 0.0, duration: float = DURATION, **settings: Any) -> Ran:
    """A session with a hand that feels it."""
    chosen = SessionSettings(material=material, grip="normal", seed=seed, budget=budget, **settings)
    return ran_of(simulate(chosen, duration=duration, say=lambda _: None).log, duration)


def ran_of(log: SessionLog, duration: float) -> Ran:
    """The figures of a session."""
    found = session_figures(log)
    heard, hand = found["heard"], found["hand"]
    kept = hand["certificate_holds"] and not log.counts["step_failures"] and not log.counts["models_refused"]
    figures = (
        *(found[name] for name in ("prediction_error_percent", "delayed_force_error_percent", "within_jnd_percent")),
        *(heard[side]["bytes_per_s"] for side in ("leader", "follower")),
        *(bool(found["stable"]), bool(kept), found["rendered_phantom_force_rms_N"], stray(log)),
        *(*deadbanded(log, duration), heard["stalls"], found["max_follower_force_N"]),
    )
    return Ran(*(math.nan if value is None else float(value) for value in figures))


def stray(log: SessionLog) -> float:
    """How far the robot's commands are from the leader's at the same number, where it follows them [mm]."""
    leader, follower = log.leader, log.follower
    at = np.searchsorted(leader["sequence"], follower["command_sequence"])
    follows = (follower["status"] == Status.FOLLOWING) & ~follower["guarded"] & (follower["command_sequence"] > 0)
    rows = np.flatnonzero(follows & (at < leader.size))
    apart = follower["desired_position"][rows] - leader["position"][at[rows]]
    apart = apart[np.isfinite(apart)]
    return 1e3 * float(np.sqrt(np.mean(np.square(apart)))) if apart.size else math.nan


def deadbanded(log: SessionLog, duration: float) -> tuple[float, float]:
    """What a codec gives that sends a force where it left a deadband: error of what is felt [%], and bytes a second.

    The force that is held is delayed as the session's telemetry is, and is scored as the delayed force is.
    """
    follower, leader = log.follower, log.leader
    held, kept, sent = np.zeros(follower.size), 0.0, 0
    for index, force in enumerate(follower["force"].tolist()):
        if abs(force - kept) > max(DEADBAND * abs(kept), DEADBAND_LEAST):
            kept, sent = force, sent + 1
        held[index] = kept
    at = np.searchsorted(follower["sequence"], leader["telemetry_sequence"])
    arrived = np.where(at < follower.size, held[np.minimum(at, follower.size - 1)], 0.0)
    place = np.searchsorted(leader["sequence"], follower["command_sequence"])
    rows = np.flatnonzero((place < leader.size) & follower["in_contact"] & (follower["time_ns"] > 1.5e9))
    true = follower["force"][rows]
    wrong = arrived[place[rows]] - true
    error = 100.0 * math.sqrt(np.mean(np.square(wrong)) / np.mean(np.square(true))) if rows.size else math.nan
    return error, SAMPLE_BYTES * sent / duration


def all_of(cases: list[tuple[Any, ...]], **settings: Any) -> Any:
    """The figures of sessions, two at a time, a row each."""
    return np.array(Parallel(n_jobs=2)(delayed(run)(*case, **settings) for case in cases))


class Loss(NamedTuple):
    """What is measured of a session that loses packets."""

    error: float  # of the predicted force [%]
    apart: float  # of 99 of 100 commands at the robot's side, from the leader's of the same number at most [um]
    without: float  # of the ticks, those without a command, after the first [%]
    whole: float  # models that came
    never: float  # and that did not
    there: float  # bytes a second
    back: float
    stable: float  # as in `Ran`
    kept: float


def lost(material: str, seed: int, protection: str, loss: float, burst: float) -> Loss:
    """A session over 2,000 bytes a second that loses packets."""
    ends: list[LeaderEnd] = []
    told: list[list[Any]] = []  # what the follower heard in each tick

    class KeptLeader(LeaderEnd):
        def __init__(self, *given: Any) -> None:
            super().__init__(*given)
            ends.append(self)
            told.clear()

    class KeptFollower(FollowerEnd):
        def heard(self, *given: Any) -> list[Any]:
            told.append(super().heard(*given))
            return told[-1]

    ENDS.update(leader=KeptLeader, follower=KeptFollower)
    log = simulate(
        SessionSettings(
            material=material, grip="normal", seed=seed, budget=2000.0, protection=protection, loss=loss, burst=burst
        ),
        duration=DURATION,
        say=lambda _: None,
    ).log
    ran = ran_of(log, DURATION)
    commands = [[one for one in due if isinstance(one, Command)] for due in told]
    first = next(tick for tick, due in enumerate(commands) if due)
    heard = [due[-1] for due in commands if due and due[-1].sequence <= log.leader.size]
    true = log.leader["position"][[one.sequence - 1 for one in heard]]
    wrong = np.abs(np.array([one.position for one in heard]) - true)
    apart = 1e6 * float(np.nanpercentile(wrong, 99.0))
    without = 100.0 * sum(not due for due in commands[first:]) / len(commands[first:])
    return Loss(ran.error, apart, without, *ends[-1].models_came, ran.there, ran.back, ran.stable, ran.kept)


def losses() -> dict[str, str]:
    """Sessions that lose packets, by what is sent against it."""
    cases = [
        (material, seed, protection, *loss)
        for loss, protection, material, seed in product(LOSSES, PROTECTIONS, PRESSED, SEEDS[:3])
    ]
    found = np.array(Parallel(n_jobs=2)(delayed(lost)(*case) for case in cases))
    rows = []
    groups = found.reshape(len(LOSSES) * len(PROTECTIONS), -1, len(Loss._fields))
    for ((loss, burst), protection), group in zip(product(LOSSES, PROTECTIONS), groups, strict=True):
        mean = Loss(*np.nanmean(group, axis=0))
        never = 100.0 * mean.never / (mean.whole + mean.never)
        name = f"{100 * loss:g}" + f", in bursts of {burst:g}" * (burst > 1.0)
        others = mean.there, mean.back, 100.0 * mean.stable, 100.0 * mean.kept
        rows.append([name, f"`{protection}`", *map(figure, (mean.error, never, mean.apart, mean.without, *others))])
    heads = ("Lost [%]", "Protection", "Error [%]", "Models never whole [%]", "Commands off by [um]")
    more = ("Ticks without one [%]", "There [B/s]", "Back [B/s]", "Stable [%]", "Certificate kept [%]")
    return {"losses": table((*heads, *more), rows)}


def budgets() -> dict[str, str]:
    """Sessions over budgets, and the figure of them."""
    materials = list(material_names())
    cases = [(one, seed, budget) for budget in (0.0, *BUDGETS) for one in materials for seed in SEEDS]
    found = all_of(cases).reshape(1 + len(BUDGETS), len(materials), len(SEEDS), len(Ran._fields))
    draw(found)
    rows = []
    for budget, group in zip(("all", *map(figure, BUDGETS)), found, strict=True):
        mean = Ran(*np.nanmean(group, axis=(0, 1)))
        added = np.nanmean(group[:, :, 0] - found[0, :, :, 0], axis=1)
        errors = mean.error, float(added.max()), mean.within
        others = 1e3 * mean.stray, 100.0 * mean.stable, 100.0 * mean.kept
        rows.append([budget, *map(figure, (*errors, mean.there, mean.back, *others))])
    heads = ("Budget [B/s]", "Error [%]", "Most added, of a material", "Within JND [%]", "There [B/s]", "Back [B/s]")
    return {"budgets": table((*heads, "Commands off by [um]", "Stable [%]", "Certificate kept [%]"), rows)}


def draw(found: Any) -> None:
    """Error of the prediction over the bytes of both ways, beside the delayed force and a codec of forces."""
    import matplotlib

    matplotlib.use("Agg")
    from foretouch.quantities import new_figure

    drawing = new_figure(4.6)
    axes = drawing.subplots()
    for rows, colour, marker, name in (
        (found[1:, ..., (0, 3, 4)], "#0072B2", "o", "force of the model, thin link"),
        (found[:1, ..., (9, 3, 10)], "#D55E00", "s", "delayed force through a deadband of 10 %"),
    ):
        errors = np.nanmedian(rows[..., 0], axis=(1, 2))
        low, high = np.nanpercentile(rows[..., 0], (25, 75), axis=(1, 2))
        size = np.nanmean(np.nan_to_num(rows[..., 1]) + rows[..., 2], axis=(1, 2))
        apart = np.array([errors - low, high - errors])
        axes.errorbar(size, errors, apart, color=colour, marker=marker, capsize=3, label=name)
    whole = np.nanmedian(found[0, ..., 0])
    axes.axhline(whole, color="black", linestyle="--", linewidth=1.2, label="force of the model, all messages")
    axes.axhline(np.nanmedian(found[0, ..., 1]), color="0.5", linestyle=":", label="delayed force, all messages")
    axes.set(xscale="log", xlabel="bytes a second, both ways together", ylabel="error of the force [%]")
    axes.set_ylim(bottom=0.0)
    axes.set_title("What a thin link costs: median and quartiles of 13 materials, 8 seeds")
    axes.legend(frameon=False, fontsize="small")
    drawing.tight_layout()
    drawing.savefig(PICTURE, dpi=150)


def traces() -> dict[str, str]:
    """Sessions over every network that is here, with all messages and with a budget."""
    names = [name for name in NETWORK_NAMES if name not in PUBLISHED_NETWORKS or PUBLISHED_NETWORKS[name].here]
    rows = []
    for name in names:
        cases = [(MATERIAL, seed, budget, TRACED) for budget in (0.0, 2000.0) for seed in SEEDS]
        found = all_of(cases, network=name).reshape(2, len(SEEDS), len(Ran._fields))
        whole, thin = (Ran(*np.nanmean(group, axis=0)) for group in found)
        errors = whole.error, thin.error, whole.delayed, whole.within, thin.within
        others = thin.stalls, thin.peak, 100.0 * thin.stable, 100.0 * thin.kept
        rows.append([f"`{name}`", *map(figure, (*errors, *others))])
    heads = ("Network", "Error, all messages [%]", "2,000 B/s", "Delayed force [%]", "Within JND [%]", "2,000 B/s")
    return {"traces": table((*heads, "Stalls", "Robot's peak [N]", "Stable [%]", "Certificate kept [%]"), rows)}


def cost() -> dict[str, str]:
    """Time of both ends in a tick, beside a session without them."""
    times: dict[str, list[float]] = {}
    for end in (LeaderEnd, FollowerEnd):
        taken = times.setdefault(end.__name__, [])

        def timed(self: Any, *given: Any, do: Any, taken: list[float] = taken) -> Any:
            began = time.perf_counter_ns()
            result = do(self, *given)
            taken.append((time.perf_counter_ns() - began) * 1e-3)
            return result

        for name in ("said", "heard"):
            setattr(end, name, partialmethod(timed, do=getattr(end, name)))
    simulate(SessionSettings(material=MATERIAL, grip="normal", budget=2000.0), duration=DURATION, say=lambda _: None)
    rows = []
    for name, taken in times.items():
        whole = np.array(taken[: len(taken) // 2 * 2]).reshape(-1, 2).sum(axis=1)
        rows.append([name, *map(figure, (float(np.median(whole)), *np.percentile(whole, (99.0, 99.9))))])
    return {"cost": table(("End", "A tick, median [us]", "99 of 100", "999 of 1,000"), rows)}


SECTIONS: dict[str, Callable[[], dict[str, str]]] = {
    "budgets": budgets,
    "losses": losses,
    "traces": traces,
    "cost": cost,
}


def main() -> None:
    """Measure what is asked for."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    measured: dict[str, str] = {}
    for name in sys.argv[1:] or SECTIONS:
        measured |= SECTIONS[name]()
        print(measured[name], flush=True)
    fill(PAGE, {name: text for name, text in measured.items() if name != "traces"})


if __name__ == "__main__":
    main()
