"""How hard a driven probe can meet what nobody knows yet: a bound in closed form, with what it assumes."""

from __future__ import annotations

import math

__all__ = ["impact_impedance"]


def impact_impedance(stiffness: float, damping: float, mass: float, reaction: float) -> float:
    r"""Largest force of an impact for each m/s of its speed [N s/m].

    A probe meets a surface at a speed v. Assumed is

    1. of the material: its force is at most :math:`K x + b \dot x` at depth x while the probe goes deeper;
    2. of sensor and drive: until the time tau after the first touch the probe is no faster than v, however hard the
       drive pushes for that;
    3. of the drive from then on: no matter what it does, the work that it does on the probe of mass m is not positive.

    Then the contact force never exceeds Z v with

    .. math::
        Z = \begin{cases} b + K \tau & b \tau \ge m \\
        \sqrt{(K \tau^2 + m)(K + b^2 / m)} & \text{else} \end{cases}

    For until tau, :math:`x \le v \tau` and :math:`\dot x \le v`: the force is at most :math:`(b + K \tau) v`. From then
    on :math:`\tfrac12 m \dot x^2 + \tfrac12 K x^2` does not grow, for the drive gives nothing and the material takes at
    least what its spring would store, and the speed does not grow either: with :math:`\dot x = s v`, s from 0 to 1,

    .. math:: K x + b \dot x \le v \Big(b s + \sqrt{(K \tau)^2 + m K (1 - s^2)}\Big)

    whose largest value over s is at s = 1 where :math:`b \tau \ge m`, and else inside. For tau = 0 and b = 0 it is
    :math:`v \sqrt{m K}`, what the energies of a mass and a spring give.

    Args:
        stiffness: K [N/m], positive.
        damping: b [N s/m], not negative.
        mass: m [kg], positive.
        reaction: tau [s], not negative.
    """
    if damping * reaction >= mass:
        return damping + stiffness * reaction
    return math.sqrt((stiffness * reaction * reaction + mass) * (stiffness + damping * damping / mass))
