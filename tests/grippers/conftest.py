"""What the tests of grippers share."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from servo_bus import LEVER, ServoBus

from apart import Apart


@pytest.fixture
def bus() -> Iterator[Any]:
    """A bus with an XL330-M288, in a process of its own."""
    pytest.importorskip("dynamixel_sdk")
    with Apart(ServoBus) as made:
        yield made


@pytest.fixture
def settings(bus: Any) -> Callable[..., SimpleNamespace]:
    """Settings of a session with that servo."""

    def made(options: str = f",lever={LEVER}", **others: object) -> SimpleNamespace:
        name = f"dynamixel@{bus.port}{options}"
        return SimpleNamespace(**{"robot": name, "operator": name, "scene": "", **others})

    return made
