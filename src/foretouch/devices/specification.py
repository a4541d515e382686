"""What a force-feedback device is, and what it can render by that."""

from __future__ import annotations

import math
from dataclasses import dataclass

from foretouch.models.checks import require

__all__ = ["COUNT_FORCE", "LEAST_DAMPING", "LONGEST_DELAY", "DeviceSpecification"]

COUNT_FORCE = 0.1
"""One count of the encoder may change the force by so much [N] on a device without friction."""

LEAST_DAMPING = 0.1
"""What a device that a person feels is taken to have where nobody has stated it [N s/m]. No measurement of a product: a
twentieth of what the simulated device has, so that a stiffness that is rendered by it is small at first."""

LONGEST_DELAY = 1e-3
"""A tick [s]. A force that comes later than the next position is read belongs to a loop nearer to the device."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DeviceSpecification:
    r"""A force-feedback device along its one axis.

    `damping` is what the passivity condition counts: the damping that is there between the samples too, by the bearings
    or by an analogue loop of the drive (electrical damping, Mehling et al.). What a program makes of sampled positions
    is not part of it.

    It has no default: it decides how stiff a wall may be. `delay` is counted from the reading of a position until the
    force that is computed from it acts: the device's own way in and out, and the computing between (`foretouch doctor`
    measures that part). `watchdog` is the device's own: how long it goes on giving a force that nobody renews.

    The other defaults are a desktop device, not one product. Its force limit is of the order of Novint's
    Falcon (8 N) and of the SensAble Phantom (6 N), as the device files of CHAI3D give them, which also advise at most
    3000 and 1000 N/m for these; `largest_stiffness` gives 2000 N/m for 2 N s/m and 0.5 ms at 1 kHz. Inertia,
    friction and encoder count could not be checked against data sheets; 0.05 to 0.3 kg, 0.05 to 1 N and 1 to 60 um is
    what such devices span. Bare mechanisms have less viscous damping than 2 N s/m, which therefore asks for damping by
    the drive. Diolaiti et al. show that many devices work beyond the passivity condition thanks to their dry friction;
    here it is not relied on.

    Args:
        damping: b [N s/m], 0 to 1000.
        mass: Moving mass at the handle [kg], 0.001 to 10.
        friction: Coulomb friction [N], 0 to 100; stiction is as large.
        force_limit: Largest force [N] that it gives, above 0, at most 1000.
        resolution: One encoder count [m], 0 (none) to 0.001.
        delay: d [s], 0 to 0.001; without a value one tick, the longest.
        watchdog: [s], 0.002 to 10, or 0 for none.

    Raises:
        SettingError: A number out of range.

    References:
        Colgate and Schenkel (1997), Passivity of a class of sampled-data systems: application to haptic interfaces,
        Journal of Robotic Systems 14(1). Mehling, Colgate and Peshkin (2005), Increasing the impedance range of a
        haptic display by adding electrical damping, World Haptics Conference. Diolaiti, Niemeyer, Barbagli and
        Salisbury (2006), Stability of haptic rendering: discretization, quantization, time delay, and Coulomb effects,
        IEEE Transactions on Robotics 22(2). Abbott and Okamura (2005), Effects of position quantization and sampling
        rate on virtual-wall passivity, IEEE Transactions on Robotics 21(5).
    """

    damping: float
    mass: float = 0.1
    friction: float = 0.1
    force_limit: float = 10.0
    resolution: float = 1e-5
    delay: float = LONGEST_DELAY
    watchdog: float = 0.0

    def __post_init__(self) -> None:
        require("mass", self.mass, at_least=1e-3, at_most=10.0)
        require("damping", self.damping, at_least=0.0, at_most=1000.0)
        require("friction", self.friction, at_least=0.0, at_most=100.0)
        require("force_limit", self.force_limit, above=0.0, at_most=1000.0)
        require("resolution", self.resolution, at_least=0.0, at_most=1e-3)
        require("delay", self.delay, at_least=0.0, at_most=LONGEST_DELAY)
        if self.watchdog != 0.0:
            require("watchdog", self.watchdog, at_least=0.002, at_most=10.0)

    def largest_stiffness(self, sample_period: float, rendered_damping: float = 0.0) -> float:
        r"""The stiffest spring [N/m] that the device renders passively, whoever holds it.

        .. math:: K = \min\left(\frac{b - |B|}{T / 2 + d}, \frac{\max(2 f, 0.1\,\mathrm{N})}{\Delta}\right)

        The first for a force held from sample to sample and a velocity that is the difference of two positions
        (Colgate and Schenkel 1997: :math:`b > K T / 2 + |B|`; with a delay Diolaiti et al. 2006:
        :math:`b > K (T / 2 + d)`); 0 where the damping B alone is too much. The second for
        an encoder whose count :math:`\Delta` is not 0: up to 2 f per count the Coulomb friction f takes what rounding
        gives (Abbott and Okamura 2005); `COUNT_FORCE` per count is allowed whatever the friction.

        Args:
            sample_period: T [s], positive.
            rendered_damping: B [N s/m], of either sign.

        Raises:
            SettingError: `sample_period` not positive, or a damping that is no number.
        """
        require("sample_period", sample_period, above=0.0)
        require("rendered_damping", rendered_damping)
        by_damping = max((self.damping - abs(rendered_damping)) / (0.5 * sample_period + self.delay), 0.0)
        return min(by_damping, self.stiffness_by_encoder)

    @property
    def stiffness_by_encoder(self) -> float:
        """What the encoder alone would allow [N/m], infinite without one: see `largest_stiffness`."""
        return max(2.0 * self.friction, COUNT_FORCE) / self.resolution if self.resolution > 0.0 else math.inf
