"""What tests on a graph share: a router, and a node of another implementation on it."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from ros2_node import OtherNode, other_node
from ros2_router import Router, router


@pytest.fixture
def hub() -> Iterator[Router]:
    """A router."""
    with router() as opened:
        yield opened


@pytest.fixture
def node(hub: Router, request: pytest.FixtureRequest) -> Iterator[OtherNode]:
    """The node that a module names by `NODE`: an arm, or a hand's device."""
    with other_node(request.module.NODE, hub.endpoint) as running:
        yield running
