"""What all tests share: reproducible property tests, the measured recordings, and their originals where they are."""

from __future__ import annotations

import functools
import gc
import os
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Thread

import pytest
import typer.testing
from hypothesis import settings

# One thread for linear algebra, as the commands have it: more take longer over small matrices, beside others at least.
with pytest.MonkeyPatch.context() as alone:
    for pool in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
        alone.setenv(pool, os.environ.get(pool, "1"))
    import scipy.linalg  # noqa: F401  # it has a library of its own, and NumPy another

# Typer makes all commands anew for each call of its runner: 60 ms, hundreds of times.
typer.testing._get_command = functools.cache(typer.testing._get_command)  # type: ignore[attr-defined]

settings.register_profile("foretouch", derandomize=True, deadline=None, max_examples=30)
settings.load_profile("foretouch")

# With all that is imported here each full collection takes a quarter of a second: a seventh of all time.
gc.set_threshold(200_000, 20, 100)


def pytest_collection_finish(session: pytest.Session) -> None:
    """What is imported and collected by now stays until the end: no collection need look at it again."""
    gc.collect()
    gc.freeze()
    # What runs in real time would wait for the compiler, where sources have changed since the last set-up.
    if any(item.get_closest_marker("live") for item in session.items) and not session.config.option.collectonly:
        from foretouch.session.runners.warm_up import compile_all

        compile_all()


REAL_TIME = ("live", "network", "browser")
"""Tests with these marks run processes in real time. A shared machine may stand still for a second, which no deadline
survives: what fails is tried once more, and named at the end of the run; what fails twice is a failure."""


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Allow one more try where the machine has a part in the outcome; all cases of a `first` but one are long."""
    begun = set()
    for item in items:
        if any(item.get_closest_marker(name) for name in REAL_TIME):
            item.add_marker(pytest.mark.flaky(reruns=1))
        if item.get_closest_marker("first"):
            test = item.nodeid.partition("[")[0]
            if test in begun:
                item.add_marker(pytest.mark.long)
            begun.add(test)


BESIDE = Path(__file__).resolve().parents[2] / "shared" / "datasets"
if "FORETOUCH_DATA_DIR" not in os.environ and BESIDE.is_dir():
    os.environ["FORETOUCH_DATA_DIR"] = str(BESIDE)  # processes that tests start see it too


@pytest.fixture
def read_here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Files are read in the test's own process, without limits: it looks inside a reader, or changes one."""
    monkeypatch.setenv("FORETOUCH_FILE_BUDGET", "inf")


@pytest.fixture(scope="session")
def measured() -> Callable[[str], Path]:
    """Path of the excerpt of a measured recording by its name in `foretouch.recordings.DATASETS`."""
    from foretouch.recordings import excerpt

    return excerpt


@pytest.fixture
def original(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], Path]:
    """Path of the original, where it is in the data folder or in the cache; nothing is downloaded for a test."""
    from foretouch.errors import DatasetError
    from foretouch.files import origins
    from foretouch.recordings import fetch_dataset

    def path_of(name: str) -> Path:
        with monkeypatch.context() as offline:
            offline.setattr(origins, "HOST", "http://127.0.0.1:9")  # nobody listens there
            offline.setenv("NO_PROXY", "127.0.0.1")
            try:
                return fetch_dataset(name)
            except DatasetError as error:
                if "SHA-256" in str(error):
                    raise  # a wrong file is a failure, not an absence
        pytest.skip("the originals are not here: FORETOUCH_DATA_DIR, or `foretouch datasets fetch all`")

    return path_of


@pytest.fixture
def measured_network(monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """The name of a measured network, whose file is in the data folder, beside it, or in the cache."""
    from foretouch.link import PUBLISHED_NETWORKS

    if (BESIDE.parent / "networks").is_dir():
        monkeypatch.setenv("FORETOUCH_DATA_DIR", str(BESIDE.parent))

    def name_of(name: str) -> str:
        if not PUBLISHED_NETWORKS[name].here:
            pytest.skip(f"{name} is not here: FORETOUCH_DATA_DIR, or `foretouch network show {name}`")
        return name

    return name_of


@pytest.fixture
def elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """No data folder, an empty cache, no network, and no proxy between us and the loopback."""
    from foretouch.files import origins

    monkeypatch.delenv(origins.DATA_DIR, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setattr(origins, "HOST", "http://127.0.0.1:9")  # nobody listens there
    return tmp_path


class Published(SimpleHTTPRequestHandler):
    """Serves a folder; of a file with ``cut_short`` in its name it sends half."""

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def copyfile(self, source: object, outputfile: object) -> None:
        """Send the file, of which the header has said how long it is."""
        content = source.read()  # type: ignore[attr-defined]
        outputfile.write(content[: len(content) // 2] if "cut_short" in self.path else content)  # type: ignore[attr-defined]


@pytest.fixture
def www(elsewhere: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A folder that is served where the origins of files are."""
    from foretouch.files import origins

    folder = elsewhere / "www"
    folder.mkdir()
    server = ThreadingHTTPServer(("127.0.0.1", 0), partial(Published, directory=str(folder)))
    thread = Thread(target=server.serve_forever, args=(0.02,), daemon=True)
    thread.start()
    monkeypatch.setattr(origins, "HOST", f"http://127.0.0.1:{server.server_port}")
    yield folder
    server.shutdown()
    server.server_close()
    thread.join()
