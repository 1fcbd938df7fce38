"""What answers about an image and about a frame have in common."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import numpy.typing as npt

from ._arrays import Floats, columns


class Objects:
    """Objects of an answer in JSON; N is their number, and all arrays have them in the same order."""

    def __init__(self, record: str, key: str) -> None:
        self._json = record
        self._record: dict[str, Any] = json.loads(record)
        self._objects: list[dict[str, Any]] = self._record[key]

    def to_dict(self) -> dict[str, Any]:
        """The object that the program writes with `--json` (docs/guide.md and docs/video.md say what is in it)."""
        copy: dict[str, Any] = json.loads(self._json)
        return copy

    def to_json(self) -> str:
        """The line that the program prints, digit for digit: `range --format jsonl`, `track --json -`."""
        return self._json

    @property
    def classes(self) -> npt.NDArray[np.str_]:
        """Classes by KITTI's names, shape (N,), strings."""
        return np.array([one["class"] for one in self._objects], np.str_)

    @property
    def scores(self) -> Floats:
        """Scores, shape (N,), 0 to 1, of a track its latest; of the shipped models the probability that it is right."""
        return self._numbers("score")

    @property
    def boxes3d(self) -> Floats:
        """Boxes in camera coordinates, shape (N, 7): x, y, z of the bottom centre, length, height, width, yaw."""
        rows = [
            [*one["location"], *(one["dimensions_hwl"][i] for i in (2, 0, 1)), one["rotation_y"]]
            for one in self._objects
        ]
        return columns(rows, 7)

    @property
    def boxes2d(self) -> Floats:
        """Boxes in the image, shape (N, 4): left, top, right, bottom, pixels."""
        return columns([one["box2d"] for one in self._objects], 4)

    @property
    def range_m(self) -> Floats:
        """Distances along the optical axis (KITTI's z), shape (N,), metres."""
        return self._numbers("range_m")

    @property
    def range_sigma_m(self) -> Floats:
        """Standard deviations of the distances, shape (N,), metres; NaN of a model without error bars."""
        return self._numbers("range_sigma_m")

    @property
    def interval_m(self) -> Floats:
        """The distances lie between these with a probability of 90%, shape (N, 2), metres; NaN without error bars."""
        return self._rows("range_interval_m", 2)

    def __len__(self) -> int:
        return len(self._objects)

    def _numbers(self, name: str) -> Floats:
        """A number of each object; what is not known is NaN."""
        return np.array([np.nan if one[name] is None else one[name] for one in self._objects], np.float64)

    def _rows(self, name: str, width: int) -> Floats:
        """So many numbers of each object; what is not known is NaN."""
        return columns([one[name] or [np.nan] * width for one in self._objects], width)
