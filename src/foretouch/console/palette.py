"""Colours of the console: Okabe and Ito's, which most colour-blind people can tell apart.

Okabe and Ito (2008), Color Universal Design.
"""

from __future__ import annotations

__all__ = ["BLUE", "CUT", "GREY", "INK", "SURFACE", "VERMILLION", "css"]

Colour = tuple[int, int, int]

BLUE: Colour = (0, 114, 178)
"""The operator: handle, probe, predicted force."""
VERMILLION: Colour = (213, 94, 0)
"""The delayed robot and its force; the emergency stop, and whatever has to be known at once."""
INK: Colour = (0, 0, 0)
"""The true force."""
GREY: Colour = (92, 106, 120)
"""What is neither pressed nor urgent."""
SURFACE: Colour = (240, 215, 190)
"""The material from above."""
CUT: tuple[Colour, Colour] = ((226, 178, 148), (209, 156, 126))
"""The material's layers in the cut."""


def css(colour: Colour) -> str:
    """The colour as a style sheet writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)
