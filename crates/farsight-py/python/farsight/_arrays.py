"""Arrays as they come in and go out."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
Pixels = npt.NDArray[np.uint8]


def checked_image(image: npt.NDArray[Any]) -> Pixels:
    """The array, if it is an image."""
    if image.dtype != np.uint8 or image.ndim != 3 or image.shape[2] != 3 or image.size == 0:
        raise ValueError(
            f"the array is {image.dtype} of shape {image.shape}; expected uint8 of shape (H, W, 3), "
            "red, green, blue, with at least one pixel"
        )
    return image


def pixels_from_bytes(pixels: bytes, width: int, height: int) -> Pixels:
    """Pixels of shape (H, W, 3), not to be written to."""
    return np.frombuffer(pixels, np.uint8).reshape(height, width, 3)


def columns(rows: list[Any], width: int) -> Floats:
    """An array of shape (N, width), for no rows too."""
    return np.array(rows, np.float64).reshape(len(rows), width)


View = tuple[float | bool | list[list[float]] | str | None, str | None]
"""Camera (field of view, matrix or calibration file) and lens, where they are given."""


def view_argument(
    hfov: float | str | None, K: Any, P: Any, calib: str | os.PathLike[str] | None, lens: str | None
) -> View:
    """The one camera that was given, if one was, and the lens."""
    return _camera(hfov, K, P, calib), lens


def _camera(
    hfov: float | str | None, K: Any, P: Any, calib: str | os.PathLike[str] | None
) -> float | bool | list[list[float]] | str | None:
    ways = (("hfov", hfov), ("K", K), ("P", P), ("calib", calib))
    given = [name for name, value in ways if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)} are given; expected one of hfov, K, P and calib")
    if hfov == "auto":
        return True
    if isinstance(hfov, str):
        raise ValueError(f'hfov is {hfov!r}; expected degrees or "auto"')
    if hfov is not None:
        return float(hfov)
    if calib is not None:
        return os.fspath(calib)
    for name, value, shape in (("K", K, (3, 3)), ("P", P, (3, 4))):
        if value is not None:
            matrix = np.asarray(value, np.float64)
            if matrix.shape != shape:
                raise ValueError(f"{name} has the shape {matrix.shape}; expected {shape}")
            rows: list[list[float]] = matrix.tolist()
            return rows
    return None
