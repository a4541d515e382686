"""The settings of a session: frozen, checked, the same for both runners and both sides."""

from __future__ import annotations

from dataclasses import dataclass, field

from foretouch.devices import OPERATORS
from foretouch.errors import UnknownNameError
from foretouch.identification import DEFAULT_ESTIMATORS, Estimator, make_estimator
from foretouch.link import Faults
from foretouch.models.checks import require

__all__ = ["SAMPLE_PERIOD", "SessionSettings"]

SAMPLE_PERIOD = 1e-3
"""Of both loops [s]."""


@dataclass(frozen=True)
class SessionSettings:
    """What is pressed, by whom, over which network, and what is identified.

    The defaults of the delays are the paper's: 80 ms for positions, 300 ms for forces. The law is not: it is
    the contact map; the paper's own law and estimator are ``model="continuous-switching"``.

    Args:
        material: Name of a material of the simulated robot.
        operator: ``"scripted"``, ``"recorded"`` or ``"browser"``.
        model: Name of the law to identify.
        estimator: Name of the estimator; empty for the law's own, whose name then stands here.
        position_delay: One-way delay of commands [s].
        force_delay: One-way delay of models and telemetry [s].
        jitter: Largest change of either delay [s].
        loss: Share of messages lost, in either direction.
        outage: Length of an outage in every 10 s, in either direction [s].
        seed: Of everything random: sensors, operator, network; not negative.
        model_rate: Models a second while nothing changes [1/s].

    Raises:
        SettingError: A value out of range.
        UnknownNameError: An operator, law or estimator that does not exist.
    """

    material: str = "foam-measured"
    operator: str = "scripted"
    model: str = "contact-map"
    estimator: str = ""
    position_delay: float = 0.08
    force_delay: float = 0.3
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    seed: int = 0
    model_rate: float = 50.0
    command_faults: Faults = field(init=False, repr=False)
    return_faults: Faults = field(init=False, repr=False)

    def __post_init__(self) -> None:
        if self.operator not in OPERATORS:
            raise UnknownNameError("operator", self.operator, OPERATORS)
        if not self.estimator:
            object.__setattr__(self, "estimator", DEFAULT_ESTIMATORS.get(self.model, ""))
        make_estimator(self.model, self.estimator)
        require("position_delay", self.position_delay, at_least=0.0)
        require("force_delay", self.force_delay, at_least=0.0)
        require("seed", self.seed, at_least=0)
        require("model_rate", self.model_rate, above=0.0, at_most=1.0 / SAMPLE_PERIOD)
        common = (self.jitter, self.loss, self.outage)
        object.__setattr__(self, "command_faults", Faults(self.position_delay, *common, seed=2 * self.seed))
        object.__setattr__(self, "return_faults", Faults(self.force_delay, *common, seed=2 * self.seed + 1))

    def make_estimator(self) -> Estimator:
        """A fresh estimator."""
        return make_estimator(self.model, self.estimator)

    def as_text(self) -> dict[str, str]:
        """The settings by name, for `Hello` messages and recordings."""
        names = (
            "material",
            "operator",
            "model",
            "estimator",
            "position_delay",
            "force_delay",
            "jitter",
            "loss",
            "outage",
            "seed",
            "model_rate",
        )
        return {name: str(getattr(self, name)) for name in names}
