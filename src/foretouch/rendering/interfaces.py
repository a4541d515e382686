"""What rendering has to know of a device and of an account of its energy."""

from __future__ import annotations

from typing import Protocol, runtime_checkable

__all__ = ["AccountedDevice", "RenderingAccount", "RenderingDevice"]


class AccountedDevice(Protocol):
    """What an account has to know of the device that the hand holds."""

    @property
    def resolution(self) -> float:
        """One count of the encoder [m]."""

    @property
    def delay(self) -> float:
        """From reading a position until the force computed from it acts [s]."""

    @property
    def watchdog(self) -> float:
        """Time after which the device takes a force away by itself that nobody has renewed [s]; 0 for never."""


@runtime_checkable
class RenderingDevice(AccountedDevice, Protocol):
    """What rendering has to know of a device that the hand feels."""

    @property
    def damping(self) -> float:
        """B [N s/m]."""

    @property
    def force_limit(self) -> float:
        """[N]."""

    @property
    def stiffness_by_encoder(self) -> float:
        """What one count of the encoder allows [N/m], infinite without one."""

    def largest_stiffness(self, sample_period: float) -> float:
        """The stiffest spring that it renders passively at this period [s], by its damping and its encoder [N/m]."""


class RenderingAccount(Protocol):
    """What rendering has to know of the energy: `EnergyAccount`, or what it is in space (`NormalAccount`)."""

    @property
    def energy(self) -> float:
        """E [J]."""

    @property
    def late_energy(self) -> float:
        """L [J]."""

    @property
    def bound(self) -> float:
        """Of E [J]."""

    @property
    def ceiling(self) -> float:
        """Largest force that may be held now [N]."""

    def bound_with(self, force: float) -> float:
        """The bound [J] once this force [N] has been held."""

    def close(self) -> None:
        """Contact is lost."""

    def observe(self, position: float, period: float) -> None:
        """Book the work up to where the hand is now [m], this time [s] after the tick before."""

    def hold(self, force: float) -> None:
        """From now on this force acts [N]."""
