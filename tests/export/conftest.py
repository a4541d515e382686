"""Packages of C, of which each set of targets is compiled once for all tests, whichever process runs them."""

from __future__ import annotations

import fcntl
import pickle
from pathlib import Path

import pytest
from packages import Packages

from foretouch.export import TARGETS, Lowered, lowered, write_package


def lowered_once(name: str, targets: list[str], temporary: pytest.TempPathFactory, worker: str) -> dict[str, Lowered]:
    shared = temporary.getbasetemp() if worker == "master" else temporary.getbasetemp().parent
    with Path(shared, f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        kept = Path(shared, f"{name}.pickle")
        if not kept.exists():
            made = lowered(*(TARGETS[target] for target in targets))
            kept.write_bytes(pickle.dumps(dict(zip(targets, made, strict=True))))
        result: dict[str, Lowered] = pickle.loads(kept.read_bytes())
    return result


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> dict[str, Lowered]:
    return lowered_once("all", list(TARGETS), tmp_path_factory, worker_id)


@pytest.fixture(scope="session")
def packages(made: dict[str, Lowered], tmp_path_factory: pytest.TempPathFactory) -> Packages:
    folder, result = tmp_path_factory.mktemp("export"), {}
    for name, target in TARGETS.items():
        result[name] = folder / name
        write_package(result[name], target, lambda target: [made[target.name]])
    return result


@pytest.fixture(scope="session")
def package(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> Path:
    """That of x86_64, which is compiled for itself: most tests need no other."""
    made = lowered_once("x86_64", ["x86_64"], tmp_path_factory, worker_id)
    folder = tmp_path_factory.mktemp("export") / "x86_64"
    write_package(folder, TARGETS["x86_64"], lambda target: [made[target.name]])
    return folder
