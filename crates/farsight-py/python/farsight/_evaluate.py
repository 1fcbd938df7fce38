"""KITTI's evaluation."""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from . import _farsight
from ._result import Result


def evaluate(
    labels: str | os.PathLike[str],
    results: str | os.PathLike[str] | Mapping[str, Result] | Iterable[Result],
    *,
    resamples: int = 1000,
    seed: int = 0,
) -> dict[str, Any]:
    """KITTI's average precision and the errors of distance, as `farsight eval --json` writes them.

    Args:
        labels: Folder of label files (KITTI's `training/label_2`).
        results: Folder of result files (`farsight range --kitti`), or results, by the names of their frames or with
            images that are called as their label files.
        resamples: How often frames are drawn anew for the 95% intervals; 0 leaves them out.
        seed: Seed of the intervals.

    Returns:
        ap, ap_loose, ranging, operating, frames, scores and findings (docs/evaluation.md says what is in them). Frames
        that have labels and no results are left out, and are among the findings.

    Raises:
        ValueError: Folders or files are not what they should be; the text says which, and what was expected.
    """
    if resamples < 0:
        raise ValueError(f"resamples is {resamples}; expected 0 or more")
    if isinstance(results, (str, os.PathLike)):
        return _report(labels, results, resamples, seed)
    by_frame = dict(results) if isinstance(results, Mapping) else _by_frame(results)
    if not by_frame:
        raise ValueError("there are no results; expected at least one")
    with tempfile.TemporaryDirectory(prefix="farsight-") as folder:
        for frame, result in by_frame.items():
            if not frame or Path(frame).name != frame:
                raise ValueError(f"a frame is called {frame!r}; expected a name such as 000007")
            _farsight.write_results(Path(folder, f"{frame}.txt"), result.to_json())
        return _report(labels, folder, resamples, seed)


def _report(
    labels: str | os.PathLike[str], results: str | os.PathLike[str], resamples: int, seed: int
) -> dict[str, Any]:
    report: dict[str, Any] = json.loads(_farsight.evaluate(os.fspath(labels), os.fspath(results), resamples, seed))
    return report


def _by_frame(results: Iterable[Result]) -> dict[str, Result]:
    found: dict[str, Result] = {}
    for result in results:
        frame = Path(result.path).stem
        if frame in found:
            raise ValueError(f"two results of a frame {frame}; expected one, or a dict from the names of frames")
        found[frame] = result
    return found
