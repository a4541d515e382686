"""Texts of each side's `Hello` for the report (counters, and faults of arriving messages), and the operator's clock."""

from __future__ import annotations

from typing import Any

from foretouch.devices import Device, SpatialDevice
from foretouch.link import FaultStage, ZenohLink
from foretouch.messages import COUNT_PREFIX, SINCE
from foretouch.session.network.playout import Arrival
from foretouch.session.steps import follower, leader


def leader_counts(state: leader.State) -> dict[str, int]:
    """Messages sent by the leader, and lost, late or repeated ones of the follower."""
    return {
        "commands_sent": state.sequence,
        "models_lost": state.follower_view.models.lost,
        "models_late": state.follower_view.models.late,
        "models_copies": state.follower_view.models.copies,
        "models_refused": state.refused,
        "telemetry_lost": state.follower_view.telemetry.lost,
        "telemetry_late": state.follower_view.telemetry.late,
        "telemetry_copies": state.follower_view.telemetry.copies,
    }


def follower_counts(state: follower.State) -> dict[str, int]:
    """Messages sent by the follower, and lost, late, repeated or refused ones of the leader."""
    fresh = state.freshness
    return {
        "models_sent": state.sender.sequence,
        "telemetry_sent": state.tick,
        "commands_lost": state.commands.lost,
        "commands_late": state.commands.late,
        "commands_copies": state.commands.copies,
        "commands_stale": fresh.counts[Arrival.STALE],
        "commands_overtaken": fresh.counts[Arrival.OVERTAKEN],
        "commands_future": fresh.counts[Arrival.FUTURE],
        "commands_of_others": state.lease.refused,
        "commands_before_release": state.before_release,
        "step_failures": state.failures.count,
        "held_ticks": state.held_ticks,
        "faulty_ticks": state.faulty_ticks,
    }


def link_counts(role: str, link: ZenohLink) -> dict[str, int]:
    """Messages that a side's link could not take or send."""
    return {f"{role}_undecodable": link.undecodable, f"{role}_unsent": link.unsent}


def as_texts(counts: dict[str, int]) -> dict[str, str]:
    """Counters as texts of a `Hello`; the recorder tells them from settings by the prefix."""
    return {COUNT_PREFIX + name: str(value) for name, value in counts.items()}


def fault_texts(stage: FaultStage[Any], delay: str, changed_ns: int, prefix: str = "") -> dict[str, str]:
    """Faults that a side applies to arriving messages, as settings of its `Hello`; no other side knows them.

    `delay` names the setting of their delay, `changed_ns` is their last change by the side's own clock, 0 for never,
    and `prefix` stands before the other names: ``"return_"`` for those of models and telemetry.
    """
    faults = {f"{prefix}{name}": str(getattr(stage.faults, name)) for name in ("jitter", "loss", "outage")}
    return {delay: str(stage.delay)} | faults | ({SINCE: str(changed_ns)} if changed_ns else {})


class OperatorClock:
    """The clock that an operator is read by.

    A hand that holds a device waits, as a person would, until the follower's position is known. From then on its time
    runs, from zero. For an operator that feels nothing it is the session's own clock.
    """

    __slots__ = ("_begun_ns", "_waits")

    def __init__(self, operator: Device | SpatialDevice) -> None:
        self._waits = operator.closed_loop
        self._begun_ns = 0

    def read(self, now_ns: int, *, coupled: bool) -> int:
        """The operator's time [ns] at the session's [ns]; `coupled` says whether hand and follower have met."""
        if self._waits:
            self._begun_ns, self._waits = now_ns, not coupled
        return now_ns - self._begun_ns
