"""A side of a foretouch session beside LeRobot's loop, and the newest message that it sends."""

import os
import signal
import subprocess
import sys
import tempfile
import time

from foretouch.link import ZenohLink


class Side:
    """One side in a process of its own, for 1 kHz needs an interpreter that nobody else holds.

    Args:
        words: The command line behind ``foretouch``.
        endpoint: Where the side listens.
        channel: Channel whose newest message is kept.
    """

    def __init__(self, words, endpoint, channel):
        self.newest = None
        self._said = tempfile.TemporaryFile("w+")  # noqa: SIM115 - it lasts as long as the side
        command = [sys.executable, "-m", "foretouch", *words, "--parent", str(os.getpid())]
        self._process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=self._said)
        self.link = ZenohLink(connect=[endpoint], subscribe=[channel], watch=self._take)

    def _take(self, message):
        self.newest = message  # latest wins: LeRobot looks at it 30 times a second

    def wait(self, patience, wanted=lambda message: True):
        """The newest message, waited for until it is as wanted; a ConnectionError says what the side said instead."""
        end = time.monotonic() + patience
        while (newest := self.newest) is None or not wanted(newest):
            if self._process.poll() is not None or time.monotonic() > end:
                self._said.seek(0)
                raise ConnectionError(f"foretouch has not begun: {self._said.read().strip() or 'it waits'}")
            time.sleep(0.01)
        return newest

    def close(self):
        """End the side in order: a robot that presses unloads first."""
        self.link.close()
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        try:
            self._process.wait(15.0)
        except subprocess.TimeoutExpired:
            self._process.kill()
        self._said.close()
