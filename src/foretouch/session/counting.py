"""What each side counted, by name, for the report."""

from __future__ import annotations

from foretouch.session import follower, leader

__all__ = ["follower_counts", "leader_counts"]


def leader_counts(state: leader.State) -> dict[str, int]:
    """Messages sent by the leader, and what it missed of the follower's."""
    return {
        "commands_sent": state.sequence,
        "models_lost": state.models.lost,
        "models_late": state.models.late,
        "models_copies": state.models.copies,
        "models_refused": state.refused,
        "telemetry_lost": state.telemetry.lost,
        "telemetry_late": state.telemetry.late,
        "telemetry_copies": state.telemetry.copies,
    }


def follower_counts(state: follower.State) -> dict[str, int]:
    """Messages sent by the follower, and what it missed of the leader's."""
    return {
        "models_sent": state.model_sequence,
        "telemetry_sent": state.tick,
        "commands_lost": state.commands.lost,
        "commands_late": state.commands.late,
        "commands_copies": state.commands.copies,
    }
