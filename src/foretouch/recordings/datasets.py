"""Serves the measured recordings: from a folder that has them, from the user's cache, or from their public origin.

The files stay out of the package. Every one is checked against its SHA-256 before it is handed out, and every one is
taken from its origin at one pinned commit.

Names say the origin and what tells a file from the others, and do not change: ``tue/<letter>-<what>``, with the
experiment's own letters (a to c position-position control, d to f position-force control) and the material as its file
calls it; ``aurora/<force>-mN``, with the force that the motor was told to reach.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from urllib.parse import quote

from foretouch.errors import DatasetError, UnknownNameError
from foretouch.recordings._extra import optional

__all__ = ["DATASETS", "DATA_DIR", "Dataset", "Origin", "fetch", "fetch_all", "list_datasets"]

DATA_DIR: Final = "FORETOUCH_DATA_DIR"
"""Environment variable that names a folder which already has the files."""

HOST = "https://raw.githubusercontent.com"
"""Where the origins' files are served from."""

TIMEOUT = (5.0, 20.0)
"""How long to wait for a connection, and for the next bytes of an answer [s]."""


@dataclass(frozen=True)
class Origin:
    """Where a set of files was published.

    Attributes:
        repository: GitHub repository.
        commit: The pinned commit.
        folder: Folder in the repository.
        local_folder: Folder that holds the files in `DATA_DIR` and in the cache.
        licence: Licence and its copyright line.
        about: What was measured, in one sentence.
    """

    repository: str
    commit: str
    folder: str
    local_folder: str
    licence: str
    about: str


@dataclass(frozen=True)
class Dataset:
    """One measured file.

    Attributes:
        name: Its name here: origin, and what tells it from the others.
        origin: Where it was published.
        file: Its file name there and here.
        kind: What is touched: ``"foam"``, ``"spring"``, ``"rigid"``, ``"free"`` (nothing) or ``"skin"``.
        sha256: Checksum of the file.
    """

    name: str
    origin: Origin
    file: str
    kind: str
    sha256: str

    @property
    def url(self) -> str:
        """Address of the file at its origin."""
        origin = self.origin
        return f"{HOST}/" + quote(f"{origin.repository}/{origin.commit}/{origin.folder}/{self.file}")


_TUE = Origin(
    repository="Ohara124c41/Haptics-Bilateral_Teleoperation-1DOF_Experiments",
    commit="2ae23ed4f6e6b9726be4153a1f094085124c0c57",
    folder="m2_question1",
    local_folder="tue_1dof_teleoperation",
    licence="MIT, Copyright (c) 2018 Christopher Ohara",
    about="a hand moves a leader lever, a follower lever presses a material; 2 kHz, TU/e 2018",
)
_AURORA = Origin(
    repository="SDAMcIntyre/Indentation_Discrimination",
    commit="da51ad73f586d8d51f46b2d2230aa79e17a963b7",
    folder="Emma protocols/22-01-18",
    local_folder="aurora_skin_indentation",
    licence="MIT, Copyright (c) 2021 S McIntyre",
    about="a motor presses skin to a target force, holds and releases; 2 kHz",
)

DATASETS: Final[dict[str, Dataset]] = {
    name: Dataset(name, origin, file, kind, sha256)
    for name, origin, file, kind, sha256 in (
        (
            "tue/a-foam",
            _TUE,
            "m2_question1a_foam.mat",
            "foam",
            "694b3da7c0a1f2dcb476a1ecdc53a8b710e5e8006446237027cd131151ef6cea",
        ),
        (
            "tue/a-free-motion",
            _TUE,
            "m2_question1a_free_motion.mat",
            "free",
            "8c4747090b6c08e28171703044114a1ebe031e92f2995eaf399a6d0d0fbf832c",
        ),
        (
            "tue/a-rigid",
            _TUE,
            "m2_question1a_rigid.mat",
            "rigid",
            "426f3eadfc03f422dd87a7313f768d54a3ddb59e03bb2bf0c82fccdc7119828b",
        ),
        (
            "tue/a-spring",
            _TUE,
            "m2_question1a_spring.mat",
            "spring",
            "6b6678527130abcef137e5b10a6581e1e5750f38e69c96a06f4402cb113e47d5",
        ),
        (
            "tue/b-foam",
            _TUE,
            "m2_question1b_foam.mat",
            "foam",
            "e3b6a019b1ba4479529f85e31739683cf0fd290ce458efec2da96de3c1fe5c94",
        ),
        (
            "tue/b-foam3",
            _TUE,
            "m2_question1b_foam3.mat",
            "foam",
            "719d4741ec2706820c6ca47ffeab8758d7f353fce2708f6cd5c6804b9f823b2a",
        ),
        (
            "tue/d-foam2",
            _TUE,
            "m2_question1d_foam2.mat",
            "foam",
            "e8b82634da7a92986af52757beef65dfc557c35e28c626c6f6553e782dc796bc",
        ),
        (
            "tue/d-spring",
            _TUE,
            "m2_question1d_spring.mat",
            "spring",
            "deab6c251c4261466fe80f76e2f1625a701d57f319cd0498b3e0cc9f143e18e5",
        ),
        (
            "tue/e-foam2",
            _TUE,
            "m2_question1e_foam2.mat",
            "foam",
            "0963c99f5867719cda839c232a41f5de6d469502119f5544bb108a8d597bcfbd",
        ),
        (
            "aurora/100-mN",
            _AURORA,
            "100 mN data file.ddf",
            "skin",
            "93e36f7bca06c6102e984a97c706b78f09b63473cf80ddd02fb6ab0b676e6b3e",
        ),
        (
            "aurora/400-mN",
            _AURORA,
            "400 mN data file.ddf",
            "skin",
            "b184995debf996abb6d9e2d298d2949f0f951e97ab8ff0be4577aa59e3b51177",
        ),
        (
            "aurora/600-mN",
            _AURORA,
            "600 mN data file.ddf",
            "skin",
            "58d5a2791197eb0edeee6b8fa037fc43d2f387738db12f9b04be44c7a3ada037",
        ),
        (
            "aurora/1000-mN",
            _AURORA,
            "1000 mN data file.ddf",
            "skin",
            "0bccf24822a9b53d0bacff1adc7f99124facfb6295409c5655b9057864816086",
        ),
    )
}
"""The measured files by name."""


def list_datasets(kind: str | None = None) -> list[Dataset]:
    """All measured files, or those of one kind, in a fixed order.

    Raises:
        UnknownNameError: There is no such kind.
    """
    kinds = {dataset.kind for dataset in DATASETS.values()}
    if kind is not None and kind not in kinds:
        raise UnknownNameError("kind of dataset", kind, kinds)
    return [dataset for dataset in DATASETS.values() if kind in (None, dataset.kind)]


def fetch(name: str) -> Path:
    """Path of a measured file, fetched from its origin if it is not here yet.

    Looked for in the folder that ``FORETOUCH_DATA_DIR`` names (there or in any folder below, as
    ``<folder of the origin>/<file>``), then in the user's cache, then at the origin.

    Args:
        name: One of `DATASETS`.

    Raises:
        UnknownNameError: There is no such file.
        DatasetError: The file is another than it should be, or is not here and cannot be fetched.
        MissingExtraError: The package ``pooch`` is needed and not installed.
    """
    if name not in DATASETS:
        raise UnknownNameError("dataset", name, DATASETS)
    dataset = DATASETS[name]
    return _in_data_dir(dataset) or _through_pooch(dataset)


def fetch_all(kind: str | None = None) -> list[Path]:
    """Paths of all measured files, or of those of one kind, in the order of `list_datasets`.

    Raises:
        UnknownNameError: There is no such kind.
        DatasetError: As `fetch`.
    """
    return [fetch(dataset.name) for dataset in list_datasets(kind)]


def _in_data_dir(dataset: Dataset) -> Path | None:
    root = os.environ.get(DATA_DIR)
    if not root:
        return None
    if not Path(root).is_dir():
        raise DatasetError(f"{DATA_DIR} = {root!r} is no folder: name the one that has the recordings, or unset it")
    below = f"{dataset.origin.local_folder}/{dataset.file}"
    direct = Path(root, below)
    path = direct if direct.is_file() else next(iter(sorted(Path(root).rglob(below))), None)
    if path is not None and hashlib.sha256(path.read_bytes()).hexdigest() != dataset.sha256:
        raise DatasetError(f"{path} is not {dataset.name}: its SHA-256 differs; remove it or fetch it again")
    return path


def _through_pooch(dataset: Dataset) -> Path:
    pooch = optional("pooch")
    pooch.get_logger().setLevel(logging.WARNING)
    try:
        return Path(
            pooch.retrieve(
                dataset.url,
                known_hash=f"sha256:{dataset.sha256}",
                path=pooch.os_cache("foretouch") / dataset.origin.local_folder,
                fname=dataset.file,
                downloader=pooch.HTTPDownloader(timeout=TIMEOUT),
            )
        )
    except (OSError, ValueError) as error:  # requests' errors are OSErrors; ValueError is a wrong checksum
        raise DatasetError(
            f"{dataset.name} is not here and could not be fetched from {HOST} ({_cause(error)}): connect to "
            f"the network once, or set {DATA_DIR} to a folder that has {dataset.origin.local_folder}/"
        ) from None


def _cause(error: Exception) -> str:
    if isinstance(error, ValueError):
        return "what came has another SHA-256"
    reason: Any = error
    while getattr(reason, "args", None) and isinstance(reason.args[0], Exception):
        reason = reason.args[0]
    text = " ".join(str(getattr(reason, "reason", None) or reason).split())
    return re.sub(r"^\w+\(.*?\): ", "", text)[:160]  # without the connection object
