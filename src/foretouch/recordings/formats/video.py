"""Videos that are made of a camera's images: H.264 in MP4, by PyAV."""

from __future__ import annotations

import importlib
from fractions import Fraction
from pathlib import Path
from types import TracebackType
from typing import Any, Final

from foretouch.errors import MissingExtraError, RecordingError
from foretouch.recordings.source import foreign

CODEC: Final = "h264"
PIXELS: Final = "yuv420p"
OPTIONS: Final = {"crf": "18", "preset": "fast", "g": "2", "bf": "0", "threads": "2"}
"""Nearly without loss; every other image can be read alone, so that any one is found at once."""

STUDIO_RANGE, BT_601 = 1, 6
"""What players take a video's brightness and colours to be; a JPEG has the full range, so it is converted."""


def _library() -> Any:
    try:
        return importlib.import_module("av")
    except ModuleNotFoundError:
        raise MissingExtraError("av", "lerobot") from None


def read_jpeg(name: str, jpeg: bytes) -> Any:
    """An image as a frame of the library.

    Args:
        name: Name of its recording, for the error.
        jpeg: The image.

    Raises:
        RecordingError: It is none, or has an odd width or height, which the video cannot have.
        MissingExtraError: The package ``av`` is not installed.
    """
    av = _library()
    with foreign(name, "an image of its camera is no JPEG that can be read"):
        frame = av.CodecContext.create("mjpeg", "r").decode(av.Packet(jpeg))[0]
    if frame.width % 2 or frame.height % 2:
        size = f"{frame.width} x {frame.height}"
        raise RecordingError(name, f"has images of {size} pixels: width and height of a video must be even")
    return frame


class Mp4:
    """Writes a video of frames that all have the same size, one every 1 / `fps` seconds from 0 on.

    Args:
        path: The file.
        size: Width and height [pixel].
        fps: Frames a second.

    Attributes:
        path: The file.
        frames: Number of frames that were written.

    Raises:
        MissingExtraError: The package ``av`` is not installed.
    """

    def __init__(self, path: Path, size: tuple[int, int], fps: int) -> None:
        self.path, self.frames = path, 0
        path.parent.mkdir(parents=True, exist_ok=True)
        self._file = _library().open(str(path), "w", format="mp4", options={"movflags": "+faststart"})
        self._stream = self._file.add_stream("libx264", rate=fps, options=OPTIONS)
        self._stream.width, self._stream.height = size
        self._stream.pix_fmt = PIXELS
        coder = self._stream.codec_context
        coder.time_base = self._period = Fraction(1, fps)
        coder.color_range, coder.colorspace = STUDIO_RANGE, BT_601

    def write(self, frame: Any) -> None:
        """Add a frame."""
        frame = frame.reformat(format=PIXELS, dst_color_range=STUDIO_RANGE, dst_colorspace=BT_601)
        frame.pts, frame.time_base = self.frames, self._period
        self._file.mux(self._stream.encode(frame))
        self.frames += 1

    def close(self) -> None:
        """End the file."""
        self._file.mux(self._stream.encode(None))
        self._file.close()

    def __enter__(self) -> Mp4:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
