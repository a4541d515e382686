"""Which step leads: the leader's own, or for comparison one that renders the delayed force."""

from __future__ import annotations

import importlib
from typing import Any, Protocol

from foretouch.devices import DeviceSpecification
from foretouch.session.settings import SessionSettings
from foretouch.session.steps import leader


class LeadingSide(Protocol):
    """What leads a session: a start and a step, as of `foretouch.session.steps.leader`."""

    def start(
        self,
        settings: SessionSettings,
        *,
        holder: str = "leader",
        epoch: int = 1,
        device: DeviceSpecification | None = None,
    ) -> Any:
        """State before the first tick."""

    def step(self, state: Any, inputs: leader.Inputs, now_ns: int) -> tuple[Any, leader.Outputs]:
        """One tick."""


def leading_side(settings: SessionSettings) -> LeadingSide:
    """The leader of a session; a baseline's is imported only where one is asked for."""
    if settings.baseline == "none":
        return leader
    module: LeadingSide = importlib.import_module("foretouch.session.steps.baseline")
    return module
