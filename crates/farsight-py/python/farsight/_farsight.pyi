"""The native module; `farsight` is what to use."""

import os
from collections.abc import Sequence
from typing import Any, final

__all__ = ["Pipeline", "Video", "__version__", "draw", "evaluate", "png", "render", "write_results"]

__version__: str

_Path = str | os.PathLike[str]
# Camera (field of view, K, P or calibration) and lens, where they are given.
_View = tuple[float | bool | Sequence[Sequence[float]] | str | None, str | None]
# The JSON of `farsight track`, pixels, width and height, projection.
_Followed = tuple[str, bytes, list[int], list[list[float]]]
# The JSON of `farsight range`, the upright pixels, warnings.
_Answer = tuple[str, bytes, list[str]]

@final
class Pipeline:
    def __new__(
        cls,
        model: _Path,
        engine: str,
        engine_path: _Path | None,
        precision: str,
        device: str,
        threads: int | None,
        region: str,
        above_road: float | None,
        pitch: float | None,
        effort: str,
        denoise: bool,
    ) -> Pipeline: ...
    @property
    def name(self) -> str: ...
    @property
    def notes(self) -> list[str]: ...
    @property
    def classes(self) -> list[str]: ...
    def range_path(self, path: _Path, view: _View) -> _Answer: ...
    def range_bytes(self, bytes: bytes, name: _Path, view: _View) -> _Answer: ...
    def range_pixels(self, pixels: bytes, size: Sequence[int], name: _Path, view: _View) -> _Answer: ...
    def track(
        self,
        source: Sequence[_Path],
        fps: float | None,
        view: _View,
        ego: _Path | None,
        min_score: float | None,
        realtime: bool,
        ffmpeg: _Path,
    ) -> Video: ...

@final
class Video:
    def next_frame(self) -> tuple[_Followed | None, list[str]]: ...
    @property
    def dropped(self) -> int: ...

# Pixels, width and height, and by which number the sides of the image were divided.
def draw(pixels: bytes, record: str) -> tuple[bytes, list[int], int]: ...
def png(pixels: bytes, size: Sequence[int], path: _Path | None = None) -> bytes | None: ...
def evaluate(labels: _Path, results: _Path, resamples: int, seed: int) -> str: ...
def write_results(path: _Path, record: str) -> None: ...
def render(index: int, seed: int) -> tuple[bytes, list[int], list[list[float]], list[Any]]: ...
