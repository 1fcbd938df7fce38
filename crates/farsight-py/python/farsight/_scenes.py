"""Rendered traffic scenes with exact labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import overload

import numpy as np
import numpy.typing as npt

from . import _farsight
from ._arrays import Floats, Pixels, columns, pixels_from_bytes


@dataclass(frozen=True, eq=False)
class Scene:
    """A rendered image with its camera and labels; N is the number of objects. Frames are those of `farsight`."""

    image: Pixels
    """Shape (H, W, 3), uint8, red, green, blue; not to be written to."""
    P: Floats
    """The camera's projection, shape (3, 4): from camera coordinates (metres) to homogeneous pixels."""
    classes: npt.NDArray[np.str_]
    """Classes by KITTI's names, shape (N,)."""
    boxes3d: Floats
    """Shape (N, 7): x, y, z of the bottom centre, length, height, width (metres), yaw (radians)."""
    boxes2d: Floats
    """Shape (N, 4): left, top, right, bottom, pixels."""
    truncation: Floats
    """Share of each object outside the image, shape (N,), 0 to 1."""
    occlusion: npt.NDArray[np.int64]
    """Shape (N,): 0 visible, 1 partly, 2 largely occluded, 3 unknown."""

    @property
    def range_m(self) -> Floats:
        """Distances along the optical axis (KITTI's z), shape (N,), metres."""
        depths: Floats = self.boxes3d[:, 2]
        return depths


class Scenes(Sequence[Scene]):
    """Scenes of one seed, each rendered when it is asked for."""

    def __init__(self, n: int, seed: int) -> None:
        self._range = range(n)
        self._seed = seed

    def __len__(self) -> int:
        return len(self._range)

    @overload
    def __getitem__(self, index: int) -> Scene: ...

    @overload
    def __getitem__(self, index: slice) -> list[Scene]: ...

    def __getitem__(self, index: int | slice) -> Scene | list[Scene]:
        if isinstance(index, slice):
            return [self[place] for place in self._range[index]]
        pixels, (width, height), projection, labels = _farsight.render(self._range[index], self._seed)
        return Scene(
            image=pixels_from_bytes(pixels, width, height),
            P=np.array(projection, np.float64),
            classes=np.array([label[0] for label in labels], np.str_),
            boxes3d=columns([label[4] for label in labels], 7),
            boxes2d=columns([label[3] for label in labels], 4),
            truncation=np.array([label[1] for label in labels], np.float64),
            occlusion=np.array([label[2] for label in labels], np.int64),
        )

    def __iter__(self) -> Iterator[Scene]:
        return (self[place] for place in self._range)

    def __repr__(self) -> str:
        return f"farsight.render({len(self)}, seed={self._seed})"


def render(n: int, seed: int = 0) -> Scenes:
    """Traffic scenes with exact labels, the first n of a seed, as `farsight synth` renders them.

    The same n and seed give the same bytes on every machine. A scene is rendered when it is asked for.
    """
    if n < 0 or not 0 <= seed < 2**64:
        raise ValueError(f"n is {n} and seed {seed}; expected n from 0 and seed from 0, below 2**64")
    return Scenes(n, seed)
