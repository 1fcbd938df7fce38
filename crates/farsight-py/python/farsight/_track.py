"""What is followed through a video."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Floats, Pixels, columns, pixels_from_bytes
from ._farsight import Video


class Frame:
    """One frame of a video and the tracks in it, those that coast included.

    N is the number of tracks; all arrays have them in the same order. Lengths are metres, speeds metres a second,
    angles radians. Velocities are relative to the camera, in its coordinates. What is not known yet is NaN. Frames of
    reference are in the docstring of `farsight`.
    """

    def __init__(self, record: str, pixels: bytes, size: list[int], projection: list[list[float]]) -> None:
        self._json = record
        self._pixels = pixels
        self._size = size
        self._projection = projection
        self._record: dict[str, Any] = json.loads(record)

    def to_dict(self) -> dict[str, Any]:
        """The object that `farsight track --json` writes for this frame (docs/video.md says what is in it)."""
        copy: dict[str, Any] = json.loads(self._json)
        return copy

    def to_json(self) -> str:
        """The line that `farsight track --json -` prints for this frame, digit for digit."""
        return self._json

    @property
    def frame(self) -> int:
        """Its number, from 0; frames that cannot be read count."""
        return int(self._record["frame"])

    @property
    def time_s(self) -> float:
        """Its time, seconds."""
        return float(self._record["time_s"])

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
        return np.array([one["id"] for one in self._record["tracks"]], np.int64)

    @property
    def classes(self) -> npt.NDArray[np.str_]:
        """Classes by KITTI's names, shape (N,), strings."""
        return np.array([one["class"] for one in self._record["tracks"]], np.str_)

    @property
    def scores(self) -> Floats:
        """Scores of the latest detections, shape (N,), 0 to 1."""
        return self._numbers("score")

    @property
    def coasting(self) -> npt.NDArray[np.bool_]:
        """Whether nothing was seen of each in this frame, shape (N,)."""
        return np.array([one["coasting"] for one in self._record["tracks"]], np.bool_)

    @property
    def boxes3d(self) -> Floats:
        """Boxes in camera coordinates, shape (N, 7): x, y, z of the bottom centre, length, height, width, yaw."""
        found = self._record["tracks"]
        rows = [[*one["location"], *(one["dimensions_hwl"][i] for i in (2, 0, 1)), one["rotation_y"]] for one in found]
        return columns(rows, 7)

    @property
    def boxes2d(self) -> Floats:
        """Boxes in the image, shape (N, 4): left, top, right, bottom, pixels."""
        return columns([one["box2d"] for one in self._record["tracks"]], 4)

    @property
    def range_m(self) -> Floats:
        """Distances along the optical axis, shape (N,), metres."""
        return self._numbers("range_m")

    @property
    def range_sigma_m(self) -> Floats:
        """Standard deviations of the distances, shape (N,), metres."""
        return self._numbers("range_sigma_m")

    @property
    def velocity_mps(self) -> Floats:
        """Velocities to the right, down and ahead, shape (N, 3)."""
        unknown = [np.nan] * 3
        return columns([one["velocity_mps"] or unknown for one in self._record["tracks"]], 3)

    @property
    def closing_mps(self) -> Floats:
        """By so much the distances shrink in a second, shape (N,)."""
        return self._numbers("closing_mps")

    @property
    def ttc_s(self) -> Floats:
        """Times to collision, shape (N,), seconds; NaN unless it surely closes."""
        return self._numbers("ttc_s")

    def __len__(self) -> int:
        return len(self._record["tracks"])

    def __repr__(self) -> str:
        found = ", ".join(f"#{one['id']} {one['class']} {one['range_m']:.1f} m" for one in self._record["tracks"])
        return f"<farsight.Frame {self.frame} at {self.time_s:.2f} s: {found or 'no tracks'}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return Frame, (self._json, self._pixels, self._size, self._projection)

    def _numbers(self, name: str) -> Floats:
        values = (one[name] for one in self._record["tracks"])
        return np.array([np.nan if value is None else value for value in values], np.float64)


def frames_of(video: Video) -> Iterator[Frame]:
    """The frames one by one, each looked at when it is asked for."""
    while True:
        answer, warned = video.next_frame()
        for text in warned:
            warnings.warn(text, stacklevel=2)
        if answer is None:
            return
        yield Frame(*answer)
