"""Packages of C for all processors, compiled once for all tests, whichever process runs them."""

from __future__ import annotations

import fcntl
import pickle
from pathlib import Path

import pytest
from packages import Packages

from foretouch.export import TARGETS, Lowered, lowered, write_package


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> dict[str, Lowered]:
    shared = tmp_path_factory.getbasetemp() if worker_id == "master" else tmp_path_factory.getbasetemp().parent
    with Path(shared, "lowered.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        kept = Path(shared, "lowered.pickle")
        if not kept.exists():
            kept.write_bytes(pickle.dumps(dict(zip(TARGETS, lowered(*TARGETS.values()), strict=True))))
        result: dict[str, Lowered] = pickle.loads(kept.read_bytes())
    return result


@pytest.fixture(scope="session")
def packages(made: dict[str, Lowered], tmp_path_factory: pytest.TempPathFactory) -> Packages:
    folder, result = tmp_path_factory.mktemp("export"), {}
    for name, target in TARGETS.items():
        result[name] = folder / name
        write_package(result[name], target, lambda target: [made[target.name]])
    return result


@pytest.fixture(scope="session")
def package(packages: Packages) -> Path:
    return packages["x86_64"]
