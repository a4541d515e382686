"""What tests of recordings share: their files are read in the process of the tests, but for those that say otherwise.

That a reader has a process and limits of its own is proven by the tests of `foretouch.files`, by those of the commands
and by the attack on files; here a copy of a process for each of a thousand small files would cost more than all else.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest


@pytest.fixture(autouse=True, scope="module")
def _here() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("FORETOUCH_FILE_BUDGET", "inf")
        yield


@pytest.fixture
def read_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are read as always: in a process of its own, within limits."""
    monkeypatch.delenv("FORETOUCH_FILE_BUDGET")
