"""Files that others published: in a folder of the user's, in the user's cache, or at their origin, at one commit."""

from __future__ import annotations

import hashlib
import importlib
import logging
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from foretouch.errors import DatasetError, MissingExtraError

DATA_DIR: Final = "FORETOUCH_DATA_DIR"
"""Environment variable that names a folder which already has the files."""

HOST = "https://raw.githubusercontent.com"  # where the origins' files are served from
TIMEOUT = (5.0, 20.0)  # how long to wait for a connection, and for the next bytes of an answer [s]


@dataclass(frozen=True)
class Origin:
    """Where a set of files was published.

    Attributes:
        repository: GitHub repository.
        commit: The pinned commit.
        folder: Folder in the repository.
        local_folder: Folder that holds the files in `DATA_DIR` and in the cache.
        licence: Licence and its copyright line.
        about: What it is, in one sentence.
    """

    repository: str
    commit: str
    folder: str
    local_folder: str
    licence: str
    about: str


def address(origin: Origin, file: str) -> str:
    """Address of a file, by its path below the folder of its origin."""
    return f"{HOST}/" + quote(f"{origin.repository}/{origin.commit}/{origin.folder}/{file}")


def in_data_dir(below: str) -> Path | None:
    """A file of the folder that `DATA_DIR` names, there or in any folder below; None where it has none.

    Args:
        below: ``<folder of the origin>/<file>``.

    Raises:
        DatasetError: It names no folder.
    """
    root = os.environ.get(DATA_DIR)
    if not root:
        return None
    if not Path(root).is_dir():
        raise DatasetError(f"{DATA_DIR} = {root!r} is no folder: name the one that has the files, or unset it")
    direct = Path(root, below)
    return direct if direct.is_file() else next(iter(sorted(Path(root).rglob(below))), None)


def cache_of(origin: Origin, *, by_commit: bool = False) -> Path:
    """Folder of the user's cache for the files of an origin, made or not.

    Args:
        origin: Of the files.
        by_commit: Whether each commit has a folder of its own, for files without a checksum: none of another commit
            is taken for one of this.

    Raises:
        MissingExtraError: The package ``pooch`` is not installed.
    """
    above = Path(_pooch().os_cache("foretouch"))
    return (above / origin.commit if by_commit else above) / origin.local_folder


def fetch(origin: Origin, file: str, what: str, sha256: str | None = None) -> Path:
    """Path of a file in the cache, which is fetched from its origin if it is not there yet; never half of it.

    Args:
        origin: Where it was published.
        file: Its path there, below the folder.
        what: What it is, for the error.
        sha256: Its checksum. None where none is known: then its commit in the address and TLS are what there is to go
            by, and its place in the cache is one of that commit.

    Raises:
        DatasetError: It is not there and cannot be fetched, or what came has another checksum.
        MissingExtraError: The package ``pooch`` is not installed.
    """
    pooch = _pooch()
    pooch.get_logger().setLevel(logging.WARNING)
    path = cache_of(origin, by_commit=sha256 is None) / file
    try:
        return Path(
            pooch.retrieve(
                address(origin, file),
                known_hash=sha256 and f"sha256:{sha256}",
                path=path.parent,
                fname=path.name,
                downloader=pooch.HTTPDownloader(timeout=TIMEOUT),
            )
        )
    except (OSError, ValueError) as error:  # requests' errors are OSErrors; ValueError is a wrong checksum
        if (answer := getattr(error, "response", None)) is not None:
            answer.close()  # pooch leaves the connection of a refusal open
        raise DatasetError(
            f"{what} is not here and could not be fetched from {HOST} ({_cause(error)}): "
            f"connect to the network once, or set {DATA_DIR} to a folder that has {origin.local_folder}/"
        ) from None


def original(origin: Origin, here: str, there: str, what: str, sha256: str) -> Path:
    """Path of a file of that checksum: of the folder that `DATA_DIR` names, else from the cache or its origin.

    Args:
        origin: Where it was published.
        here: Its name in a folder of the user's.
        there: Its path at the origin, below the folder.
        what: What it is, for the error.
        sha256: Its checksum.

    Raises:
        DatasetError: The user's file is another, or there is none and it cannot be fetched.
        MissingExtraError: The package ``pooch`` is needed and not installed.
    """
    path = in_data_dir(f"{origin.local_folder}/{here}")
    if path is None:
        return fetch(origin, there, what, sha256)
    if hashlib.sha256(path.read_bytes()).hexdigest() != sha256:
        raise DatasetError(f"{path} is not {what}: its SHA-256 differs; remove it or fetch it again")
    return path


def _pooch() -> Any:
    try:
        return importlib.import_module("pooch")
    except ModuleNotFoundError:
        raise MissingExtraError("pooch", "recordings") from None


def _cause(error: Exception) -> str:
    if isinstance(error, ValueError):
        return "what came has another SHA-256"
    reason: Any = error
    while getattr(reason, "args", None) and isinstance(reason.args[0], Exception):
        reason = reason.args[0]
    text = " ".join(str(getattr(reason, "reason", None) or reason).split())
    return re.sub(r"^\w+\(.*?\): ", "", text)[:160]  # without the connection object
