"""What happens to a camera's images on the way: noise, JPEG, a hand, glare, a stream that stops."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from foretouch.errors import SettingError, UnknownNameError
from foretouch.quantities import shortest
from foretouch.vision.camera import opencv

IMAGE_FAULTS = ("hand", "glare", "frozen", "dropped")
"""A hand before the lens, light that blinds a part of it, the same image again and again, no image."""

Image = NDArray[np.uint8]


@dataclass(frozen=True, slots=True)
class ImageFault:
    """One thing that goes wrong with the images from a beginning to an end.

    Args:
        kind: One of `IMAGE_FAULTS`.
        begin: [s].
        end: [s]; infinite is for good.
        where: Middle of hand or glare, as fractions of width and height.
        size: Its radius, as a fraction of the height.

    Raises:
        SettingError: A number out of its range.
        UnknownNameError: No such kind.
    """

    kind: str
    begin: float = 0.0
    end: float = math.inf
    where: tuple[float, float] = (0.5, 0.5)
    size: float = 0.35

    def __post_init__(self) -> None:
        if self.kind not in IMAGE_FAULTS:
            raise UnknownNameError("image fault", self.kind, IMAGE_FAULTS)
        if not (math.isfinite(self.begin) and self.begin < self.end):
            raise SettingError("begin", self.begin, "must be finite and before the end")
        if not all(-1.0 <= fraction <= 2.0 for fraction in self.where):
            raise SettingError("where", self.where, "must be shares of the image, -1 to 2")
        if not 0.0 < self.size <= 3.0:
            raise SettingError("size", self.size, "must be above 0 and at most 3")

    def __str__(self) -> str:
        """The text that `from_text` reads, without `where` and `size`."""
        return f"{self.kind}:{shortest(self.begin)}:{shortest(self.end)}"

    @classmethod
    def from_text(cls, name: str, text: str) -> ImageFault:
        """The fault of ``KIND:BEGIN:END``, seconds; an error names the setting.

        Raises:
            SettingError: Another form, or a number out of its range.
            UnknownNameError: No such kind.
        """
        try:
            kind, begin, end = text.split(":")
            if not -math.inf < float(begin) < float(end):
                raise SettingError(name, text, "must end after it begins: KIND:BEGIN:END in seconds, such as hand:5:8")
            return cls(kind, float(begin), float(end))
        except ValueError:
            raise SettingError(name, text, "must be KIND:BEGIN:END in seconds, such as hand:5:8") from None


@dataclass(slots=True)
class FaultyCamera:
    """Images as they come out of a camera: sensor noise, faults, JPEG. The same seed gives the same images.

    Args:
        noise: Standard deviation of each colour of each pixel, of 255.
        quality: Quality of JPEG, 1 to 100; None leaves it out.
        faults: Faults of the images.
        seed: Seed of the noise.

    Raises:
        SettingError: A number out of its range.
    """

    noise: float = 2.0
    quality: int | None = 80
    faults: tuple[ImageFault, ...] = ()
    seed: int = 0
    _random: np.random.Generator = field(init=False)
    _last: Image | None = field(init=False, default=None)
    _jpeg: bytes = field(init=False, default=b"")

    def __post_init__(self) -> None:
        if not 0.0 <= self.noise <= 100.0:
            raise SettingError("noise", self.noise, "must be 0 to 100")
        if self.quality is not None and not 1 <= self.quality <= 100:
            raise SettingError("quality", self.quality, "must be 1 to 100, or none")
        if not 0 <= self.seed < 2**63:
            raise SettingError("seed", self.seed, "must be a whole number from 0")
        self._random = np.random.default_rng(self.seed)

    def take(self, image: Image, time: float) -> Image | None:
        """The image that comes out at a time [s] of what the lens shows, (h, w, 3) RGB; None where none does."""
        now = {fault.kind: fault for fault in self.faults if fault.begin <= time < fault.end}
        if "dropped" in now:
            return None
        if "frozen" in now and self._last is not None:
            return self._last.copy()
        pixels = image.astype(np.float32)
        for kind, colour in (("hand", (186.0, 135.0, 110.0)), ("glare", (330.0, 330.0, 330.0))):
            if kind in now:
                cover = _spot(image.shape, now[kind], soft=0.02 if kind == "hand" else 0.5)
                pixels += cover[:, :, None] * (np.asarray(colour, np.float32) - pixels)
        pixels += self.noise * self._random.standard_normal(image.shape, np.float32)
        self._last = np.clip(np.rint(pixels), 0, 255).astype(np.uint8)
        if self.quality is not None:
            cv2 = opencv()
            _, data = cv2.imencode(".jpg", self._last[:, :, ::-1], [cv2.IMWRITE_JPEG_QUALITY, self.quality])
            self._jpeg = data.tobytes()
            self._last = np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[:, :, ::-1])
        return self._last.copy()

    @property
    def jpeg(self) -> bytes:
        """The newest image that came out, compressed; empty before the first, or without compression."""
        return self._jpeg


def _spot(shape: tuple[int, ...], fault: ImageFault, soft: float) -> NDArray[np.float32]:
    """A disc of 1 that falls to 0 over a fraction of its radius, (height, width)."""
    height, width = shape[:2]
    rows, columns = np.ogrid[:height, :width]
    far = np.hypot(columns - fault.where[0] * width, rows - fault.where[1] * height) / (fault.size * height)
    cover: NDArray[np.float32] = np.clip((1.0 - far) / soft, 0.0, 1.0).astype(np.float32)
    return cover
