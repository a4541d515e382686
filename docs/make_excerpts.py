"""Make the excerpts of the measured recordings, which the package carries, again from their originals.

Usage: `.venv/bin/python docs/make_excerpts.py`. The originals come from where `foretouch datasets fetch` takes them
(the folder that FORETOUCH_DATA_DIR names, the cache, or their public origin), each checked against its SHA-256. Written
are `<name>.npz` and, beside them, an `ORIGIN.md` for each origin; with `--check` nothing is, and it fails where an
excerpt is not what would be written. The licences beside them are those of the origins' repositories, copied once.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from foretouch.quantities import Recording
from foretouch.recordings import DATASETS, Dataset, excerpt, fetch_dataset, read_leader_motion, read_recording
from foretouch.recordings.formats.published import LEVER, TORQUE_PER_VOLT, About, read_excerpt, write_excerpt

Columns = dict[str, NDArray[np.float64]]

MICROSECONDS = 1e6
"""Times are multiples of 0.5 ms."""

ENCODER = 300_000 / (2.0 * math.pi * LEVER)
"""Counts of the levers' encoders for a metre at the tip."""

BRIDGE = 65_535 / 20.0 * LEVER / TORQUE_PER_VOLT
"""Counts of the converter, 16 bits over 20 V, for a newton on the force bridge."""

LOGGED = 2000.0
"""Half millinewtons: the logged torque is a filtered one and has no counts; half a count of the bridge is 0.48 mN."""

AURORA = {"time": MICROSECONDS, "position": 1e9, "force": 2e6}
"""The files have six decimals of a volt; a volt is a millimetre, and half a newton."""

COUNTED = 1e-4
"""So far from a whole number may be what a sensor counted: what is left is the rounding of the file's numbers."""


def main() -> None:
    """Write or check all excerpts."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="write nothing; fail where an excerpt is another")
    check = parser.parse_args().check
    if not check:
        for dataset in DATASETS.values():
            write_excerpt(excerpt(dataset.name), *content(dataset))
    wrong = [name for name, dataset in DATASETS.items() if not is_right(dataset)]
    folders = {excerpt(name).parent for name in DATASETS}
    for folder in folders:
        origin = origin_page(folder)
        if not check:
            (folder / "ORIGIN.md").write_text(origin, encoding="utf-8")
        elif (folder / "ORIGIN.md").read_text(encoding="utf-8") != origin:
            wrong.append(f"{folder.name}/ORIGIN.md")
    size = sum(file.stat().st_size for folder in folders for file in folder.iterdir())
    print(f"{len(DATASETS)} excerpts, {size / 1e3:.0f} kB with licences and origins; not as they should be: {wrong}")
    sys.exit(bool(wrong))


def is_right(dataset: Dataset) -> bool:
    """Whether an excerpt is what would be written, by its numbers: the same ones are packed in several ways."""
    with tempfile.TemporaryDirectory() as folder:
        made = Path(folder, "made.npz")
        write_excerpt(made, *content(dataset))
        there, again = read_excerpt(excerpt(dataset.name)), read_excerpt(made)
    alike = there.about == again.about and there.columns.keys() == again.columns.keys()
    return alike and all(np.array_equal(there.columns[name], again.columns[name]) for name in there.columns)


def content(dataset: Dataset) -> tuple[About, Columns]:
    """What an excerpt holds of its original."""
    original = fetch_dataset(dataset.name)
    recording = read_recording(original)
    columns: Columns = {"time": recording.time, "position": recording.position, "force": recording.force}
    counts = AURORA
    if original.suffix == ".mat":
        counts = {"time": MICROSECONDS, "position": ENCODER, "force": BRIDGE}
    require_counts(dataset, columns, counts)
    if original.suffix == ".mat":
        columns |= levers(original, recording)
        counts = counts | {"logged_force": LOGGED, "leader_position": ENCODER}
        require_counts(dataset, {"leader_position": columns["leader_position"]}, counts)
    origin = dataset.origin
    return About(dataset.name, dataset.url, dataset.sha256, origin.licence, recording.contact_floor, counts), columns


def levers(original: Path, recording: Recording) -> Columns:
    """What a TU/e file has beside: the torque that the experiment logged, as a force, and the leader's motion."""
    logged, (time, leader) = read_recording(original, force_channel="logged"), read_leader_motion(original)
    assert time.size == len(logged) == len(recording)
    return {"logged_force": logged.force, "leader_position": leader}


def require_counts(dataset: Dataset, columns: Columns, counts: dict[str, float]) -> None:
    """Refuse to round what is no whole number of counts."""
    for name, column in columns.items():
        counted = column * counts[name]
        away = float(np.abs(counted - np.rint(counted)).max())
        if away > COUNTED:
            raise ValueError(f"{dataset.name}: {name} is {away:.3g} counts away from a whole number")


def origin_page(folder: Path) -> str:
    """What each excerpt of a folder was made from."""
    inside = [dataset for name, dataset in DATASETS.items() if excerpt(name).parent == folder]
    origin = inside[0].origin
    rows = [f"| `{Path(one.name).name}.npz` | {one.kind} | <{one.url}> | `{one.sha256}` |" for one in inside]
    return "\n".join(
        [
            f"# {inside[0].name.split('/')[0]}: {origin.about}",
            "",
            f"Excerpts of recordings of <https://github.com/{origin.repository}>, commit `{origin.commit}`.",
            f"{origin.licence}: see `LICENSE`, which is that of the repository. Changed: of each file time, position",
            "and force are kept (of a lever also the logged force and the leader's position), as integers.",
            "",
            "| Excerpt | Touched | Original | SHA-256 of the original |",
            "| --- | --- | --- | --- |",
            *rows,
            "",
        ]
    )


if __name__ == "__main__":
    main()
