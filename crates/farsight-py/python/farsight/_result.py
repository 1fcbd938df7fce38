"""What was found in one image."""

from __future__ import annotations

import os
import warnings
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from . import _farsight
from ._arrays import Floats, Pixels, pixels_from_bytes
from ._objects import Objects

if TYPE_CHECKING:
    import fiftyone
    import pandas
    import supervision


class Result(Objects):
    """What was found in one image, highest score first.

    N is the number of objects; all arrays have their objects in the same order. Lengths are metres, angles radians.
    Frames of reference are in the docstring of `farsight`. A result pickles with its image.
    """

    def __init__(self, record: str, pixels: bytes, names: tuple[str, ...]) -> None:
        super().__init__(record, "detections")
        self._pixels = pixels
        self._names = names

    @property
    def path(self) -> str:
        """The path that was given, or "image"."""
        return str(self._record["image"])

    @property
    def image(self) -> Pixels:
        """The upright image, shape (H, W, 3), uint8, red, green, blue; not to be written to."""
        return pixels_from_bytes(self._pixels, self._record["width"], self._record["height"])

    @property
    def P(self) -> Floats:
        """The camera's projection, shape (3, 4): from camera coordinates (metres) to homogeneous pixels."""
        return np.array(self._record["camera"]["projection"], np.float64)

    @property
    def pitch_deg(self) -> float:
        """How far down the camera was taken to look, degrees; 0 where nothing said so. Boxes stand upright on the road,
        not across the camera's axis."""
        return float(self._record["camera"].get("pitch_deg", 0.0))

    @property
    def alpha(self) -> Floats:
        """Observation angles, shape (N,), radians."""
        return self._numbers("alpha")

    @property
    def interval_68_m(self) -> Floats:
        """As interval_m, with a probability of 68%."""
        return self._rows("range_interval_68_m", 2)

    @property
    def interval_50_m(self) -> Floats:
        """As interval_m, with a probability of 50%."""
        return self._rows("range_interval_50_m", 2)

    @property
    def class_ids(self) -> npt.NDArray[np.int64]:
        """Places of the classes in `farsight.Model.classes`, shape (N,)."""
        places = {name: place for place, name in enumerate(self._names)}
        return np.array([places[one["class"]] for one in self._objects], np.int64)

    def plot(self, path: str | os.PathLike[str] | None = None) -> Pixels:
        """The image with boxes, distances and the view from above, as `farsight range --out` draws it.

        An image of 12 megapixels and more is drawn at 1/2, 1/3 ... of its size, which a Python warning says.

        Args:
            path: Where to write it as a PNG file, too.

        Returns:
            Shape (H, W, 3), uint8, red, green, blue; not to be written to.
        """
        pixels, (width, height), divisor = _farsight.draw(self._pixels, self._json)
        if divisor > 1:
            warnings.warn(f"{self.path}: a large image, drawn at 1/{divisor} of its size", stacklevel=2)
        if path is not None:
            _farsight.png(pixels, [width, height], os.fspath(path))
        return pixels_from_bytes(pixels, width, height)

    def to_pandas(self) -> pandas.DataFrame:
        """One row an object; needs pandas.

        Columns: class, score, x1, y1, x2, y2 (pixels), x, y, z, length, height, width (metres), yaw, alpha (radians),
        range_m, range_sigma_m, range_low_m, range_high_m (the interval of 90%).
        """
        try:
            import pandas
        except ImportError as error:
            raise _missing("pandas") from error
        table: dict[str, Any] = {"class": self.classes.astype(object), "score": self.scores}
        table.update(zip(("x1", "y1", "x2", "y2"), self.boxes2d.T))
        table.update(zip(("x", "y", "z", "length", "height", "width", "yaw"), self.boxes3d.T))
        table.update(alpha=self.alpha, range_m=self.range_m, range_sigma_m=self.range_sigma_m)
        table.update(zip(("range_low_m", "range_high_m"), self.interval_m.T))
        return pandas.DataFrame(table)

    def to_supervision(self) -> supervision.Detections:
        """`supervision.Detections` of the boxes in the image; needs supervision.

        Its `data` has class_name, boxes3d, range_m, range_sigma_m and interval_m as here.
        """
        try:
            import supervision
        except ImportError as error:
            raise _missing("supervision") from error
        data: dict[str, Any] = {
            "class_name": self.classes,
            "boxes3d": self.boxes3d,
            "range_m": self.range_m,
            "range_sigma_m": self.range_sigma_m,
            "interval_m": self.interval_m,
        }
        return supervision.Detections(xyxy=self.boxes2d, confidence=self.scores, class_id=self.class_ids, data=data)

    def to_fiftyone(self) -> fiftyone.Detections:
        """`fiftyone.Detections` with boxes in the image and in space; needs fiftyone.

        Boxes in the image are shares of its sides: left, top, width, height. In space, `location` is the centre of the
        box in camera coordinates, `dimensions` are length, height, width, and `rotation` is [0, yaw, 0]. range_m,
        range_sigma_m and interval_m are further fields; those that are not known are None.
        """
        try:
            import fiftyone
        except ImportError as error:
            raise _missing("fiftyone") from error
        width, height = self._record["width"], self._record["height"]
        detections = []
        for one in self._objects:
            left, top, right, bottom = one["box2d"]
            (x, y, z), (tall, wide, long) = one["location"], one["dimensions_hwl"]
            detections.append(
                fiftyone.Detection(
                    label=one["class"],
                    confidence=one["score"],
                    bounding_box=[left / width, top / height, (right - left) / width, (bottom - top) / height],
                    location=[x, y - tall / 2, z],
                    dimensions=[long, tall, wide],
                    rotation=[0.0, one["rotation_y"], 0.0],
                    range_m=one["range_m"],
                    range_sigma_m=one["range_sigma_m"],
                    interval_m=one["range_interval_m"],
                )
            )
        return fiftyone.Detections(detections=detections)

    def _repr_png_(self) -> bytes:
        pixels, size, _ = _farsight.draw(self._pixels, self._json)
        png = _farsight.png(pixels, size)
        assert png is not None
        return png

    def __repr__(self) -> str:
        found = ", ".join(f"{one['class']} {one['range_m']:.1f} m" for one in self._objects)
        return f"<farsight.Result of {self.path}: {found or 'nothing found'}>"

    def __reduce__(self) -> tuple[Any, ...]:
        return Result, (self._json, self._pixels, self._names)


def _missing(package: str) -> ImportError:
    return ImportError(f"to_{package}() needs {package}, which is not installed: pip install {package}")
