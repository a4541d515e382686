"""How a hand holds a device."""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType

from foretouch.models.checks import require

__all__ = ["GRIPS", "INTENDED_FORCE", "Grip"]

INTENDED_FORCE = 3.0
"""A hand that means to press with a force intends to be deeper, by so many newtons over the stiffness of its grip."""


@dataclass(frozen=True, slots=True)
class Grip:
    r"""A hand as a mass that a spring and a damper hold to where it wants to be.

    .. math:: F = k (x_d - x) + b (\dot x_d - \dot x)

    Args:
        mass: Of the hand that moves with the device [kg], 0 to 10.
        damping: b [N s/m], 0 to 1000.
        stiffness: k [N/m], 0 to 100,000.

    Raises:
        SettingError: A number out of range.
    """

    mass: float
    damping: float
    stiffness: float

    def __post_init__(self) -> None:
        require("mass", self.mass, at_least=0.0, at_most=10.0)
        require("damping", self.damping, at_least=0.0, at_most=1000.0)
        require("stiffness", self.stiffness, at_least=0.0, at_most=1e5)


GRIPS = MappingProxyType(
    {
        "soft": Grip(mass=0.10, damping=4.0, stiffness=150.0),
        "normal": Grip(mass=0.15, damping=8.0, stiffness=400.0),
        "stiff": Grip(mass=0.25, damping=18.0, stiffness=1000.0),
    }
)
"""Hands that hold a stylus loosely, as one works, and tightly.

The numbers are chosen within what was published, not taken from one table. What is known:

- A mass, a spring and a damper describe fingers and hands up to some 20 to 30 Hz; stiffness and damping rise steadily
  with the grip force, the inertia does not (Hasser and Cutkosky 2002, nine subjects). Fu and Cavusoglu (2012) fitted
  models that depend on the grip force to 15 subjects who held a stylus by 1 to 3 N; Speich, Shao and Goldfarb (2005)
  add a spring and a damper in series, and find that in some cases they gain little.
- One published fit for an arm that holds a handle is 0.554 kg, 6.45 N s/m and 135 N/m (van Beek et al. 2015, their
  figure 3): a damping ratio of 0.37. `GRIPS` have 0.52 to 0.57 without the device. A stylus moves less of the arm.
- Other ranges were not checked against the papers: a fingertip (Hajian and Howe 1997) some 200 to 1500 N/m, 1 to 10 N
  s/m and some grams; the wrist with a stylus (Kuchenbecker, Park and Niemeyer 2003) some 100 to 1000 N/m, rising with
  the grip; hand and forearm 0.05 to 1 kg. The three grips span 150 to 1000 N/m and 4 to 18 N s/m.

References:
    Hasser and Cutkosky (2002), System identification of the human hand grasping a haptic knob, Symposium on Haptic
    Interfaces for Virtual Environment and Teleoperator Systems. Fu and Cavusoglu (2012), Human-arm-and-hand-dynamic
    model with variability analyses for a stylus-based haptic interface, IEEE Transactions on Systems, Man, and
    Cybernetics B 42(6). Speich, Shao and Goldfarb (2005), Modeling the human hand as it interacts with a
    telemanipulation system, Mechatronics 15. van Beek, Bergmann Tiest, Mugge and Kappers (2015), Haptic perception
    of force magnitude and its relation to postural arm dynamics in 3D, Scientific Reports 5:18004. Hajian and Howe
    (1997), Identification of the mechanical impedance at the human finger tip, Journal of Biomechanical Engineering
    119(1). Kuchenbecker, Park and Niemeyer (2003), Characterizing the human wrist for improved haptic interaction,
    ASME International Mechanical Engineering Congress.
"""
