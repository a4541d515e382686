"""Rendering: from a predicted force to the one that a hand is given."""

from foretouch.rendering.limits import LARGEST_FORCE, LARGEST_FORCE_RATE, ForceLimiter

__all__ = ["LARGEST_FORCE", "LARGEST_FORCE_RATE", "ForceLimiter"]
