"""The measured recordings: excerpts that the package carries, and the originals that they were made from.

`excerpt` gives the path of an excerpt, with time, position and force as the sensors counted them, read by everything
here. `fetch_dataset` gives that of the whole original: from a folder that has it, from the user's
cache, or from its public origin at one pinned commit, and checked against its SHA-256 before it is handed out.

Names give the origin and the difference from other files, and do not change: ``tue/<letter>-<what>``, with the
experiment's own letters (a to c position-position control, d to f position-force control) and the material as its file
calls it; ``tue/m1-<letter>-<what>`` for an earlier run of the same course, with other masses and gains;
``aurora/<force>-mN``, with the commanded force of the motor.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from urllib.parse import quote

from foretouch.errors import UnknownNameError
from foretouch.errors.checks import require_type
from foretouch.files.origins import HOST, Origin, original
from foretouch.recordings.formats.published import SUFFIX

EXCERPTS: Final = Path(__file__).parent / "measured"
"""Folder of the excerpts: in it one for each origin, with its licence."""


@dataclass(frozen=True)
class Dataset:
    """One measured file.

    Attributes:
        name: Its name here: origin, and what distinguishes it from the others.
        origin: Where it was published.
        file: Its file name there and here.
        kind: What is touched: ``"foam"``, ``"spring"``, ``"rigid"``, ``"free"`` (nothing) or ``"skin"``.
        sha256: Checksum of the file.
        seen: Whether models, estimators, their defaults and the marks of the documentation were chosen with it in view;
            figures on the others say what those are worth elsewhere.
    """

    name: str
    origin: Origin
    file: str
    kind: str
    sha256: str
    seen: bool

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
_TUE_FIRST = replace(_TUE, folder="m1_question1")
_AURORA = Origin(
    repository="SDAMcIntyre/Indentation_Discrimination",
    commit="da51ad73f586d8d51f46b2d2230aa79e17a963b7",
    folder="Emma protocols/22-01-18",
    local_folder="aurora_skin_indentation",
    licence="MIT, Copyright (c) 2021 S McIntyre",
    about="a motor presses skin to a target force, holds and releases; 2 kHz",
)

_TUE_FILES: Final = {
    "a_foam": "694b3da7c0a1f2dcb476a1ecdc53a8b710e5e8006446237027cd131151ef6cea",
    "a_foam2": "f8d8d6cd3718825b8ae3be7fd00e9cabee2f2029bd1a07037b92f9837563b04c",
    "a_foam3": "6cf605dda7f05cd26d776fdcc72013c78c5d78022440f4fa7dac8e748abfccf2",
    "a_free_motion": "8c4747090b6c08e28171703044114a1ebe031e92f2995eaf399a6d0d0fbf832c",
    "a_rigid": "426f3eadfc03f422dd87a7313f768d54a3ddb59e03bb2bf0c82fccdc7119828b",
    "a_spring": "6b6678527130abcef137e5b10a6581e1e5750f38e69c96a06f4402cb113e47d5",
    "b_foam": "e3b6a019b1ba4479529f85e31739683cf0fd290ce458efec2da96de3c1fe5c94",
    "b_foam2": "850aa3b7250c37e6707a676c50c346bf12b09d64c57b6ce4cc7f679ae6d0d253",
    "b_foam3": "719d4741ec2706820c6ca47ffeab8758d7f353fce2708f6cd5c6804b9f823b2a",
    "b_rigid": "a716305b1cd86965e0b60ede928e259813cd6414b9204d6aa980000980963a11",
    "b_spring": "0187125cdc97d43b049e7de2da11ece8ef739d9cb16fb37b07baa4cc3a6f1bd9",
    "d_foam": "bd07ae70df0d92fdc68e4ade2c326842d1b33ff11195822ffc7b35cf4f25c001",
    "d_foam2": "e8b82634da7a92986af52757beef65dfc557c35e28c626c6f6553e782dc796bc",
    "d_rigid": "c2d6de62c88944e9af507633f22bac2b9898999148a2423068709dbc81ff27cd",
    "d_spring": "deab6c251c4261466fe80f76e2f1625a701d57f319cd0498b3e0cc9f143e18e5",
    "e_foam": "903f2e83309aa261a14b9b935033e449b56b73c4b9aafbb82bd3b948d64a072e",
    "e_foam2": "0963c99f5867719cda839c232a41f5de6d469502119f5544bb108a8d597bcfbd",
}
"""By the end of the file's name; what stands in it is the kind of what is touched."""

_TUE_FIRST_FILES: Final = {
    "d_foam": "ef24037504e9b1bcbc3360db313c3a92f7e45a42eb991cfa86ee423a7913abc6",
    "d_rigid": "bbea462a30de44710566d22984c32071079fc8087376868262d85ad67c1fd375",
    "d_spring": "19ff46075aa500ab24a43036d4a8b3bbf6a7602507e58e59db07ccc310b88ef7",
}
"""SHA-256 of the originals of another run of the course, with other masses and gains."""

_AURORA_FILES: Final = {
    "100": "93e36f7bca06c6102e984a97c706b78f09b63473cf80ddd02fb6ab0b676e6b3e",
    "400": "b184995debf996abb6d9e2d298d2949f0f951e97ab8ff0be4577aa59e3b51177",
    "600": "58d5a2791197eb0edeee6b8fa037fc43d2f387738db12f9b04be44c7a3ada037",
    "1000": "0bccf24822a9b53d0bacff1adc7f99124facfb6295409c5655b9057864816086",
}
"""Files by the commanded force of the motor [mN]."""

_SEEN: Final = frozenset(
    [f"tue/{name}" for name in ("a-foam", "a-free-motion", "a-rigid", "a-spring", "b-foam", "b-foam3", "d-foam2")]
    + ["tue/d-spring", "tue/e-foam2", *(f"aurora/{force}-mN" for force in _AURORA_FILES)]
)


def _datasets() -> Iterator[Dataset]:
    for prefix, origin, file, files in (
        ("tue/", _TUE, "m2_question1{}.mat", _TUE_FILES),
        ("tue/m1-", _TUE_FIRST, "question1{}.mat", _TUE_FIRST_FILES),
        ("aurora/", _AURORA, "{} mN data file.ddf", _AURORA_FILES),
    ):
        for stem, sha256 in files.items():
            touched = prefix != "aurora/"  # then the file's name says what: the skin is in no name
            name = prefix + (stem.replace("_", "-") if touched else f"{stem}-mN")
            kind = stem.split("_")[1].rstrip("0123456789") if touched else "skin"
            yield Dataset(name, origin, file.format(stem), kind, sha256, name in _SEEN)


DATASETS: Final[dict[str, Dataset]] = {dataset.name: dataset for dataset in _datasets()}
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


def excerpt(name: str) -> Path:
    """Path of the excerpt of a measured recording, which the package carries.

    `foretouch.recordings.read_recording` reads it to the figures of the original.

    Args:
        name: One of `DATASETS`.

    Raises:
        UnknownNameError: There is no such recording.
    """
    return EXCERPTS / f"{_named(name).name}{SUFFIX}"


def fetch_dataset(name: str) -> Path:
    """Path of an original, fetched from its origin if it is not here yet.

    Looked for in the folder that ``FORETOUCH_DATA_DIR`` names (there or in any folder below, as
    ``<folder of the origin>/<file>``), then in the user's cache, then at the origin.

    Args:
        name: One of `DATASETS`.

    Raises:
        UnknownNameError: There is no such file.
        DatasetError: The file is another than it should be, or is not here and cannot be fetched.
        MissingExtraError: The package ``pooch`` is needed and not installed.
    """
    dataset = _named(name)
    return original(dataset.origin, dataset.file, dataset.file, f"the original of {dataset.name}", dataset.sha256)


def fetch_all(kind: str | None = None) -> list[Path]:
    """Paths of all originals, or of those of one kind, in the order of `list_datasets`.

    Raises:
        UnknownNameError: There is no such kind.
        DatasetError: As `fetch_dataset`.
    """
    return [fetch_dataset(dataset.name) for dataset in list_datasets(kind)]


def _named(name: str) -> Dataset:
    require_type("name", name, str, "the name of a measured recording, such as 'tue/b-foam'")
    if name not in DATASETS:
        raise UnknownNameError("dataset", name, DATASETS)
    return DATASETS[name]
