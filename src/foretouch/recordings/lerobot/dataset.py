"""The folder of a LeRobotDataset of version 3.0: Parquet, JSON and MP4, as LeRobot's own readers want them."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from os import PathLike
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import RecordingError, SettingError
from foretouch.quantities import ByValue
from foretouch.recordings.formats.video import CODEC, PIXELS, Mp4, read_jpeg
from foretouch.recordings.lerobot.episodes import ACTION, TIMES, Episode
from foretouch.recordings.output import atomic_folder, optional

VERSION: Final = "v3.0"
DATA: Final = "data/chunk-{chunk_index:03d}/file-{file_index:03d}.parquet"
VIDEO: Final = "videos/{video_key}/chunk-{chunk_index:03d}/file-{file_index:03d}.mp4"
EPISODES: Final = "meta/episodes/chunk-000/file-000.parquet"
CHUNK, DATA_MB, VIDEO_MB = 1000, 100, 200  # files of a folder, and megabytes from which on there is a next file
CAMERA: Final = "observation.images.camera"
COUNT: Final = "samples.count"
TASK: Final = "press the material"
MOST_SAMPLES: Final = 100_000_000
"""Places for samples in one recording, ten hours at 1 kHz and 30 frames a second three times over."""
LOOKED_AT: Final = 10  # one image in so many is looked at for the statistics
QUANTILES: Final = {"q01": 0.01, "q10": 0.1, "q50": 0.5, "q90": 0.9, "q99": 0.99}

Numbers = NDArray[Any]


class Feature(NamedTuple):
    """How one feature is described: its type, the shape of its value in a frame, and names of its numbers."""

    dtype: str
    shape: tuple[int, ...]
    names: Any = None

    def description(self) -> dict[str, Any]:
        """As it stands in `info.json`."""
        return {"dtype": self.dtype, "shape": list(self.shape), "names": self.names}


@dataclass(frozen=True)
class Dataset(ByValue):
    """What was written.

    Attributes:
        path: The folder.
        episodes: Number of episodes, one a recording.
        frames: Number of frames in all of them.
        fps: Frames a second.
        features: Names of the features.
    """

    path: Path
    episodes: int
    frames: int
    fps: int
    features: tuple[str, ...]


def write_lerobot(folder: str | PathLike[str], episodes: Iterable[Episode], *, task: str = TASK) -> Dataset:
    """Write recordings as a LeRobotDataset of version 3.0, which LeRobot's own readers open.

    Args:
        folder: The folder; it must not be there, and is there only when it is whole.
        episodes: Of `read_episode`, in their order; they are taken one by one, so they may be read as they are asked
            for.
        task: What is done in all of them, a sentence for policies that are told it.

    Raises:
        RecordingError: The folder is there or cannot be written, there is no episode, an image cannot be read, or one
            recording has other features, images or frames a second than the first.
        SettingError: A task without a word.
        MissingExtraError: ``pyarrow`` is not installed, or ``av`` where there are images.
    """
    if not task.strip():
        raise SettingError("task", task, "must say in words what is done")
    arrow = optional("pyarrow")
    with atomic_folder(folder) as part:
        taken: list[Episode] = []
        with _Camera(part) as camera:
            for episode in episodes:
                _require_same(episode, taken[0] if taken else episode)
                camera.take(episode, first=not taken)
                taken.append(replace(episode, images=()))  # those of one recording at a time
        if not taken:
            raise RecordingError(folder, "cannot be written: no recording is given")
        features = _features(taken)
        rows, statistics = _write_data(part, arrow, taken, features, task)
        for row, seen in zip(rows, camera.rows, strict=True):
            row |= seen
        described = {name: one.description() for name, one in features.items()}
        if camera.size:
            described |= {CAMERA: camera.description(taken[0].fps)}
            statistics[CAMERA] = camera.statistics()
        _write_meta(part, arrow, rows, task)
        info = _info(taken, described)
        _write_json(part / "meta" / "stats.json", statistics)
        _write_json(part / "meta" / "info.json", info)
    return Dataset(Path(folder), len(taken), info["total_frames"], taken[0].fps, tuple(described))


def _require_same(episode: Episode, first: Episode) -> None:
    """Refuse a recording that does not go into one table with the first."""
    if episode.fps != first.fps:
        raise RecordingError(episode.name, f"has {episode.fps} frames a second, {first.name} {first.fps}")
    for feature in dict.fromkeys([*first.features, *episode.features]):
        if feature.startswith(("observation", ACTION)):
            here, there = (tuple(one.features.get(feature, ())) for one in (episode, first))
            if here != there:
                has, had = (", ".join(names) or "nothing" for names in (here, there))
                problem = f"{feature} is {has}, and in {first.name} {had}: recordings of one dataset must be alike"
                raise RecordingError(episode.name, problem)


def _features(episodes: Sequence[Episode]) -> dict[str, Feature]:
    """Features of the table. A number that is known in no frame of any recording is left out."""
    features = {}
    for feature in dict.fromkeys(name for one in episodes for name in one.features):
        names = dict.fromkeys(name for one in episodes for name in one.features.get(feature, ()))
        every = [one.features.get(feature, {}) for one in episodes]
        known = [name for name in names if any(np.isfinite(one.get(name, np.nan)).any() for one in every)]
        if known:
            features[feature] = Feature("float32", (len(known),), known)
    most = max(int(_counts(one).max()) for one in episodes)
    for one in episodes:
        if most * len(one) > MOST_SAMPLES:
            problem = f"has {len(one):,} frames, and up to {most:,} samples lie between two: too many for a table"
            raise RecordingError(one.name, f"{problem}; take more frames a second (--fps), or a part of it")
    features[COUNT] = Feature("int64", (1,), ["samples"])
    for feature, named in episodes[0].samples.items():
        shape = (most,) if feature == TIMES else (most, len(named))
        features[feature] = Feature("float32", shape, {"axes": list(named)})
    features["timestamp"] = Feature("float32", (1,))
    whole = dict.fromkeys(("frame_index", "episode_index", "index", "task_index"), Feature("int64", (1,)))
    return features | whole


def _counts(episode: Episode) -> NDArray[np.int64]:
    """Number of samples that each frame brings."""
    return np.diff(episode.ends, prepend=0)


def _write_data(
    part: Path, arrow: Any, episodes: Sequence[Episode], features: dict[str, Feature], task: str
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Write the table of all frames; what the table of episodes says of each, and the statistics of all."""
    parquet = optional("pyarrow.parquet")
    rows: list[dict[str, Any]] = []
    every: dict[str, list[Numbers]] = {name: [] for name in features}
    first, number, writer = 0, 0, None
    try:
        for index, episode in enumerate(episodes):
            arrays = _arrays(episode, features, index, first)
            table = arrow.table({name: _arrow(arrow, array) for name, array in arrays.items()})
            if writer is None:
                path = part / DATA.format(chunk_index=number // CHUNK, file_index=number % CHUNK)
                path.parent.mkdir(parents=True, exist_ok=True)
                writer = parquet.ParquetWriter(path, table.schema, compression="snappy")
            writer.write_table(table)
            rows.append(
                {
                    "episode_index": index,
                    "tasks": [task],
                    "length": len(episode),
                    "data/chunk_index": number // CHUNK,
                    "data/file_index": number % CHUNK,
                    "dataset_from_index": first,
                    "dataset_to_index": first + len(episode),
                }
            )
            for name, array in arrays.items():
                every[name].append(array)
                rows[-1] |= _flat(name, _statistics(array))
            first += len(episode)
            if path.stat().st_size > DATA_MB * 2**20:
                writer.close()
                number, writer = number + 1, None
    finally:
        if writer is not None:
            writer.close()
    return rows, {name: _statistics(np.concatenate(parts)) for name, parts in every.items()}


def _arrays(episode: Episode, features: dict[str, Feature], index: int, first: int) -> dict[str, Numbers]:
    """The episode's part of each column, the number of the frame first in its shape."""
    frames, counts = np.arange(len(episode)), _counts(episode)
    frame = np.repeat(frames, counts)
    slot = np.arange(frame.size) - np.repeat(episode.ends - counts, counts)
    own = {
        COUNT: counts,
        "timestamp": frames / episode.fps,
        "frame_index": frames,
        "episode_index": np.full(len(episode), index),
        "index": first + frames,
        "task_index": np.zeros(len(episode)),
    }
    arrays: dict[str, Numbers] = {}
    for name, feature in features.items():
        if name in own:
            arrays[name] = own[name].astype(feature.dtype)
            continue
        array = np.full((len(episode), *feature.shape), np.nan, dtype=feature.dtype)
        if name in episode.samples:
            stacked = np.stack(list(episode.samples[name].values()), axis=-1)
            array[frame, slot] = stacked[:, 0] if len(feature.shape) == 1 else stacked
        for column, label in enumerate(feature.names if isinstance(feature.names, list) else ()):
            if label in episode.features.get(name, {}):
                array[:, column] = episode.features[name][label]
        arrays[name] = array[:, 0] if feature.shape == (1,) else array
    return arrays


def _arrow(arrow: Any, array: Numbers) -> Any:
    """An array as a column: numbers, lists of one length, or lists of lists."""
    values = arrow.array(array.reshape(-1))
    if array.ndim == 1:
        return values
    if array.ndim == 2:
        return arrow.FixedSizeListArray.from_arrays(values, array.shape[1])
    for length in array.shape[:0:-1]:
        values = arrow.ListArray.from_arrays(np.arange(0, len(values) + 1, length, dtype=np.int32), values)
    return values


def _statistics(array: Numbers) -> dict[str, Any]:
    """Statistics of each number of a feature over all frames, without what is missing; one that always is has NaN."""
    columns = array.reshape(-1, array.shape[-1] if array.ndim > 1 else 1).astype(np.float64).T
    finite = [column[np.isfinite(column)] for column in columns]
    kinds: dict[str, Any] = {"min": np.min, "max": np.max, "mean": np.mean, "std": np.std}
    output: dict[str, Any] = {
        name: [float(of(one)) if one.size else np.nan for one in finite] for name, of in kinds.items()
    }
    ranks = list(QUANTILES.values())
    quantiles = [np.quantile(one, ranks) if one.size else np.full(len(ranks), np.nan) for one in finite]
    output |= {name: [float(one[row]) for one in quantiles] for row, name in enumerate(QUANTILES)}
    return output | {"count": [array.shape[0]]}


def _flat(feature: str, statistics: dict[str, Any]) -> dict[str, Any]:
    return {f"stats/{feature}/{name}": values for name, values in statistics.items()}


class _Camera:
    """The video of the camera, of which each recording is a part, and the statistics of its images.

    Attributes:
        rows: What the table of episodes says of each part.
        size: Width and height of all images [pixel]; empty where there are none.
    """

    def __init__(self, part: Path) -> None:
        self._part = part
        self._video: Mp4 | None = None
        self._file = 0
        self._pixels = np.zeros((3, 256), dtype=np.int64)  # how often each brightness is there, by colour
        self._images = 0
        self.rows: list[dict[str, Any]] = []
        self.size: tuple[int, ...] = ()

    def take(self, episode: Episode, *, first: bool) -> None:
        """Add the images of an episode to the video."""
        self.rows.append({})
        if bool(episode.images) != bool(self.size) and not first:
            has = "has images of a camera" if episode.images else "has no images of a camera"
            raise RecordingError(episode.name, f"{has}, unlike the first: recordings of one dataset must be alike")
        if not episode.images:
            return
        before, seen = (self._pixels.copy(), self._images), self._open(episode)
        frame, shown = None, b""
        for number, jpeg in enumerate(episode.images):
            if frame is None or jpeg is not shown:
                frame, shown = self._read(episode.name, jpeg), jpeg
            if number % LOOKED_AT == 0:
                self._look(frame)
            seen.write(frame)
        chunk, file = divmod(self._file, CHUNK)
        begin, end = ((seen.frames - count) / episode.fps for count in (len(episode), 0))
        where = {"chunk_index": chunk, "file_index": file, "from_timestamp": begin, "to_timestamp": end}
        self.rows[-1] |= {f"videos/{CAMERA}/{name}": value for name, value in where.items()}
        own = _image_statistics(self._pixels - before[0], self._images - before[1])
        self.rows[-1] |= _flat(CAMERA, own)
        if seen.path.stat().st_size > VIDEO_MB * 2**20:
            seen.close()
            self._video, self._file = None, self._file + 1

    def _open(self, episode: Episode) -> Mp4:
        if not self.size:
            frame = self._read(episode.name, episode.images[0])
            self.size = (frame.width, frame.height)
        if self._video is None:
            chunk, file = divmod(self._file, CHUNK)
            path = self._part / VIDEO.format(video_key=CAMERA, chunk_index=chunk, file_index=file)
            self._video = Mp4(path, (self.size[0], self.size[1]), episode.fps)
        return self._video

    def _read(self, name: str, jpeg: bytes) -> Any:
        frame = read_jpeg(name, jpeg)
        if self.size and (frame.width, frame.height) != self.size:
            here, there = (f"{width} x {height}" for width, height in ((frame.width, frame.height), self.size))
            raise RecordingError(name, f"has an image of {here} pixels, and others of {there}: they must be alike")
        return frame

    def _look(self, frame: Any) -> None:
        colours = frame.to_ndarray(format="rgb24").reshape(-1, 3).T
        self._pixels += np.stack([np.bincount(colour, minlength=256) for colour in colours])
        self._images += 1

    def description(self, fps: int) -> dict[str, Any]:
        """As it stands in `info.json`."""
        width, height = self.size
        about = {"height": height, "width": width, "codec": CODEC, "pix_fmt": PIXELS, "is_depth_map": False}
        video = {f"video.{name}": value for name, value in (about | {"fps": fps, "channels": 3}).items()}
        shape = Feature("video", (height, width, 3), ["height", "width", "channels"])
        return shape.description() | {"info": video | {"has_audio": False}}

    def statistics(self) -> dict[str, Any]:
        """Of all images."""
        return _image_statistics(self._pixels, self._images)

    def __enter__(self) -> _Camera:
        return self

    def __exit__(self, *_: object) -> None:
        if self._video is not None:
            self._video.close()


def _image_statistics(pixels: NDArray[np.int64], images: int) -> dict[str, Any]:
    """Statistics of brightness from 0 to 1 by colour, each a column of pixels, as LeRobot has them."""
    levels, total = np.arange(256) / 255.0, pixels.sum(axis=1)
    mean = pixels @ levels / total
    present = [levels[one > 0] for one in pixels]
    output = {"min": [one[0] for one in present], "max": [one[-1] for one in present], "mean": mean}
    output["std"] = np.sqrt(np.maximum(pixels @ levels**2 / total - mean**2, 0.0))
    sums = np.cumsum(pixels, axis=1)
    for name, rank in QUANTILES.items():
        output[name] = [levels[np.searchsorted(one, rank * one[-1])] for one in sums]
    return {name: [[[float(value)]] for value in values] for name, values in output.items()} | {"count": [images]}


def _write_meta(part: Path, arrow: Any, rows: list[dict[str, Any]], task: str) -> None:
    """The table of episodes and that of tasks, whose texts are the index that pandas reads."""
    parquet = optional("pyarrow.parquet")
    path = part / EPISODES
    path.parent.mkdir(parents=True, exist_ok=True)
    place = {"meta/episodes/chunk_index": 0, "meta/episodes/file_index": 0}
    parquet.write_table(arrow.Table.from_pylist([row | place for row in rows]), path)
    column = {"name": "task", "field_name": "task", "pandas_type": "unicode", "numpy_type": "object", "metadata": None}
    number = column | {"name": "task_index", "field_name": "task_index", "pandas_type": "int64", "numpy_type": "int64"}
    about = {"index_columns": ["task"], "column_indexes": [], "columns": [number, column], "pandas_version": "2.2.0"}
    tasks = arrow.table({"task_index": arrow.array([0], arrow.int64()), "task": [task]})
    parquet.write_table(tasks.replace_schema_metadata({"pandas": json.dumps(about)}), part / "meta" / "tasks.parquet")


def _info(episodes: Sequence[Episode], features: dict[str, Any]) -> dict[str, Any]:
    return {
        "codebase_version": VERSION,
        "robot_type": "foretouch",
        "total_episodes": len(episodes),
        "total_frames": sum(map(len, episodes)),
        "total_tasks": 1,
        "chunks_size": CHUNK,
        "data_files_size_in_mb": DATA_MB,
        "video_files_size_in_mb": VIDEO_MB,
        "fps": episodes[0].fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": DATA,
        "video_path": VIDEO if CAMERA in features else None,
        "features": features,
    }


def _write_json(path: Path, content: dict[str, Any]) -> None:
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8")
