"""What is followed through a video."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Floats, Pixels, pixels_from_bytes
from ._farsight import Video
from ._objects import Objects


class Frame(Objects):
    """One frame of a video and the tracks in it, those that coast included.

    N is the number of tracks; all arrays have them in the same order. Lengths are metres, speeds metres a second,
    angles radians. Velocities are relative to the camera, in its coordinates. What is not known yet is NaN. Frames of
    reference are in the docstring of `farsight`.
    """

    def __init__(self, record: str, pixels: bytes, size: list[int], projection: list[list[float]]) -> None:
        super().__init__(record, "tracks")
        self._pixels = pixels
        self._size = size
        self._projection = projection

    @property
    def frame(self) -> int:
        """Its number, from 0; frames that cannot be read count."""
        return int(self._record["frame"])

    @property
    def time_s(self) -> float:
        """Its time, seconds."""
        return float(self._record["time_s"])

    @property
    def ego(self) -> dict[str, float] | None:
        """How the camera moves, where that is known: `speed_mps`, `speed_sigma_mps`, `yaw_rate` (rad/s, to the left)
        and `yaw_rate_sigma`."""
        motion: dict[str, float] | None = self.to_dict().get("ego")
        return motion

    @property
    def tracks(self) -> list[dict[str, Any]]:
        """The tracks one by one, with the fields that `farsight track --json` writes."""
        tracks: list[dict[str, Any]] = self.to_dict()["tracks"]
        return tracks

    @property
    def image(self) -> Pixels:
        """The frame, shape (H, W, 3), uint8, red, green, blue; not to be written to."""
        return pixels_from_bytes(self._pixels, self._size[0], self._size[1])

    @property
    def P(self) -> Floats:
        """The camera's projection, shape (3, 4): from camera coordinates (metres) to homogeneous pixels."""
        return np.array(self._projection, np.float64)

    @property
    def ids(self) -> npt.NDArray[np.int64]:
        """Identities, shape (N,), from 1; an object keeps its own."""
        return np.array([one["id"] for one in self._objects], np.int64)

    @property
    def coasting(self) -> npt.NDArray[np.bool_]:
        """Whether nothing was seen of each in this frame, shape (N,)."""
        return np.array([one["coasting"] for one in self._objects], np.bool_)

    @property
    def velocity_mps(self) -> Floats:
        """Velocities to the right, down and ahead, shape (N, 3)."""
        return self._rows("velocity_mps", 3)

    @property
    def closing_mps(self) -> Floats:
        """By so much the distances shrink in a second, shape (N,)."""
        return self._numbers("closing_mps")

    @property
    def ttc_s(self) -> Floats:
        """Times to collision, shape (N,), seconds; NaN unless it surely closes."""
        return self._numbers("ttc_s")

    def __repr__(self) -> str:
        found = ", ".join(f"#{one['id']} {one['class']} {one['range_m']:.1f} m" for one in self._objects)
        return f"<farsight.Frame {self.frame} at {self.time_s:.2f} s: {found or 'no tracks'}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return Frame, (self._json, self._pixels, self._size, self._projection)


def frames_of(video: Video) -> Iterator[Frame]:
    """The frames one by one, each looked at when it is asked for."""
    while True:
        answer, warned = video.next_frame()
        for text in warned:
            warnings.warn(text, stacklevel=2)
        if answer is None:
            return
        yield Frame(*answer)
