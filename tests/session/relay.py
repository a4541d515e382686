"""A TCP relay that stands for a network: it can be cut and mended, and can hold up what it carries.

As a script, `relay.py PORT TARGET_PORT`, it takes one command a line: ``cut``, ``mend``, ``hold SECONDS``, and answers
each with ``ok``. It is a process of its own, so that nothing in a test makes it late.
"""

from __future__ import annotations

import asyncio
import subprocess
import sys
from contextlib import suppress

HOST = "127.0.0.1"


class Relay:
    def __init__(self, port: int, target: int) -> None:
        command = [sys.executable, __file__, str(port), str(target)]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self._answer()

    def cut(self) -> None:
        self._say("cut")

    def mend(self) -> None:
        """Let connections in again; those from before the cut are dead, and what was in them is lost."""
        self._say("mend")

    def hold(self, seconds: float) -> None:
        """Let nothing pass for so long, then all of it at once."""
        self._say(f"hold {seconds}")

    def close(self) -> None:
        self.process.kill()
        self.process.communicate()

    def _say(self, text: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(text + "\n")
        self.process.stdin.flush()
        self._answer()

    def _answer(self) -> None:
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ok\n"


class _Wire:
    def __init__(self, port: int, target: int) -> None:
        self._port, self._target = port, target
        self._passing = asyncio.Event()
        self._server: asyncio.Server | None = None
        self._writers: set[asyncio.StreamWriter] = set()

    async def mend(self) -> None:
        for writer in self._writers:
            writer.transport.abort()
        self._writers.clear()
        self._passing.set()  # who waits writes to what is closed, and ends
        self._passing = asyncio.Event()
        self._passing.set()
        self._server = await asyncio.start_server(self._connect, HOST, self._port)

    def cut(self) -> None:
        self._passing.clear()
        if self._server is not None:
            self._server.close()

    def hold(self, seconds: float) -> None:
        self._passing.clear()
        asyncio.get_running_loop().call_later(seconds, self._passing.set)

    async def _connect(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            far_reader, far_writer = await asyncio.open_connection(HOST, self._target)
        except OSError:
            writer.transport.abort()
            return
        self._writers |= {writer, far_writer}
        await asyncio.gather(self._pass(reader, far_writer), self._pass(far_reader, writer))

    async def _pass(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        passing = self._passing
        with suppress(OSError):
            while data := await reader.read(1 << 16):
                await passing.wait()
                writer.write(data)
                await writer.drain()
        writer.transport.abort()
        self._writers.discard(writer)


async def _main(port: int, target: int) -> None:
    wire = _Wire(port, target)
    await wire.mend()
    print("ok", flush=True)  # noqa: T201
    while line := await asyncio.to_thread(sys.stdin.readline):
        match line.split():
            case ["cut"]:
                wire.cut()
            case ["mend"]:
                await wire.mend()
            case ["hold", seconds]:
                wire.hold(float(seconds))
        print("ok", flush=True)  # noqa: T201


if __name__ == "__main__":
    asyncio.run(_main(int(sys.argv[1]), int(sys.argv[2])))
