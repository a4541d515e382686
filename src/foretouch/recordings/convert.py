"""Writes a recording in another format: CSV, Parquet, or MCAP with ROS 2 messages."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import repeat
from os import PathLike
from pathlib import Path
from typing import Final

import numpy as np

from foretouch.errors import RecordingError
from foretouch.quantities import TIP, WORLD, Recording
from foretouch.recordings.formats import topics
from foretouch.recordings.meaning.mapping import Mapping, Signal, TimeSource, Velocity, mapping_text
from foretouch.recordings.output import atomic_path, optional, write_columns
from foretouch.recordings.source import MAP_NAME

OUTPUTS: Final = (".csv", ".parquet", ".mcap")
"""Endings of the files that can be written."""

JOINTS, WRENCH, POSE = "/probe/joint_states", "/probe/wrench", "/probe/pose"
_TOPICS: Final = {
    JOINTS: ("sensor_msgs/msg/JointState", topics.JOINT_STATE_SCHEMA, TIP),
    WRENCH: ("geometry_msgs/msg/WrenchStamped", topics.WRENCH_SCHEMA, TIP),
    POSE: ("geometry_msgs/msg/PoseStamped", topics.POSE_SCHEMA, WORLD),
}


def write_recording(path: str | PathLike[str], recording: Recording) -> list[str]:
    """Write a recording; the ending of the name says the format. What is written reads back as the same recording.

    - CSV and Parquet: ``time_s``, ``position_m``, ``force_N`` and, where it was measured, ``velocity_m_s``.
    - MCAP: `JointState`, `WrenchStamped` (force along z) and `PoseStamped` (position against z), one of each a sample,
      and the map that reads them, as a metadata record. Stamps and log times are the times of the recording.

    Args:
        path: The file; it is there only when it is whole.
        recording: What to write.

    Returns:
        Sentences on what the format could not keep.

    Raises:
        RecordingError: Another ending, times that nanoseconds cannot tell apart, or the file cannot be written.
        MissingExtraError: A package of the extra ``recordings`` is not installed.
    """
    suffix = Path(path).suffix.lower()
    if suffix not in OUTPUTS:
        raise RecordingError(path, f"cannot be written: its name must end with one of {', '.join(OUTPUTS)}")
    if suffix == ".mcap":
        return _write_mcap(path, recording)
    columns = {"time_s": recording.time, "position_m": recording.position, "force_N": recording.force}
    velocity, floor = None, recording.contact_floor
    if recording.velocity is not None:
        columns["velocity_m_s"], velocity = recording.velocity, Velocity(column="velocity_m_s")
    if suffix == ".csv":
        write_columns(path, columns)
        lost = f"a CSV keeps no contact floor: put contact_floor = {floor:g} into a --map for it"
        return [] if floor == 0.05 else [lost]
    position, force = Signal(column="position_m", unit="m"), Signal(column="force_N", unit="N")
    mapping = Mapping(position, force, TimeSource(column="time_s"), velocity, contact_floor=floor)
    write_columns(path, columns, metadata={MAP_NAME: mapping_text(mapping)})
    return []


def _write_mcap(path: str | PathLike[str], recording: Recording) -> list[str]:
    writer = optional("mcap.writer")
    begin = min(float(recording.time[0]), 0.0)
    stamps = np.rint((recording.time - begin) * 1e9).astype(np.int64)
    if (np.diff(stamps) <= 0).any():
        raise RecordingError(path, "cannot be written: the recording has samples less than a nanosecond apart")
    mapping = Mapping(
        Signal(topic=JOINTS, field="position[0]", unit="m"),
        Signal(topic=WRENCH, field="wrench.force.z", unit="N"),
        TimeSource(stamp="header", start="zero"),
        None if recording.velocity is None else Velocity(field="velocity[0]"),
        contact_floor=recording.contact_floor,
    )
    with atomic_path(path) as part, part.open("wb") as file:
        mcap = writer.Writer(file, compression=writer.CompressionType.LZ4)
        mcap.start(profile="ros2", library="foretouch")
        channels = {}
        for topic, (kind, schema, frame) in _TOPICS.items():
            number = mcap.register_schema(kind, "ros2msg", schema.encode())
            said = {"offered_qos_profiles": "", "frame_id": frame}
            channels[topic] = mcap.register_channel(topic, "cdr", number, said)
        for sequence, (topic, stamp, data) in enumerate(_messages(recording, stamps.tolist())):
            mcap.add_message(channels[topic], stamp, data, stamp, sequence // len(_TOPICS))
        mcap.add_metadata(MAP_NAME, {"toml": mapping_text(mapping)})
        mcap.finish()
    return [f"stamps cannot be negative: times begin at 0 instead of {begin:g} s"] if begin else []


def _messages(recording: Recording, stamps: list[int]) -> Iterator[tuple[str, int, bytes]]:
    speeds: Iterable[float | None] = repeat(None) if recording.velocity is None else recording.velocity.tolist()
    columns = stamps, recording.position.tolist(), recording.force.tolist(), speeds
    for stamp, position, force, speed in zip(*columns, strict=False):
        yield JOINTS, stamp, topics.joint_state(stamp, position, speed, force)
        yield WRENCH, stamp, topics.wrench(stamp, force)
        yield POSE, stamp, topics.pose(stamp, (0.0, 0.0, -position))
