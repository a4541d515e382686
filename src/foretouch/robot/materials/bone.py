"""Bare bone: the stress case."""

from __future__ import annotations

from dataclasses import dataclass

from foretouch.models.checks import require
from foretouch.robot.materials.material import Material
from foretouch.robot.materials.relaxing_contact import ElasticResponse, RelaxingContact

__all__ = ["LinearResponse", "bone"]


@dataclass(frozen=True, slots=True)
class LinearResponse(ElasticResponse):
    """A linear spring: E(y) = K y.

    Args:
        stiffness: K [N/m], positive.

    Raises:
        SettingError: A number out of range.
    """

    stiffness: float

    def __post_init__(self) -> None:
        require("stiffness", self.stiffness, above=0.0)

    def force(self, deflection: float) -> float:
        """E(y) [N]: see `ElasticResponse`."""
        return self.stiffness * deflection


def bone() -> Material:
    """Bone with nothing on it, as a standard linear solid: 75 N/mm pressed slowly, 107 N/mm when struck.

    75 N/mm is what ISO/TS 15066 gives for hand and fingers, and 150 N/mm for the stiffest region of the body, the
    skull: bone and what carries it. The contact itself is stiffer: by Hertz's formula a tip of 6 mm radius at 15 N
    on 15 GPa (indentation of cortical bone: 7 to 25 GPa) meets 5,000 N/mm, more than any hand passes on.
    The loss (three tenths within 2 ms) is chosen: that of the joints and flesh behind the bone, of which we know no
    measurement, by what the simulated arm can hold. It presses stably to its force limit of 15 N here; on a spring
    of 75 N/mm that loses almost nothing it chatters at the limit, because its force sensor is 1.3 ms late. Up to
    50 N/mm it needs no loss.

    The impact peak is what it is: moved mass and speed against the spring, 24 N at 0.1 m/s and 49 N at 0.3 m/s. The
    scripted hand asks for 0.5 mm, which is beyond the follower's 15 N: what ends every press is the force limit.
    """
    return Material(
        name="bone",
        description="bare bone: 75 N/mm, the stress case; the force limit ends every press",
        provenance="stiffness: ISO/TS 15066 (2016), annex A, hand and fingers, 75 N/mm; modulus of cortical bone: "
        "Zysset et al. (1999), J. Biomech. 32, 1005-1012; loss chosen so that the arm can press it",
        model=RelaxingContact(elastic=LinearResponse(75e3 / 0.7), relaxation=((0.3, 0.002),)),
        press_depth=0.0005,
    )
