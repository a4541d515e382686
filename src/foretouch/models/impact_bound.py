"""How hard a driven probe can meet what nobody knows yet: a bound in closed form, with what it assumes."""

from __future__ import annotations

import math


def impact_impedance(stiffness: float, damping: float, mass: float, reaction: float) -> float:
    r"""Largest force of an impact for each m/s of its speed [N s/m].

    A probe meets a surface at a speed v. Assumed is

    1. of the material: while the probe goes deeper it is a spring beside a damper. The spring pushes with e(x), which
       is 0 at the surface, nowhere negative, and grows by at most K a metre, the damper with 0 to :math:`b \dot x`;
    2. of sensor and drive: until the time tau after the first touch the probe is no faster than v, however hard the
       drive pushes for that;
    3. of the drive from then on: no matter what it does, the work that it does on the probe of mass m is not positive.

    Then the contact force never exceeds Z v, until the probe first comes to rest, with

    .. math::
        Z = \begin{cases} b + K \tau & b \tau \ge m \\
        \sqrt{(K \tau^2 + m)(K + b^2 / m)} & \text{else} \end{cases}

    For until tau, :math:`x \le v \tau` and :math:`\dot x \le v`: the force is at most :math:`(b + K \tau) v`. From then
    on :math:`\tfrac12 m \dot x^2 + \int e\, dx` does not grow, nor does the speed, and :math:`e\, de \le K e\, dx`, so
    that e squared grows by at most 2 K times what the spring takes up: with :math:`\dot x = s v`, s from 0 to 1,

    .. math:: e + b \dot x \le v \Big(b s + \sqrt{(K \tau)^2 + m K (1 - s^2)}\Big)

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
