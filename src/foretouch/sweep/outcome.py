"""One session of a sweep, from its case to its row of figures, and what became of all of them, in numbers."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import msgspec
import numpy as np

from foretouch.messages import SessionLog, Status, encode
from foretouch.quantities import Array, Rows
from foretouch.report import CONTACT_FLOOR, hand_figures, pair, update_jumps
from foretouch.session import SAMPLE_PERIOD, SessionSettings, simulate
from foretouch.sweep.cases import Case

LARGEST_JUMP = 0.1
"""Largest change of force that models may make in one tick, before limits [N]."""

FORCE_CEILING = SessionSettings.force_ceiling  # Largest force with which a robot may press [N]


class Outcome(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One session of a sweep.

    A figure is None where there is nothing to measure it on, and all are where the session failed.

    Attributes:
        number: Number of the session.
        baseline: Baseline that was rendered: ``"none"`` for models.
        command: Command that runs the session again.
        duration_s: Simulated time [s].
        network: Effects of the network beside delay.
        round_trip_s: Sum of both delays [s].
        options: Options that differ from the defaults.
        error: Reason that the session failed; empty where it did not.
        stable: Whether the certificate of energy held in every tick, forces were finite and the hand did not oscillate.
        oscillating: Whether the hand made more swings than it meant to: `foretouch.report.oscillation`.
        forces_finite: Whether all forces were numbers.
        net_energy_J: Smallest energy of the certificate in any tick [J]: `foretouch.report.energy_figures`.
        energy_bound_J: Bound of that tick [J].
        energy_margin_J: Smallest of energy and bound together [J]; below 0 the bound is broken.
        energy_used_percent: Largest ratio of the energy taken to its bound [%]; above 100 the bound is broken.
        net_energy_exact_J: Smallest energy by the hand's own position, without the encoder's steps [J].
        largest_jump_N: Largest change of the mediated force in a tick that models made [N]; None for a baseline.
        error_percent: RMS of the felt force over the force scale less the true one, at equal command sequence in
            contact, as a ratio to the RMS of the true one [%].
        prediction_error_percent: The same of the predicted force: what mediation and device take away is between both.
        felt_stiffness_percent: Slope of the felt force over the hand, both unscaled, as a ratio to that of the true
            force over the probe [%]; straight lines of least squares, median of the presses of 0.2 s or more in which
            hand and probe go 2 mm or more.
        contact_s: Time over which both were taken [s]: true force above 0.05 N, hand and probe coupled, nothing held
            back.
        largest_phantom_N: Largest felt force, unscaled, at commands at which the probe touched nothing [N].
        age_s: Median age of the hand position that the newest rendered knowledge comes from [s].
        models_per_s: Rate of models that were used [1/s].
        largest_hand_force_N: Largest force on the hand [N].
        largest_robot_force_N: Largest force on the robot [N].
        held_s: Time in which the robot did not follow commands: held, or on its way back [s].
        disbelieved_ticks: Ticks in which the sensors were not believed; no sensor of a sweep fails.
        guarded_contacts: Number of first touches in which the follower held back.
        guarded_s: Time for which it held back, in the air too [s].
        depth_lost_mm: The farthest that a guarded contact stayed behind the commands [mm].
        time_lost_s: The longest that one took until commands were followed again [s].
        device_bound_percent: Fraction of contact in which the device could not carry the model [%].
        digest: Digest of every tick and every model, bit by bit.
        elapsed_s: Real time [s].
    """

    number: int
    baseline: str
    command: str
    duration_s: float
    network: str
    round_trip_s: float
    options: dict[str, str | float | int]
    error: str = ""
    stable: bool | None = None
    oscillating: bool | None = None
    forces_finite: bool | None = None
    net_energy_J: float | None = None
    energy_bound_J: float | None = None
    energy_margin_J: float | None = None
    energy_used_percent: float | None = None
    net_energy_exact_J: float | None = None
    largest_jump_N: float | None = None
    error_percent: float | None = None
    prediction_error_percent: float | None = None
    felt_stiffness_percent: float | None = None
    contact_s: float | None = None
    largest_phantom_N: float | None = None
    age_s: float | None = None
    models_per_s: float | None = None
    largest_hand_force_N: float | None = None
    largest_robot_force_N: float | None = None
    held_s: float | None = None
    disbelieved_ticks: int | None = None
    guarded_contacts: int | None = None
    guarded_s: float | None = None
    depth_lost_mm: float | None = None
    time_lost_s: float | None = None
    device_bound_percent: float | None = None
    digest: str = ""
    elapsed_s: float = 0.0

    @property
    def objections(self) -> list[str]:
        """A sentence for each fault of this session."""
        if self.error:
            return [f"failed: {self.error}"]
        sentences = []
        if self.oscillating:
            sentences.append("the hand oscillates")
        if not self.forces_finite:
            sentences.append("a force is not finite")
        margin = math.nan if self.energy_margin_J is None else self.energy_margin_J
        if not margin >= -1e-9:
            sentences.append(f"gives out {-margin:.3g} J more than its bound")
        elif not (self.stable or sentences):
            sentences.append("its account of energy is not the sum of its forces and positions")
        if self.largest_jump_N is not None and self.largest_jump_N > LARGEST_JUMP:
            sentences.append(f"a model changes the force by {self.largest_jump_N:.3g} N in one tick")
        if self.largest_robot_force_N is not None and self.largest_robot_force_N > FORCE_CEILING:
            sentences.append(f"the robot presses with {self.largest_robot_force_N:.3g} N")
        if self.disbelieved_ticks:
            sentences.append(f"sensors are not believed in {self.disbelieved_ticks} ticks, and none failed")
        return sentences

    def same_as(self, other: Outcome) -> bool:
        """Whether both are one session, bit by bit, whatever the time it took."""
        return msgspec.structs.replace(self, elapsed_s=other.elapsed_s) == other


def of(rows: Iterable[Outcome], baseline: str) -> list[Outcome]:
    """The rows of ours (``"none"``), or of a baseline."""
    return [row for row in rows if row.baseline == baseline]


def totals(rows: Sequence[Outcome]) -> dict[str, Any]:
    """Totals of these sessions, ready for JSON; None where there is nothing to measure.

    The largest energy surplus is the most that a session gave out beyond its bound [J], 0 where none did.
    """
    ran = [row for row in rows if not row.error]
    return {
        "sessions": len(rows),
        "failed": len(rows) - len(ran),
        "unstable": sum(not row.stable for row in ran),
        "oscillating": sum(bool(row.oscillating) for row in ran),
        "bound_broken": sum(row.energy_margin_J is not None and row.energy_margin_J < 0.0 for row in ran),
        "largest_energy_surplus_J": _surplus(_extreme(ran, "energy_margin_J", min)),
        "largest_jump_N": _extreme(ran, "largest_jump_N", max),
        "median_error_percent": _median(ran, "error_percent"),
        "median_prediction_error_percent": _median(ran, "prediction_error_percent"),
        "median_felt_stiffness_percent": _median(ran, "felt_stiffness_percent"),
        "largest_phantom_N": _extreme(ran, "largest_phantom_N", max),
        "median_phantom_N": _median(ran, "largest_phantom_N"),
        "largest_hand_force_N": _extreme(ran, "largest_hand_force_N", max),
        "largest_robot_force_N": _extreme(ran, "largest_robot_force_N", max),
        "held_s": sum(row.held_s or 0.0 for row in ran),
        "false_alarms": sum(bool(row.disbelieved_ticks) for row in ran),
        "median_device_bound_percent": _median(ran, "device_bound_percent"),
        "guarded_contacts": sum(row.guarded_contacts or 0 for row in ran),
        "median_depth_lost_mm": _median(ran, "depth_lost_mm"),
        "median_time_lost_s": _median(ran, "time_lost_s"),
        "simulated_s": sum(row.duration_s for row in ran),
        "elapsed_s": sum(row.elapsed_s for row in ran),
    }


def _values(rows: Sequence[Outcome], name: str) -> list[float]:
    return [value for value in (getattr(row, name) for row in rows) if value is not None and math.isfinite(value)]


def _extreme(rows: Sequence[Outcome], name: str, choose: Callable[..., float]) -> float | None:
    return choose(_values(rows, name), default=None)


def _median(rows: Sequence[Outcome], name: str) -> float | None:
    values = _values(rows, name)
    return float(np.median(values)) if values else None


def _surplus(margin: float | None) -> float | None:
    return None if margin is None else max(0.0, -margin)


_ENERGY = ("net_energy_J", "energy_bound_J", "energy_margin_J", "energy_used_percent", "net_energy_exact_J")

SHORTEST_CONTACT = 0.2  # Shortest contact from which the feel is judged [s]
SHORTEST_WAY = 2e-3  # Shortest path of hand and probe in a press that shows a stiffness [m]


def measure(log: SessionLog, settings: SessionSettings) -> dict[str, Any]:
    """All measured figures of `Outcome`, by name; most are those of the session's report."""
    figures = hand_figures(log)
    hand = figures["hand"]
    models, follower = log.leader["model_sequence"], log.follower[log.follower["command_sequence"] > 0]
    held = ~np.isin(follower["status"], (Status.FOLLOWING, Status.GUARDED))
    return {
        **{name: figures[name] for name in ("stable", *_ENERGY, "guarded_contacts", "guarded_s")},
        "oscillating": bool(hand["oscillation"]["oscillates"]),
        "forces_finite": hand["forces_finite"],
        "largest_jump_N": update_jumps(log.leader)["largest_update_jump_N"] if settings.baseline == "none" else None,
        **_transparency(log, settings),
        "models_per_s": np.unique(models[models > 0]).size / (models.size * SAMPLE_PERIOD),
        "largest_hand_force_N": hand["peak_force_hand_N"],
        "largest_robot_force_N": hand["peak_force_robot_N"],
        "held_s": float(held.sum()) * SAMPLE_PERIOD,
        "disbelieved_ticks": int((follower["validity"] > 0).sum()),
        "depth_lost_mm": hand["depth_lost_mm"],
        "time_lost_s": hand["time_lost_s"],
        "device_bound_percent": hand["device_bound_percent"],
        "digest": digest(log),
    }


def digest(log: SessionLog) -> str:
    """SHA-256 of all ticks of both sides and all models; real computing times, which differ on repeat, are left out."""
    sum_ = hashlib.sha256()
    for rows in (log.leader, log.follower):
        for name in rows.dtype.names or ():
            if name != "compute_ns":
                sum_.update(np.ascontiguousarray(rows[name]).tobytes())
    for model in log.models:
        sum_.update(encode(model))
    return sum_.hexdigest()


def _transparency(log: SessionLog, settings: SessionSettings) -> dict[str, float | None]:
    """Felt forces against true ones: rows in contact, coupled before and after, nothing held back."""
    pairs = pair(log)
    leader, follower = pairs.leader, pairs.follower
    coupled = leader["engaged"] & (follower["status"] == Status.FOLLOWING)
    rows, nothing = (follower["exact_force"] > CONTACT_FLOOR) & coupled, (follower["exact_force"] <= 0.0) & coupled
    contact = float(rows.sum()) * SAMPLE_PERIOD
    phantom = float((leader["rendered_force"][nothing] / settings.force_scale).max()) if nothing.any() else None
    if contact < SHORTEST_CONTACT:
        return {"contact_s": contact, "largest_phantom_N": phantom}
    leader, follower = leader[rows], follower[rows]
    felt, true = leader["rendered_force"] / settings.force_scale, follower["exact_force"]
    presses = np.split(np.arange(rows.sum()), np.flatnonzero(np.diff(np.flatnonzero(rows)) > 1) + 1)
    hand, probe = leader["hand_position"] * settings.position_scale, follower["position"]
    return {
        "contact_s": contact,
        "largest_phantom_N": phantom,
        "error_percent": 100.0 * _rms(felt - true) / _rms(true),
        "prediction_error_percent": 100.0 * _rms(leader["predicted_force"] - true) / _rms(true),
        "felt_stiffness_percent": felt_stiffness([(hand[p], felt[p], probe[p], true[p]) for p in presses]),
        "age_s": _age(log, leader, settings.baseline != "none"),
    }


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2)))


def felt_stiffness(presses: Sequence[tuple[Array, ...]]) -> float | None:
    """Slope of the felt force as a ratio to the true one's [%], median of the presses that show it; None without any.

    Each press by itself, with position of the hand and felt force, position of the probe and true force: between two
    of them, hand and probe may have been brought together otherwise.
    """
    ratios = [
        100.0 * _slope(hand, felt) / _slope(probe, true)
        for hand, felt, probe, true in presses
        if hand.size * SAMPLE_PERIOD >= SHORTEST_CONTACT
        and min(np.ptp(hand), np.ptp(probe)) >= SHORTEST_WAY
        and _slope(probe, true) > 0.0
    ]
    return float(np.median(ratios)) if ratios else None


def _slope(position: Array, force: Array) -> float:
    """Slope of the straight line of least squares [N/m]; 0 where nothing moves."""
    apart = position - position.mean()
    square = float(apart @ apart)
    return float(apart @ force) / square if square > 0.0 else 0.0


def _age(log: SessionLog, leader: Rows, delayed: bool) -> float | None:
    """Median age of what was rendered from: the models, or of a baseline the telemetry; leader ticks are commands."""
    if delayed:
        sources, newest = log.follower[["sequence", "command_sequence"]], leader["telemetry_sequence"]
        numbers, commands = sources["sequence"], sources["command_sequence"]
    else:
        newest = leader["model_sequence"]
        numbers = np.array([model.sequence for model in log.models], dtype=np.int64)
        commands = np.array([model.command_sequence for model in log.models], dtype=np.int64)
    index = np.searchsorted(numbers, newest)
    known = (newest > 0) & (index < numbers.size)
    if not known.any():
        return None
    return float(np.median(leader["sequence"][known] - commands[index[known]])) * SAMPLE_PERIOD


def log_of(case: Case) -> tuple[SessionLog, float]:
    """Run the session: its log, and the real time that it took [s]."""
    settings = case.settings()
    session = simulate(settings, duration=case.duration, say=lambda _: None)
    return session.log, session.elapsed


def run_case(case: Case) -> Outcome:
    """Run the session and measure it; one that fails, however, is a row that says why."""
    try:
        log, elapsed = log_of(case)
        figures = measure(log, case.settings())
    except Exception as error:  # a sweep goes on, whatever one session meets
        return failed(case, f"{type(error).__name__}: {error}")
    return Outcome(**_facts(case), **figures, elapsed_s=elapsed)


def failed(case: Case, reason: str) -> Outcome:
    """The row of a session that gave no result."""
    return Outcome(**_facts(case), error=" ".join(reason.split()))


def _facts(case: Case) -> dict[str, Any]:
    return {
        "number": case.number,
        "baseline": case.baseline,
        "command": case.command,
        "duration_s": case.duration,
        "network": case.network,
        "round_trip_s": case.round_trip,
        "options": case.options,
    }
