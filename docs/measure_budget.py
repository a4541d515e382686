"""Measure sessions over thin and over measured networks, and write docs/thin-links.md's tables and figure.

Usage: `.venv/bin/python docs/measure_budget.py [budgets] [delayed] [losses] [traces] [cost]`, without names for all:
two hours on two cores. The seeds are 9001 to 9008; of sessions that feel the delayed force, and of `losses`, which
takes some minutes, the first three.
"""

from __future__ import annotations

import gc
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
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
from foretouch.session.thin import ends as thin_ends

ROOT = Path(__file__).resolve().parents[1]
PAGE, PICTURE = ROOT / "docs" / "thin-links.md", ROOT / "docs" / "images" / "thin-links.png"
KEEP = ROOT / "out" / "thin-links"
SEEDS = range(9001, 9009)
FEW_SEEDS = SEEDS[:3]
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
    phantom: float  # force felt where there is no contact, RMS [mN]
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
        *(bool(found["stable"]), bool(kept), 1e3 * (found["rendered_phantom_force_rms_N"] or 0.0), stray(log)),
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

    thin_ends.ENDS.update(leader=KeptLeader, follower=KeptFollower)
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
        for loss, protection, material, seed in product(LOSSES, thin_ends.PROTECTIONS, PRESSED, FEW_SEEDS)
    ]
    found = np.array(Parallel(n_jobs=2)(delayed(lost)(*case) for case in cases))
    rows = []
    groups = found.reshape(len(LOSSES) * len(thin_ends.PROTECTIONS), -1, len(Loss._fields))
    for ((loss, burst), protection), group in zip(product(LOSSES, thin_ends.PROTECTIONS), groups, strict=True):
        mean = Loss(*np.nanmean(group, axis=0))
        never = 100.0 * mean.never / (mean.whole + mean.never)
        name = f"{100 * loss:g}" + f", in bursts of {burst:g}" * (burst > 1.0)
        others = mean.there, mean.back, 100.0 * mean.stable, 100.0 * mean.kept
        rows.append([name, f"`{protection}`", *map(figure, (mean.error, never, mean.apart, mean.without, *others))])
    heads = ("Lost [%]", "Protection", "Error [%]", "Models never whole [%]", "Commands off by [um]")
    more = ("Ticks without one [%]", "There [B/s]", "Back [B/s]", "Stable [%]", "Certificate kept [%]")
    return {"losses": table((*heads, *more), rows)}


LIMITS = (0.0, *BUDGETS)
WAYS, KEPT = ("There [B/s]", "Back [B/s]"), ("Stable [%]", "Certificate kept [%]")


def budgets() -> dict[str, str]:
    """Sessions over budgets."""
    found, rows = over_budgets("budgets", SEEDS), []
    for budget, group in zip(("all", *map(figure, BUDGETS)), found, strict=True):
        mean = Ran(*_mean(group))
        added = float(np.nanmean(group[:, :, 0] - found[0, :, :, 0], axis=1).max())
        errors = mean.error, added, mean.within, mean.phantom
        others = 1e3 * mean.stray, 100.0 * mean.stable, 100.0 * mean.kept
        rows.append([budget, *map(figure, errors), *map(bytes_of, (mean.there, mean.back)), *map(figure, others)])
    heads = ("Budget [B/s]", "Error [%]", "Most added, of a material", "Within JND [%]", "Phantom force [mN]")
    return {"budgets": table((*heads, *WAYS, "Commands off by [um]", *KEPT), rows)}


def felt_late() -> dict[str, str]:
    """The same with the delayed force instead of the model's."""
    rows = []
    for budget, group in zip(
        ("all", *map(figure, BUDGETS)), over_budgets("delayed", FEW_SEEDS, "delayed"), strict=True
    ):
        mean = Ran(*_mean(group))
        felt = mean.error, mean.phantom, 100.0 * mean.stable, 100.0 * mean.kept
        rows.append([budget, *map(figure, felt), *map(bytes_of, (mean.there, mean.back))])
    return {"delayed": table(("Budget [B/s]", "Error [%]", "Phantom force [mN]", *KEPT, *WAYS), rows)}


def over_budgets(name: str, seeds: Iterable[int], baseline: str = "none") -> Any:
    """Figures of sessions by budget, material and seed, which are kept; the picture is drawn once both are there."""
    materials = list(material_names())
    cases = [(one, seed, budget) for budget in LIMITS for one in materials for seed in seeds]
    found = all_of(cases, baseline=baseline).reshape(len(LIMITS), len(materials), -1, len(Ran._fields))
    KEEP.mkdir(parents=True, exist_ok=True)
    np.save(KEEP / f"{name}.npy", found)
    kept = [KEEP / f"{each}.npy" for each in ("budgets", "delayed")]
    if all(path.is_file() for path in kept):
        draw(*map(np.load, kept))
    return found


def _mean(group: Any) -> Any:
    """Of sessions in rows and columns."""
    return np.nanmean(group, axis=tuple(range(group.ndim - 1)))


def bytes_of(count: float) -> str:
    """Bytes a second; a dash where none are counted."""
    return figure(count if math.isfinite(count) else None)


def draw(found: Any, late: Any) -> None:
    """Error, stability and false contact over the bytes of both ways: the model, the delayed force, a codec of it."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib.ticker import FixedLocator, NullFormatter, StrMethodFormatter

    from foretouch.quantities import new_figure

    drawing = new_figure(8.4)
    error, stable, phantom = drawing.subplots(3, sharex=True, height_ratios=(2.0, 1.0, 1.0))
    at = {name: place for place, name in enumerate(Ran._fields)}
    series = (
        (found, ("error", "there", "back"), "#0072B2", "o", "force of the model"),
        (late, ("error", "there", "back"), "#D55E00", "s", "delayed force, said as the thin link says it"),
        (found[2:3], ("codec", "there", "codec_back"), "#009E73", "^", "delayed force, deadband of 10 %, open loop"),
    )
    for rows, (wrong, there, back), colour, marker, name in series:
        thin = rows[1:] if rows.shape[0] > 1 else rows
        errors = thin[..., at[wrong]]
        middle, low, high = np.nanpercentile(errors, (50, 25, 75), axis=(1, 2))
        size = np.nanmean(np.nan_to_num(thin[..., at[there]]) + thin[..., at[back]], axis=(1, 2))
        apart = np.array([middle - low, high - middle])
        error.errorbar(size, middle, apart, color=colour, marker=marker, capsize=3, label=name)
        if rows.shape[0] == 1:
            continue
        whole = np.nanmedian(rows[0, ..., at[wrong]])
        error.axhline(whole, color=colour, linestyle="--", linewidth=1.2, label=f"{name.split(',')[0]}, all messages")
        for axes, what, factor in ((stable, "stable", 100.0), (phantom, "phantom", 1.0)):
            values = factor * np.nanmean(rows[..., at[what]], axis=(1, 2))
            axes.plot(size, values[1:], color=colour, marker=marker)
            axes.axhline(values[0], color=colour, linestyle="--", linewidth=1.2)
    error.set(xscale="log", ylabel="error of the force [%]")
    error.set_ylim(bottom=0.0)
    stable.set(ylabel="stable [%]", ylim=(-5.0, 105.0))
    phantom.set(yscale="log", ylabel="phantom force [mN]", xlabel="bytes a second, both ways together")
    error.set_title("What a thin link costs: 13 materials, medians and quartiles; below, means")
    error.legend(frameon=False, fontsize="small")
    phantom.xaxis.set_major_locator(FixedLocator((1000, 2000, 5000, 10000)))
    phantom.xaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    phantom.xaxis.set_minor_formatter(NullFormatter())
    drawing.tight_layout()
    drawing.savefig(PICTURE, dpi=150)


def traces() -> dict[str, str]:
    """Sessions over every network that is here, with all messages and with a budget, and with the delayed force."""
    names = [name for name in NETWORK_NAMES if name not in PUBLISHED_NETWORKS or PUBLISHED_NETWORKS[name].here]
    rows = []
    for name in names:
        cases = [(MATERIAL, seed, budget, TRACED) for budget in (0.0, 2000.0) for seed in SEEDS]
        found = all_of(cases, network=name).reshape(2, len(SEEDS), len(Ran._fields))
        whole, thin = (Ran(*_mean(group)) for group in found)
        late = Ran(
            *_mean(all_of([(MATERIAL, seed, 0.0, TRACED) for seed in FEW_SEEDS], network=name, baseline="delayed"))
        )
        errors = whole.error, thin.error, late.error, whole.within, thin.within, thin.phantom
        others = thin.stalls, thin.peak, 100.0 * thin.stable, 100.0 * thin.kept, 100.0 * late.stable
        rows.append([f"`{name}`", *map(figure, (*errors, *others))])
        print(rows[-1], flush=True)
    felt = (
        "Error [%]",
        "at 2,000 B/s",
        "of the delayed force",
        "Within JND [%]",
        "at 2,000 B/s",
        "Phantom force [mN]",
    )
    kept = ("Stalls", "Robot's peak [N]", "Stable [%]", "Certificate kept [%]", "Delayed force stable [%]")
    return {"traces": table(("Network", *felt, *kept), rows)}


Call = tuple[str, list[Any], int]


def cost() -> dict[str, str]:
    """Time of both ends in a tick: in a session, and when what they were given there is given to them again."""
    rows = []
    for end in (LeaderEnd, FollowerEnd):
        given: list[Call] = []
        within: list[float] = []
        with timed(end, given, within):
            settings = SessionSettings(material=MATERIAL, grip="normal", budget=2000.0)
            simulate(settings, duration=DURATION, say=lambda _: None)
        again = np.min([_replayed(end, given) for _ in range(REPLAYS)], axis=0)
        columns = [value for taken in (again, np.array(within)) for value in _middle_and_late(taken)]
        rows.append([end.__name__, *map(figure, columns)])
    heads = ("Again, median [us]", "99 of 100", "In the session, median [us]", "99 of 100")
    return {"cost": table(("End", *heads), rows)}


REPLAYS = 7  # Of which each tick's quickest counts: what else the machine did is not in it


@contextmanager
def timed(end: type[Any], given: list[Call], taken: list[float]) -> Iterator[None]:
    """Note what the methods of an end are given, and how long they take [us]."""
    plain = {name: getattr(end, name) for name in ("said", "heard")}

    def around(self: Any, messages: Any, now_ns: int, *, name: str) -> Any:
        messages = list(messages)
        given.append((name, list(messages), now_ns))
        began = time.perf_counter_ns()
        result = plain[name](self, messages, now_ns)
        taken.append((time.perf_counter_ns() - began) * 1e-3)
        return result

    for name in plain:
        setattr(end, name, partialmethod(around, name=name))
    try:
        yield
    finally:
        for name, method in plain.items():
            setattr(end, name, method)


def _replayed(end: type[Any], given: list[Call]) -> list[float]:
    """Times of a new end that is given the same [us]."""
    made, taken = end(2000.0), []
    gc.disable()
    for name, messages, now_ns in given:
        method = getattr(made, name)
        began = time.perf_counter_ns()
        method(messages, now_ns)
        taken.append((time.perf_counter_ns() - began) * 1e-3)
    gc.enable()
    return taken


def _middle_and_late(taken: Any) -> tuple[float, float]:
    """Median and 99 of 100 of ticks, of which each is one of hearing and one of saying."""
    ticks = taken[: taken.size // 2 * 2].reshape(-1, 2).sum(axis=1)
    return float(np.median(ticks)), float(np.percentile(ticks, 99.0))


AT = "tcp/127.0.0.1:7447 --budget 2000 --json"
ALONE = f"""ip link set lo up
$PYTHON -m foretouch follower --duration 30 --listen {AT} > follower.json &
$PYTHON -m foretouch leader --operator scripted --duration 20 --connect {AT} > leader.json
wait
cat /proc/net/dev > counted
"""
"""Both sides in a network of their own, of which every byte is counted."""


def overhead() -> dict[str, str]:
    """Bytes that TCP/IP and Zenoh put around a packet, acknowledgements and all, on a machine's own network."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        command, environment = ["unshare", "--net", "sh", "-c", ALONE], os.environ | {"PYTHON": sys.executable}
        subprocess.run(command, cwd=folder, env=environment, check=True, stderr=subprocess.DEVNULL)
        counts: dict[str, int] = {}
        for side in ("leader", "follower"):
            counts |= json.loads((folder / f"{side}.json").read_text())
        counted = next(line for line in (folder / "counted").read_text().splitlines() if "lo:" in line)
    crossed = int(counted.split(":")[1].split()[0])
    said, packets = (
        sum(counts[f"{side}_thin_{what}"] for side in ("leader", "follower")) for what in ("bytes", "packets")
    )
    row = [figure(packets), figure(said / packets), figure((crossed - said) / packets)]
    return {"overhead": table(("Packets, both ways", "Bytes of one", "Bytes around it"), [row])}


SECTIONS: dict[str, Callable[[], dict[str, str]]] = {
    "budgets": budgets,
    "delayed": felt_late,
    "losses": losses,
    "traces": traces,
    "cost": cost,
    "overhead": overhead,
}


def main() -> None:
    """Measure what is asked for."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    measured: dict[str, str] = {}
    for name in sys.argv[1:] or SECTIONS:
        found = SECTIONS[name]()
        measured |= found
        print(*found.values(), sep="\n", flush=True)
    fill(PAGE, measured)


if __name__ == "__main__":
    main()
