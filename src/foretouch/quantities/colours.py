"""Every colour, once: console, pages, figures and documentation draw the same thing in the same one.

Okabe and Ito's, which most colour-blind people can tell apart (Okabe and Ito (2008), Color Universal Design).
"""

from __future__ import annotations

Colour = tuple[int, int, int]

BLUE: Colour = (0, 114, 178)
VERMILLION: Colour = (213, 94, 0)
GREEN: Colour = (0, 158, 115)
SKY: Colour = (86, 180, 233)
ORANGE: Colour = (230, 159, 0)
PURPLE: Colour = (204, 121, 167)
INK: Colour = (0, 0, 0)
GREY: Colour = (92, 106, 120)  # colour of what is neither pressed nor urgent; of the robot while it does not follow
PREDICTED = BLUE  # the operator: handle, probe, predicted force
DELAYED = VERMILLION  # the delayed robot and its force
RENDERED = GREEN  # colour of the force on the hand, and of energy
TRUE = INK  # the true force
URGENT = VERMILLION  # the emergency stop, and whatever has to be known at once
WRONG = ORANGE  # colour on pages of what is wrong, forbidden or not believed
SURFACE: Colour = (240, 215, 190)  # the material from above
DENT: tuple[Colour, ...] = ((240, 215, 190), (222, 190, 160), (196, 156, 122), (160, 116, 84), (116, 78, 52))
"""The material from above, by how far it has sunk: lightness alone tells the steps apart."""
CUT: tuple[Colour, Colour] = ((226, 178, 148), (209, 156, 126))  # the material's layers in the cut


def css(colour: Colour) -> str:
    """The colour as a style sheet writes it."""
    return "#{:02x}{:02x}{:02x}".format(*colour)


def faint(colour: Colour, opacity: float = 0.25) -> str:
    """The colour as a style sheet writes it, through which one sees what is behind.

    Args:
        colour: Red, green, blue.
        opacity: Opacity.
    """
    return f"rgba({', '.join(map(str, colour))}, {opacity:g})"
