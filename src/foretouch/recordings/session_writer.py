"""Writes a session as MCAP with ROS 2 schemas: opens in Foxglove, PlotJuggler and rosbag2."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from os import PathLike
from pathlib import Path
from types import TracebackType

from foretouch.errors import RecordingError
from foretouch.messages import LeaderState, Message, Telemetry
from foretouch.recordings._extra import optional
from foretouch.recordings.topics import (
    COUNTS,
    FOLLOWER_JOINTS,
    LEADER_JOINTS,
    STANDARD,
    TOPICS,
    WRENCH,
    joint_state,
    wrench,
)

__all__ = ["SessionWriter"]


class SessionWriter:
    """Writes the messages of a session into one MCAP file, as they come.

    What was flushed is readable whatever happens afterwards: a process that is killed leaves a file without its
    index, from which `read_session` reads all that was flushed. Equal messages at equal times give equal bytes.

    Args:
        path: The file; one that is there is replaced.

    Raises:
        RecordingError: The file cannot be written.
        MissingExtraError: The package ``mcap`` is not installed.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        mcap = optional("mcap.writer")
        self.path = Path(path)
        try:
            self._file = self.path.open("wb")
        except OSError as error:
            raise self._unwritable(error) from None
        self._writer = mcap.Writer(self._file, compression=mcap.CompressionType.LZ4)
        self._writer.start(profile="ros2", library="foretouch")
        own = {topic.name: (topic.type_name, topic.layout.schema) for topic in TOPICS.values()}
        standard = {topic.name: (topic.type_name, topic.schema) for topic in STANDARD}
        schemas: dict[str, int] = {}
        channels: dict[str, int] = {}
        for name, (type_name, schema) in {**own, **standard}.items():
            if type_name not in schemas:
                schemas[type_name] = self._writer.register_schema(type_name, "ros2msg", schema.encode())
            channels[name] = self._writer.register_channel(
                name, "cdr", schemas[type_name], {"offered_qos_profiles": ""}
            )
        self._own: dict[type[Message], tuple[int, Callable[[Message], bytes]]] = {
            kind: (channels[topic.name], topic.layout.pack) for kind, topic in TOPICS.items()
        }
        self._wrench = channels[WRENCH.name]
        self._follower_joints = channels[FOLLOWER_JOINTS.name]
        self._leader_joints = channels[LEADER_JOINTS.name]
        try:
            self.flush()
        except RecordingError:
            with suppress(OSError):
                self._file.close()
            raise

    def write(self, message: Message, log_time_ns: int) -> None:
        """Record one message, and beside telemetry and leader state the standard types that say the same.

        Args:
            message: Any message of `foretouch.messages`.
            log_time_ns: When it came, by the recorder's clock [ns]; simulated time in a simulation.

        Raises:
            RecordingError: The file cannot be written any more, for example because the disk is full.
        """
        channel, pack = self._own[type(message)]
        add, sequence, time_ns = self._writer.add_message, message.sequence & 0xFFFF_FFFF, message.time_ns
        try:
            add(channel, log_time_ns, pack(message), time_ns, sequence)
            if isinstance(message, Telemetry):
                add(self._wrench, log_time_ns, wrench(time_ns, message.force), time_ns, sequence)
                joints = joint_state(time_ns, message.position, message.velocity, message.force)
                add(self._follower_joints, log_time_ns, joints, time_ns, sequence)
            elif isinstance(message, LeaderState):
                joints = joint_state(time_ns, message.position, message.velocity, message.rendered_force)
                add(self._leader_joints, log_time_ns, joints, time_ns, sequence)
        except OSError as error:
            raise self._unwritable(error) from None

    def flush(self) -> None:
        """Hand everything written so far to the operating system, in a form that can be read without the rest.

        Raises:
            RecordingError: As `write`.
        """
        try:
            self._writer.flush()
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self, counts: Mapping[str, int] | None = None) -> None:
        """End the file with its index.

        Args:
            counts: Counters of the session, kept as `SessionLog.counts`. A second call does nothing.

        Raises:
            RecordingError: As `write`.
        """
        if self._file.closed:
            return
        try:
            if counts:
                self._writer.flush()  # so that the counters stand behind the messages
                self._writer.add_metadata(COUNTS, {name: str(int(count)) for name, count in counts.items()})
            self._writer.finish()
            self._file.close()
        except OSError as error:
            with suppress(OSError):
                self._file.close()
            raise self._unwritable(error) from None

    def _unwritable(self, error: OSError) -> RecordingError:
        return RecordingError(self.path, f"cannot be written: {error.strerror or error}")

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
