"""Arrays as they come in and go out."""

from __future__ import annotations

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


def camera_argument(hfov: float | None, K: Any, P: Any) -> float | list[list[float]] | None:
    """The one camera that was given, if one was."""
    given = [name for name, value in (("hfov", hfov), ("K", K), ("P", P)) if value is not None]
    if len(given) > 1:
        raise ValueError(f"{' and '.join(given)} are given; expected one of hfov, K and P")
    if hfov is not None:
        return float(hfov)
    for name, value, shape in (("K", K, (3, 3)), ("P", P, (3, 4))):
        if value is not None:
            matrix = np.asarray(value, np.float64)
            if matrix.shape != shape:
                raise ValueError(f"{name} has the shape {matrix.shape}; expected {shape}")
            rows: list[list[float]] = matrix.tolist()
            return rows
    return None
