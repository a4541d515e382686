"""Network faults of our own, seeded: what each does, and its range. `FaultStage` applies them, for both runners."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

from foretouch.errors import SettingError

__all__ = ["LONGEST_BURST", "LONGEST_DELAY", "SPELL_SPACING", "Faults"]

LONGEST_DELAY = 10.0
"""Delays beyond this [s] are refused: they are in other units."""

SPELL_SPACING = 10.0
"""One outage and one stall begin at seeded moments within every so many seconds."""

LONGEST_BURST = 10_000.0
"""Longest mean burst of losses [messages]: 10 s at 1 kHz. What lasts longer is an outage."""


@dataclass(frozen=True, slots=True)
class Faults:
    r"""What one direction of the network does to messages.

    Losses come in bursts by the model of Gilbert (1960) and Elliott (1963), with a good state that loses nothing and a
    bad state that loses everything. Before each message the state changes from good to bad with probability
    :math:`p`, and from bad to good with probability :math:`r`. Bursts are then :math:`1/r` messages long on average,
    and :math:`p/(p + r)` of all messages are lost, so that

    .. math:: r = 1/\mathtt{burst}, \qquad p = \frac{\mathtt{loss}}{(1 - \mathtt{loss})\,\mathtt{burst}}.

    A probability cannot exceed 1, so `loss` is at most `burst / (1 + burst)`: at least one message arrives between two
    bursts. Independent losses are the case :math:`p + r = 1`, whose bursts are `1 / (1 - loss)` messages long; `burst`
    of exactly 1 means them too, at any share. Longer bursts than theirs cluster, shorter ones spread out.

    Args:
        delay: One-way delay [s], 0 to 10.
        jitter: Largest change of the delay, to either side, uniformly distributed and drawn for each message [s];
            messages may overtake each other. The delay never falls below 0.
        loss: Mean share of messages lost, 0 to 1.
        outage: Length of an outage [s], 0 to 10; one begins at a random moment of every 10 s, and what is sent
            meanwhile is lost.
        burst: Mean length of a burst of losses [messages], 1 to 10,000; 1: each message is lost independently.
        reorder: Share of messages, 0 to 1, that are held back by further 5 to 50 ms, uniformly distributed, so that 5
            to 50 later ones of a stream at 1 kHz overtake them.
        duplicate: Share of messages, 0 to 1, that come twice, the copy 1 to 20 ms after the first, uniformly
            distributed.
        stall: Length of a stall [s], 0 to 10; one begins at a random moment of every 10 s. Nothing arrives in it: what
            would have is held, and released together at its end in the order in which it was sent. TCP and TLS lose
            packets so: nothing is lost, and all of it is late at once.
        seed: Of the random draws.

    Raises:
        SettingError: A value out of range, or more loss than bursts of this length can make.

    References:
        E. N. Gilbert, "Capacity of a burst-noise channel", Bell System Technical Journal 39(5), 1960, 1253-1265.
        E. O. Elliott, "Estimates of error rates for codes on burst-noise channels", Bell System Technical Journal
        42(5), 1963, 1977-1997.
    """

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    burst: float = 1.0
    reorder: float = 0.0
    duplicate: float = 0.0
    stall: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        lengths = {"delay": LONGEST_DELAY, "jitter": LONGEST_DELAY, "outage": SPELL_SPACING, "stall": SPELL_SPACING}
        for name, largest in lengths.items():
            value = getattr(self, name)
            if not 0.0 <= value <= largest:
                raise SettingError(name, value, f"must lie between 0 and {largest:g} s")
        for name in ("loss", "reorder", "duplicate"):
            value = getattr(self, name)
            if not 0.0 <= value <= 1.0:
                raise SettingError(name, value, "is a share and must lie between 0 and 1")
        if not 1.0 <= self.burst <= LONGEST_BURST:
            raise SettingError("burst", self.burst, f"must lie between 1 and {LONGEST_BURST:g} messages")
        most = self.most_loss
        if self.loss > most:
            # Rounded down, so that the value we name works.
            raise SettingError(
                "loss",
                self.loss,
                f"with burst = {self.burst:g} must not exceed burst / (1 + burst), because a message arrives between "
                f"two bursts: take at most {math.floor(most * 1000) / 1000:g}, or burst = 1 for independent losses",
            )

    @property
    def most_loss(self) -> float:
        """Largest share of losses that bursts of this length can make."""
        return 1.0 if self.burst == 1.0 else self.burst / (1.0 + self.burst)

    def changed(self, *, delay: float, jitter: float, loss: float, outage: float) -> Faults:
        """These faults with four others in their place, each held within its range; one that is no number is 0.

        Args:
            delay: [s].
            jitter: [s].
            loss: A share.
            outage: [s].
        """
        return dataclasses.replace(
            self,
            delay=_within(delay, LONGEST_DELAY),
            jitter=_within(jitter, LONGEST_DELAY),
            loss=_within(loss, self.most_loss),
            outage=_within(outage, SPELL_SPACING),
        )

    @property
    def loss_transitions(self) -> tuple[float, float]:
        """Probabilities of losing a message after one that arrived, `p`, and after one that was lost, `1 - r`."""
        if self.burst == 1.0 or self.loss == 0.0:
            return self.loss, self.loss
        return min(1.0, self.loss / ((1.0 - self.loss) * self.burst)), 1.0 - 1.0 / self.burst


def _within(value: float, largest: float) -> float:
    return min(max(value, 0.0), largest) if math.isfinite(value) else 0.0
