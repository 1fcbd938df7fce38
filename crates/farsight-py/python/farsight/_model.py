"""The model."""

from __future__ import annotations

import importlib.util
import os
import sys
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias, overload

import numpy as np
import numpy.typing as npt

from ._arrays import View, checked_image, view_argument
from ._farsight import Pipeline
from ._result import Result
from ._track import Frame, frames_of

if TYPE_CHECKING:
    import PIL.Image

    Image: TypeAlias = str | os.PathLike[str] | bytes | npt.NDArray[np.uint8] | PIL.Image.Image

_EXPECTED = "a path, the bytes of an image file, a numpy array, a PIL image, or a list of these"

# What answers call an image that has no name.
_UNNAMED = "image"


class Model:
    """A detector with all that follows it, ready to look at images.

    Several threads may use one model at once: Python's lock is released while it looks. A model pickles as its
    arguments, so each process that gets one loads the weights anew.

    Args:
        engine: What runs the networks: "rten" is built in, "onnxruntime" and "openvino" use the library in the package
            of that name.
        precision: "f32", with onnxruntime and openvino "int8", with openvino "bf16".
        device: "cpu", with onnxruntime "cuda" or "tensorrt", with openvino "gpu".
        threads: Threads of each network; one for each core by default.
        region: Part of the world that the images are from, by the sizes of its vehicles: "world", "europe",
            "north-america", "china", "japan" or "india"; for farsight-w.
        above_road: Height of the camera above the road, metres, where it is known: all distances become surer.
        pitch: How far down the camera looks, degrees (negative: up), where no calibration says it; by default what is
            seen tells.
        effort: How much is done for each object: "fast", "normal" or "best".
        denoise: Whether images with much noise are smoothed before the networks see them.
        model: "farsight-w", which "shipped" stands for, "farsight-s", "farsight-n", or a file that `farsight train`,
            `farsight import` or `farsight export` wrote.

    Raises:
        ValueError: An argument means nothing, or the file is no model.
        RuntimeError: The engine's library is not there, or the engine fails.
    """

    def __init__(
        self,
        *,
        engine: str = "rten",
        precision: str = "f32",
        device: str = "cpu",
        threads: int | None = None,
        region: str = "world",
        above_road: float | None = None,
        pitch: float | None = None,
        effort: str = "normal",
        denoise: bool = True,
        model: str | os.PathLike[str] = "shipped",
    ) -> None:
        _check_process()
        self._arguments: dict[str, Any] = {
            "engine": engine,
            "precision": precision,
            "device": device,
            "threads": threads,
            "region": region,
            "above_road": above_road,
            "pitch": pitch,
            "effort": effort,
            "denoise": denoise,
            "model": os.fspath(model),
        }
        library = _engine_path(engine)
        self._pipeline = Pipeline(
            os.fspath(model), engine, library, precision, device, threads, region, above_road, pitch, effort, denoise
        )
        for text in self._pipeline.notes:
            warnings.warn(text, stacklevel=2)

    @property
    def name(self) -> str:
        """Name of the detector, or its file."""
        return self._pipeline.name

    @property
    def classes(self) -> tuple[str, ...]:
        """The classes that the model knows."""
        return tuple(self._pipeline.classes)

    @overload
    def range(
        self,
        image: Image,
        *,
        hfov: float | str | None = ...,
        K: npt.ArrayLike | None = ...,
        P: npt.ArrayLike | None = ...,
        calib: str | os.PathLike[str] | None = ...,
        lens: str | None = ...,
    ) -> Result: ...

    @overload
    def range(
        self,
        image: list[Image] | tuple[Image, ...],
        *,
        hfov: float | str | None = ...,
        K: npt.ArrayLike | None = ...,
        P: npt.ArrayLike | None = ...,
        calib: str | os.PathLike[str] | None = ...,
        lens: str | None = ...,
    ) -> list[Result]: ...

    def range(
        self,
        image: Image | list[Image] | tuple[Image, ...],
        *,
        hfov: float | str | None = None,
        K: npt.ArrayLike | None = None,
        P: npt.ArrayLike | None = None,
        calib: str | os.PathLike[str] | None = None,
        lens: str | None = None,
    ) -> Result | list[Result]:
        """Finds vehicles and people and says how far away they are.

        Args:
            image: A path, the bytes of an image file, an array of shape (H, W, 3), uint8, red, green, blue (OpenCV's
                are blue, green, red: `image[..., ::-1]`), a PIL image, or a list of these. The camera is that of the
                upright image.
            hfov: Horizontal field of view of the whole image, degrees; "auto" estimates it from an image that does not
                tell.
            K: Intrinsic matrix [[fx, 0, cx], [0, fy, cy], [0, 0, 1]], shape (3, 3), pixels.
            P: Projection from camera coordinates (metres) to homogeneous pixels, shape (3, 4), as KITTI's P2.
            calib: Calibration in KITTI's format, with its road where `farsight calibrate` wrote it, or a folder with
                one for each image.
            lens: What distorts the image, in OpenCV's order: "brown:k1,k2,p1,p2,k3" or "kb4:k1,k2,k3,k4" (fisheye).
                The camera is that of the pinhole behind it.

        A file may do without a camera: KITTI's calibration beside it or its EXIF data then tell.

        Returns:
            A result, or of a list a list of results. Answers are those of `farsight range`, digit for digit.

        Raises:
            FileNotFoundError: There is no such file.
            ValueError: It is no image, no camera is known, or the array is none that is expected.
            TypeError: Something else was given.
        """
        view = view_argument(hfov, K, P, calib, lens)
        if isinstance(image, (list, tuple)):
            return [self._range(one, view) for one in image]
        return self._range(image, view)

    def _range(self, image: Any, view: View, name: str | None = None) -> Result:
        _check_process()
        name = name or _UNNAMED
        pil = sys.modules.get("PIL.Image")
        if pil is not None and isinstance(image, pil.Image):
            image = _upright(image)
        if isinstance(image, (str, os.PathLike)):
            record, pixels, warned = self._pipeline.range_path(os.fspath(image), view)
        elif isinstance(image, (bytes, bytearray, memoryview)):
            record, pixels, warned = self._pipeline.range_bytes(bytes(image), name, view)
        elif isinstance(image, np.ndarray):
            array = checked_image(image)
            if view[0] is None:
                raise ValueError("an array does not say which camera took it; expected one of hfov, K, P and calib")
            height, width = array.shape[:2]
            record, pixels, warned = self._pipeline.range_pixels(array.tobytes(), [width, height], name, view)
        else:
            raise TypeError(f"the image is a {type(image).__name__}; expected {_EXPECTED}")
        for text in warned:
            warnings.warn(text, stacklevel=3)
        return Result(record, pixels, self.classes)

    def track(
        self,
        source: str | os.PathLike[str] | list[str | os.PathLike[str]],
        *,
        hfov: float | str | None = None,
        K: npt.ArrayLike | None = None,
        P: npt.ArrayLike | None = None,
        calib: str | os.PathLike[str] | None = None,
        lens: str | None = None,
        fps: float | None = None,
        ego: str | os.PathLike[str] | None = None,
        min_score: float | None = None,
        realtime: bool = False,
        ffmpeg: str | os.PathLike[str] = "ffmpeg",
    ) -> Iterator[Frame]:
        """Follows vehicles and people through a video: identity, distance, speed, time to collision.

        Frames come one by one, each looked at when it is asked for; no more than a few are in memory. The model that
        looks has its own copy of the weights.

        Args:
            source: A film, an address (rtsp, http) or a camera device, which the program ffmpeg reads; a folder of
                images; or a list of images.
            hfov: Horizontal field of view of the whole image, degrees; "auto" estimates it from an image that does not
                tell.
            K: Intrinsic matrix, shape (3, 3), pixels.
            P: Projection, shape (3, 4).
            calib: Calibration in KITTI's format, as for `range`.
            lens: What distorts the frames, as for `range`.
            fps: Frames a second, of images only.
            ego: A file or folder that says how the camera moves, as for `farsight track --ego`; its speed also tells
                the camera's height, unless that is known. "auto" estimates the motion from the frames, with the model's
                `above_road` or a calibration with its road. Without it, and in frames that do not tell, speeds are
                relative to the camera.
            min_score: A detection of this score begins a track; lower ones may continue one.
            realtime: Look at the latest frame only, and leave out those that came in between.
            ffmpeg: The ffmpeg program.

        Returns:
            An iterator of frames. Their answers are those of `farsight track`, digit for digit. A frame that cannot be
            read is a Python warning and is left out.

        Raises:
            FileNotFoundError: There is no ffmpeg.
            ValueError: It is no video, no camera is known, or the first frame cannot be read.
        """
        _check_process()
        if min_score is not None and not 0 < min_score < 1:
            raise ValueError(f"min_score is {min_score}; expected more than 0 and less than 1")
        paths = [os.fspath(one) for one in (source if isinstance(source, (list, tuple)) else [source])]
        if not paths:
            raise ValueError("the list of images is empty; expected a video or at least one image")
        motion = None if ego is None else os.fspath(ego)
        view = view_argument(hfov, K, P, calib, lens)
        return frames_of(self._pipeline.track(paths, fps, view, motion, min_score, realtime, os.fspath(ffmpeg)))

    def __reduce__(self) -> tuple[Any, ...]:
        return _model_from, (self._arguments,)

    def __repr__(self) -> str:
        given = ", ".join(f"{name}={value!r}" for name, value in self._arguments.items())
        return f"farsight.Model({given})"


def _model_from(arguments: dict[str, Any]) -> Model:
    return Model(**arguments)


def _upright(image: PIL.Image.Image) -> npt.NDArray[np.uint8]:
    """The pixels of a PIL image as viewers show it."""
    from PIL import ImageOps

    upright = ImageOps.exif_transpose(image)
    return np.asarray((image if upright is None else upright).convert("RGB"))


def _engine_path(engine: str) -> str | None:
    """The folder of the engine's package, unless the environment names its library."""
    if engine not in ("onnxruntime", "openvino") or os.environ.get(f"FARSIGHT_{engine.upper()}"):
        return None
    found = importlib.util.find_spec(engine)
    places = None if found is None else found.submodule_search_locations
    return str(Path(next(iter(places))).parent) if places else None


_first_process: int | None = None


def _check_process() -> None:
    """Threads do not survive a fork: a network that was started before it would wait for them for ever."""
    global _first_process
    if _first_process is None:
        _first_process = os.getpid()
    if _first_process != os.getpid():
        raise RuntimeError(
            'farsight was in use before this process was forked; expected the start method "spawn" or "forkserver" '
            "(multiprocessing.get_context), or no farsight.Model in the parent"
        )
