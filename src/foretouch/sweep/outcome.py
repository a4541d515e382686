"""What came of one session of a sweep, one row of its table, and what became of all of them, in numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import msgspec
import numpy as np

from foretouch.session import SessionSettings

LARGEST_JUMP = 0.1
"""Largest change of force that models may make in one tick, before limits [N]."""


FORCE_CEILING = SessionSettings.force_ceiling
"""The most that a robot may press with [N]."""


class Outcome(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One session of a sweep.

    A figure is None where there is nothing to measure it on, and all are where the session failed.

    Attributes:
        number: Of the session.
        baseline: What was rendered: ``"none"`` for models.
        command: That runs the session again.
        duration_s: Simulated [s].
        network: What it did beside delaying.
        round_trip_s: Both delays [s].
        options: What differed from the defaults.
        error: Why the session failed; empty where it did not.
        stable: Whether the certificate of energy held in every tick, forces were finite and the hand did not oscillate.
        oscillating: Whether the hand made more swings than it meant to: `foretouch.report.oscillation`.
        forces_finite: Whether all forces were numbers.
        net_energy_J: Smallest energy of the certificate in any tick [J]: `foretouch.report.energy_figures`.
        energy_bound_J: Bound of that tick [J].
        energy_margin_J: Smallest of energy and bound together [J]; below 0 the bound is broken.
        energy_used_percent: Largest share of its bound that the energy took [%]; above 100 the bound is broken.
        net_energy_exact_J: Smallest energy by the hand's own position, without the encoder's steps [J].
        largest_jump_N: Largest change of the mediated force in a tick that models made [N]; None for a baseline.
        error_percent: RMS of the felt force over the force scale less the true one, at equal command sequence in
            contact, as a share of the RMS of the true one [%].
        prediction_error_percent: The same of the predicted force: what mediation and device take away is between both.
        felt_stiffness_percent: Slope of the felt force over the hand, both unscaled, as a share of that of the true
            force over the probe [%]; straight lines of least squares, median of the presses of 0.2 s or more in which
            hand and probe go 2 mm or more.
        contact_s: Time over which both were taken [s]: true force above 0.05 N, hand and probe coupled, nothing held
            back.
        largest_phantom_N: Largest felt force, unscaled, at commands at which the probe touched nothing [N].
        age_s: Median of how long ago the hand was where the newest knowledge that is rendered comes from [s].
        models_per_s: Models that were used [1/s].
        largest_hand_force_N: [N].
        largest_robot_force_N: [N].
        held_s: For how long the robot did not follow the commands that there were: held, or on its way back [s].
        disbelieved_ticks: Ticks in which the sensors were not believed; no sensor of a sweep fails.
        guarded_contacts: How often the follower held back in a first touch.
        guarded_s: For how long it held back, in the air too [s].
        depth_lost_mm: The farthest that a guarded contact stayed behind the commands [mm].
        time_lost_s: The longest that one took until commands were followed again [s].
        device_bound_percent: Share of contact in which the device could not carry the model [%].
        digest: Of every tick and every model, bit by bit.
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
        """What is wrong with this session, a sentence each."""
        if self.error:
            return [f"failed: {self.error}"]
        found = []
        if self.oscillating:
            found.append("the hand oscillates")
        if not self.forces_finite:
            found.append("a force is not finite")
        margin = math.nan if self.energy_margin_J is None else self.energy_margin_J
        if not margin >= -1e-9:
            found.append(f"gives out {-margin:.3g} J more than its bound")
        elif not (self.stable or found):
            found.append("its account of energy is not the sum of its forces and positions")
        if self.largest_jump_N is not None and self.largest_jump_N > LARGEST_JUMP:
            found.append(f"a model changes the force by {self.largest_jump_N:.3g} N in one tick")
        if self.largest_robot_force_N is not None and self.largest_robot_force_N > FORCE_CEILING:
            found.append(f"the robot presses with {self.largest_robot_force_N:.3g} N")
        if self.disbelieved_ticks:
            found.append(f"sensors are not believed in {self.disbelieved_ticks} ticks, and none failed")
        return found

    def same_as(self, other: Outcome) -> bool:
        """Whether both are one session, bit by bit, whatever the time it took."""
        return msgspec.structs.replace(self, elapsed_s=other.elapsed_s) == other


def of(rows: Iterable[Outcome], baseline: str) -> list[Outcome]:
    """The rows of ours (``"none"``), or of a baseline."""
    return [row for row in rows if row.baseline == baseline]


def totals(rows: Sequence[Outcome]) -> dict[str, Any]:
    """What became of these sessions, ready for JSON; None where there is nothing to measure.

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
