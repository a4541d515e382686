"""What tests of sessions share."""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="module")
def _loads_as_it_goes() -> Iterator[None]:
    """A simulated clock waits for compiled code to be loaded: no press that exists nowhere goes before each session."""
    with pytest.MonkeyPatch.context() as patch:
        for module in ("foretouch.session.simulated", "foretouch.session.spatial.simulated"):
            patch.setattr(f"{module}.warm_up", lambda _: None)
        yield
