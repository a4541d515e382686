"""Colours of the console: Okabe and Ito's, which most colour-blind people can tell apart.

Okabe and Ito (2008), Color Universal Design.
"""

from __future__ import annotations

__all__ = [
    "BLUE", "CUT", "DENT", "GREEN", "GREY", "INK", "ORANGE", "PURPLE", "SKY", "SURFACE", "VERMILLION", "css", "faint"
]  # fmt: skip

Colour = tuple[int, int, int]

BLUE: Colour = (0, 114, 178)
"""The operator: handle, probe, predicted force."""
VERMILLION: Colour = (213, 94, 0)
"""The delayed robot and its force; the emergency stop, and whatever has to be known at once."""
GREEN: Colour = (0, 158, 115)
"""What the hand is given; whatever belongs to energy."""
SKY: Colour = (86, 180, 233)
"""The predicted force of a second run."""
ORANGE: Colour = (230, 159, 0)
"""The delayed force of a second run."""
PURPLE: Colour = (204, 121, 167)
"""A fourth curve where three are not enough."""
INK: Colour = (0, 0, 0)
"""The true force."""
GREY: Colour = (92, 106, 120)
"""What is neither pressed nor urgent."""
SURFACE: Colour = (240, 215, 190)
"""The material from above."""
DENT: tuple[Colour, ...] = ((240, 215, 190), (222, 190, 160), (196, 156, 122), (160, 116, 84), (116, 78, 52))
"""The material from above, by how far it has sunk: lightness alone tells the steps apart."""
CUT: tuple[Colour, Colour] = ((226, 178, 148), (209, 156, 126))
"""The material's layers in the cut."""


def css(colour: Colour) -> str:
    """The colour as a style sheet writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def faint(colour: Colour, share: float = 0.25) -> str:
    """The colour as a style sheet writes it, through which one sees what is behind.

    Args:
        colour: Red, green, blue.
        share: Opacity.
    """
    return f"rgba({', '.join(map(str, colour))}, {share:g})"
