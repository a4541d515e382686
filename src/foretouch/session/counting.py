"""What each side counted, by name, for the report."""

from __future__ import annotations

from foretouch.link import ZenohLink
from foretouch.messages import COUNT_PREFIX
from foretouch.session import follower, leader
from foretouch.session.freshness import Arrival

__all__ = ["as_texts", "follower_counts", "leader_counts", "link_counts"]


def leader_counts(state: leader.State) -> dict[str, int]:
    """Messages sent by the leader, and what it missed of the follower's."""
    return {
        "commands_sent": state.sequence,
        "models_lost": state.heard.models.lost,
        "models_late": state.heard.models.late,
        "models_copies": state.heard.models.copies,
        "models_refused": state.refused,
        "telemetry_lost": state.heard.telemetry.lost,
        "telemetry_late": state.heard.telemetry.late,
        "telemetry_copies": state.heard.telemetry.copies,
    }


def follower_counts(state: follower.State) -> dict[str, int]:
    """Messages sent by the follower, and what it missed of the leader's, or refused."""
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
