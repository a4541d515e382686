"""Messages over one TCP connection, for a program that speaks no Zenoh: each behind its size, all of them bounded.

A frame is the number of bytes behind it in four bytes (little-endian), the number of a channel in one byte
(`CHANNEL_NUMBERS`), and the message as it is on the network.
"""

from __future__ import annotations

import contextlib
import errno
import select
import socket
import time
from collections import deque
from collections.abc import Callable

from foretouch.errors import LinkError
from foretouch.link.access import address_of, bind_error, check_endpoint, is_encrypted
from foretouch.messages import CHANNELS, LARGEST_MESSAGE

CHANNEL_NUMBERS = {name: number for number, name in enumerate(CHANNELS)}
"""Number of each channel in a frame."""

SIZE_BYTES = 4  # Of the size that a frame begins with
NAMES = dict(enumerate(CHANNELS))
URGENT = ("emergency", "stop")  # Sent before all that waits
QUEUED = 64  # Messages of a channel that wait for a program that does not read; beyond it the oldest are dropped
AT_ONCE = 65_536  # Bytes that are read, or sent, at a time
KERNEL_BYTES = 65_536  # That the system may hold for a program that does not read: some 0.3 s of telemetry
UNANSWERED_MS = (
    5_000  # Time after which a program is taken for gone that reads nothing, or whose machine is silent [ms]
)
PAUSE = 0.5  # Time for which nobody is let in after a program that was sent away [s], which bounds the lines about it


class FrameServer:
    """Lets in one program at a time, takes its frames, and hands it frames.

    It never waits for the program. A frame that cannot be one closes the connection, with one line.

    Args:
        endpoint: ``tcp/HOST:PORT`` to listen on.
        say: Prints one line for people.
        insecure: Allow an address off this machine: nothing is encrypted, and nobody is asked who it is.

    Raises:
        LinkError: The endpoint is malformed, not allowed or in use.

    Attributes:
        taken: Frames that came.
        handed: Frames that were handed to the system for the program.
        dropped: Frames that were dropped because the program did not read.
        visits: How often a program was let in.
    """

    def __init__(self, endpoint: str, say: Callable[[str], None], *, insecure: bool = False) -> None:
        check_endpoint(endpoint, insecure=insecure)
        host, port = address_of(endpoint)
        if is_encrypted(endpoint):
            raise LinkError(f"endpoint {endpoint!r}: a program connects by tcp/HOST:PORT; keys are for sessions")
        if (error := bind_error(host, port)) is not None:
            raise LinkError(f"cannot listen on {endpoint}: {error.strerror or error}")
        kind = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0][0]
        self._door = socket.create_server((host, port), family=kind, backlog=1)
        self._door.setblocking(False)
        self._hears_bell, self._rings_bell = socket.socketpair()
        self._hears_bell.setblocking(False)
        self._rings_bell.setblocking(False)
        self._say = say
        self._program: socket.socket | None = None
        self._who = ""
        self._told_busy = False
        self._opens = 0.0
        self._came = bytearray()
        self._queues = {name: deque[bytes](maxlen=QUEUED) for name in (*URGENT, *CHANNELS)}
        self._under_way = memoryview(b"")
        self.taken = self.handed = self.dropped = self.visits = 0

    @property
    def connected(self) -> bool:
        """Whether a program is there."""
        return self._program is not None

    def ring(self) -> None:
        """End a wait of `exchange`; any thread may call it."""
        with contextlib.suppress(OSError):  # it is ringing already, or all is closed
            self._rings_bell.send(b"\0")

    def hand(self, name: str, data: bytes) -> None:
        """Let a message of a channel wait for the program; without one it is left out."""
        if self._program is None:
            return
        queue = self._queues[name]
        self.dropped += len(queue) == queue.maxlen
        size = (1 + len(data)).to_bytes(SIZE_BYTES, "little")
        queue.append(b"".join((size, bytes((CHANNEL_NUMBERS[name],)), data)))

    def exchange(self, longest: float) -> list[tuple[str, bytes]]:
        """Send what waits, and wait for the program at most so long [s]; return channels and messages that came."""
        self._send()
        program, closed = self._program, time.monotonic() < self._opens
        readers = [self._hears_bell, *(() if closed else (self._door,)), *(() if program is None else (program,))]
        writers = [program] if program is not None and self._under_way else []
        ready, _, _ = select.select(readers, writers, [], longest)
        if self._hears_bell in ready:
            self._hears_bell.recv(AT_ONCE)
        frames = self._read(program) if program is not None and program in ready else []
        if self._door in ready and time.monotonic() >= self._opens:  # else one was just sent away
            self._let_in()
        return frames

    def send_away(self, why: str) -> None:
        """Close the connection, and print why."""
        self._say(f"closed the connection of {self._who}: {why}")
        self._opens = time.monotonic() + PAUSE
        self._close_program()

    def close(self) -> None:
        """Send what the system takes, and close everything."""
        self._send()
        self._close_program()
        for one in (self._door, self._hears_bell, self._rings_bell):
            one.close()

    def _let_in(self) -> None:
        try:
            program, address = self._door.accept()
        except OSError:  # who knocked is gone
            return
        if self._program is not None:
            program.close()
            if not self._told_busy:
                self._told_busy = True
                self._say("another program was not let in: it is one at a time")
            return
        program.setblocking(False)
        program.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        program.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, KERNEL_BYTES)
        program.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
        for name, value in (("TCP_KEEPIDLE", 1), ("TCP_KEEPINTVL", 1), ("TCP_USER_TIMEOUT", UNANSWERED_MS)):
            if hasattr(socket, name):  # not on every system
                program.setsockopt(socket.IPPROTO_TCP, getattr(socket, name), value)
        self.visits += 1
        self._program, self._who, self._told_busy = program, f"{address[0]}:{address[1]}", False
        self._say(f"a program has connected from {self._who}")

    def _read(self, program: socket.socket) -> list[tuple[str, bytes]]:
        try:
            data = program.recv(AT_ONCE)
        except BlockingIOError:
            return []
        except OSError as error:
            self._leave(error)
            return []
        if not data:
            self._leave()
            return []
        self._came += data
        frames, came, at = [], self._came, 0
        while len(came) - at >= SIZE_BYTES:
            size = int.from_bytes(came[at : at + SIZE_BYTES], "little")
            if not 1 < size <= 1 + LARGEST_MESSAGE:
                self.send_away(f"a frame of {size} bytes, and a message has 1 to {LARGEST_MESSAGE} and its channel one")
                break
            begin, end = at + SIZE_BYTES, at + SIZE_BYTES + size
            if len(came) < end:
                break
            if came[begin] not in NAMES:
                self.send_away(f"a frame for channel {came[begin]}, which there is not")
                break
            frames.append((NAMES[came[begin]], bytes(came[begin + 1 : end])))
            at = end
        del self._came[:at]
        self.taken += len(frames)
        return frames

    def _send(self) -> None:
        """Send what waits, as far as the system takes it."""
        while self._program is not None and (self._under_way or self._gather()):
            try:
                sent = self._program.send(self._under_way)
            except BlockingIOError:
                return
            except OSError as error:
                self._leave(error)
                return
            self._under_way = self._under_way[sent:]

    def _gather(self) -> bool:
        """Put what waits under way, at most some `AT_ONCE`; whether there is anything."""
        parts: list[bytes] = []
        size = 0
        for queue in self._queues.values():
            while queue and size < AT_ONCE:
                parts.append(queue.popleft())
                size += len(parts[-1])
        self._under_way = memoryview(b"".join(parts))
        self.handed += len(parts)
        return size > 0

    def _leave(self, error: OSError | None = None) -> None:
        """Close a connection that has ended; of a program that has just left, nothing is to be said."""
        if error is not None and error.errno == errno.ETIMEDOUT:
            self._say(f"the program at {self._who} has read nothing for {UNANSWERED_MS / 1000:g} s")
        self._close_program()

    def _close_program(self) -> None:
        if self._program is not None:
            self._program.close()
        self._program, self._under_way = None, memoryview(b"")
        self._came.clear()
        for queue in self._queues.values():
            queue.clear()
