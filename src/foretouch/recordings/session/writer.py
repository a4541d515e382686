"""Writes a session as MCAP with ROS 2 schemas: opens in Foxglove, PlotJuggler and rosbag2."""

from __future__ import annotations

from collections.abc import Mapping
from os import PathLike
from pathlib import Path
from types import TracebackType
from typing import Any

from foretouch.errors import RecordingError
from foretouch.messages import Message, Telemetry
from foretouch.messages.states import in_space
from foretouch.recordings.formats.mcap_index import BlockFile, append_index, counts_record
from foretouch.recordings.formats.topics import BESIDE, PROBE, STANDARD, TOPICS, TRUNCATED, probe
from foretouch.recordings.output import optional

LONGEST_BLOCK = 2000  # number of messages that make a block even without a flush
POSE_EVERY = 10  # number of telemetry messages for one that is a pose too, for tools that draw


class SessionWriter:
    """Writes the messages of a session into one MCAP file, as they come.

    Each flush makes a block that can be read by itself. A process that is killed leaves a file without its index, from
    which `read_session` reads all that was flushed, and which `repair_session` makes whole. On a disk that is full the
    file ends with its last whole block. If file or folder are removed, the file gets a name again in the nearest folder
    that is still there, at the next flush. The memory that this takes does not grow with the file. Equal messages at
    equal times give equal bytes.

    Args:
        path: The file; one that is there is replaced.

    Attributes:
        kept_ns: Log times of the first and the last message that stand in the file [ns], None while none does.

    Raises:
        RecordingError: The file cannot be written, or another process writes it.
        MissingExtraError: The package ``mcap`` is not installed.
    """

    def __init__(self, path: str | PathLike[str]) -> None:
        self._mcap, records = optional("mcap.writer"), optional("mcap.records")
        self._first: int | None = None
        self._last = 0
        self.kept_ns: tuple[int, int] | None = None
        self._failed = False
        self._schemas, self._channels = _declarations(records)
        self._numbers: dict[str, int] = {channel.topic: channel.id for channel in self._channels}
        try:
            self._file = BlockFile(path)
        except OSError as error:
            raise _unwritable(path, error) from None
        self._block = self._new_block()
        self._block.start(profile="ros2", library="foretouch")
        try:
            self.flush()
        except RecordingError:
            self._file.close()
            raise

    @property
    def path(self) -> Path:
        """The file: another than was asked for once that was removed."""
        return self._file.path

    def write(self, message: Message, log_time_ns: int) -> None:
        """Record one message, and beside it the standard types of the same content, where there are such.

        Args:
            message: Any message of `foretouch.messages`.
            log_time_ns: Time of its reception by the recorder's clock [ns]; simulated time in a simulation.

        Raises:
            RecordingError: The file cannot be written any more, for example because the disk is full. It stays as it
                was at the last flush; `close` ends it there.
        """
        beside, sequence = BESIDE.get(type(message)), message.sequence & 0xFFFF_FFFF
        own = ((TOPICS[type(one)], one) for one in (message, *in_space(message)))
        packed = [(topic.name, topic.layout.pack(one)) for topic, one in own]
        packed += [(topic.name, data) for topic, data in (beside(message) if beside else ())]
        if isinstance(message, Telemetry) and sequence % POSE_EVERY == 0:
            packed.append((PROBE.name, probe(message)))
        for name, data in packed:
            self._block.add_message(self._numbers[name], log_time_ns, data, message.time_ns, sequence)
        self._first = log_time_ns if self._first is None else self._first
        self._last = log_time_ns
        self._messages += 1
        if self._messages >= LONGEST_BLOCK:
            self.flush()

    def flush(self) -> None:
        """Hand everything written so far to the operating system, in a form that can be read without the rest.

        Raises:
            RecordingError: As `write`.
        """
        block, written = self._block, self._messages
        try:
            self._block = self._new_block()
            block.flush()
            self._file.flush()
            if self._file.removed:
                self._file.keep()
        except OSError as error:
            self._failed = True
            raise _unwritable(self.path, error) from None
        if written and self._first is not None:
            self.kept_ns = self._first, self._last

    def close(self, counts: Mapping[str, int] | None = None) -> None:
        """End the file with its index; where writing has failed, behind its last whole block if there is room.

        Args:
            counts: Counters of the session, kept as `SessionLog.counts`. A second call does nothing.

        Raises:
            RecordingError: As `write`, unless that has raised before.
        """
        if self._file.closed:
            return
        try:
            if not self._failed:
                self.flush()
            text = TRUNCATED if self._failed else counts
            if text:
                self._file.write(counts_record(text))
                self._file.flush()
            append_index(self._file, self._schemas, self._channels)
        except OSError as error:
            if not self._failed:  # otherwise reported before
                raise _unwritable(self.path, error) from None
        finally:
            self._file.close()

    def _new_block(self) -> Any:
        """A writer of the library for one block, which describes its messages by itself."""
        block = self._mcap.Writer(self._file, chunk_size=2**30, compression=self._mcap.CompressionType.LZ4)
        for schema in self._schemas:
            block.register_schema(schema.name, schema.encoding, schema.data)
        for channel in self._channels:
            block.register_channel(channel.topic, channel.message_encoding, channel.schema_id, channel.metadata)
        self._messages = 0
        return block

    def __enter__(self) -> SessionWriter:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def _declarations(records: Any) -> tuple[list[Any], list[Any]]:
    """Schema and channel records of the library for all topics, numbered as its writer numbers them."""
    topics = [(topic.name, topic.type_name, topic.layout.schema, topic.frame) for topic in TOPICS.values()]
    topics += [(topic.name, topic.type_name, topic.schema, topic.frame) for topic in STANDARD]
    numbers: dict[str, int] = {}
    schemas: list[Any] = []
    channels: list[Any] = []
    for name, type_name, text, frame in topics:
        if type_name not in numbers:
            numbers[type_name] = len(numbers) + 1
            schemas.append(records.Schema(numbers[type_name], text.encode(), "ros2msg", type_name))
        metadata = {"offered_qos_profiles": ""} | ({"frame_id": frame} if frame else {})
        channels.append(records.Channel(len(channels) + 1, name, "cdr", metadata, numbers[type_name]))
    return schemas, channels


def _unwritable(path: str | PathLike[str], error: OSError) -> RecordingError:
    return RecordingError(path, f"cannot be written: {error.strerror or error}")
