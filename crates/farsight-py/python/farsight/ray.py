"""Many images on many machines: a model as a stage of a Ray Data pipeline. Needs `ray[data]`.

    import farsight.ray
    import ray

    photos = ray.data.read_binary_files("photos", include_paths=True)
    found = farsight.ray.map(photos, hfov=65, concurrency=8)
    found.write_json("found")

Every worker needs the wheel. A worker that dies is started anew, and Ray gives what it had to do to others: every image
is answered once.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from ._arrays import View, view_argument

if TYPE_CHECKING:
    import ray.data

    from ._model import Model

# Columns that hold images, of which answers have no need.
_IMAGES = ("bytes", "image")

# Batches that wait at a worker while it looks at one: enough that it never waits, and no more than that in memory.
_WAITING = 2


def map(
    dataset: ray.data.Dataset,
    *,
    hfov: float | str | None = None,
    K: npt.ArrayLike | None = None,
    P: npt.ArrayLike | None = None,
    calib: str | os.PathLike[str] | None = None,
    lens: str | None = None,
    batch_size: int = 8,
    concurrency: int | tuple[int, int] = 1,
    num_cpus: int = 2,
    ray_options: dict[str, Any] | None = None,
    **model: Any,
) -> ray.data.Dataset:
    """Looks at every image of a Ray dataset.

    Each worker is an actor that loads the model once and looks at batches. Ray hands out batches as workers get free,
    two at most wait at each, so images do not pile up in memory.

    Args:
        dataset: Rows with one of these columns: "bytes" (an image file in memory, as `ray.data.read_binary_files`
            gives), "image" (an array of shape (H, W, 3), uint8, red, green, blue, as `ray.data.read_images` gives), or
            "path" alone (a file that all workers can read). A path beside an image is its name.
        hfov: Horizontal field of view of the whole image, degrees; "auto" estimates it from an image that does not
            tell. Without a camera, a column "hfov" tells it image by image, or files tell it themselves, as for
            `farsight.Model.range`.
        K: Intrinsic matrix, shape (3, 3), pixels.
        P: Projection, shape (3, 4).
        calib: Calibration in KITTI's format, as for `farsight.Model.range`; a file that all workers can read.
        lens: What distorts the images, as for `farsight.Model.range`.
        batch_size: Images that are handed out together.
        concurrency: How many workers, or the fewest and the most.
        num_cpus: Cores of each worker; its networks have as many threads.
        ray_options: Further options of `ray.data.Dataset.map_batches`, such as `{"resources": {"photos": 1}}`.
        model: Arguments of `farsight.Model`: `model="farsight-s"`, `engine="onnxruntime"`.

    Returns:
        A dataset with the other columns, and two more. "json" is the line that `farsight range --format jsonl` prints
        for the image (`farsight.Result.to_json`), or None where it failed; "error" then says why, and is None
        otherwise.

    Raises:
        ImportError: Ray Data is not installed.
        ValueError: An argument means nothing, or more than one camera is given.
    """
    try:
        import ray.data
    except ImportError as error:
        raise ImportError('farsight.ray needs Ray Data, which is not installed: pip install "ray[data]"') from error
    fewest, most = (concurrency, concurrency) if isinstance(concurrency, int) else concurrency
    pool = ray.data.ActorPoolStrategy(min_size=fewest, max_size=most, max_tasks_in_flight_per_actor=1 + _WAITING)
    arguments = {"threads": num_cpus, **model}
    found: ray.data.Dataset = dataset.map_batches(
        _worker(),
        fn_constructor_args=(arguments, view_argument(hfov, K, P, calib, lens)),
        batch_size=batch_size,
        batch_format="numpy",
        compute=pool,
        num_cpus=num_cpus,
        **(ray_options or {}),
    )
    return found


def _worker() -> type:
    """The class of the actors. It travels as a whole, so that a machine without the wheel can say what it lacks."""

    class Worker:
        def __init__(self, arguments: dict[str, Any], view: Any) -> None:
            try:
                import farsight.ray
            except ModuleNotFoundError as error:
                raise RuntimeError(
                    f"this Ray worker has no {error.name}; expected the wheel on every machine: pip install farsight, "
                    'or ray.init(runtime_env={"pip": ["farsight-....whl"]})'
                ) from error
            self.model = farsight.Model(**arguments)
            self.view = view
            self.look = farsight.ray._look

        def __call__(self, batch: dict[str, Any]) -> dict[str, Any]:
            return self.look(self.model, self.view, batch)

    return Worker


def _look(model: Model, view: View, batch: dict[str, Any]) -> dict[str, Any]:
    """Answers a batch: columns with a value for each image."""
    column = next((name for name in (*_IMAGES, "path") if name in batch), None)
    if column is None:
        raise ValueError(f'the dataset has the columns {sorted(batch)}; expected one of "bytes", "image" and "path"')
    answers: list[str | None] = []
    errors: list[str | None] = []
    for place, image in enumerate(batch[column]):
        name = str(batch["path"][place]) if "path" in batch else None
        camera, lens = view
        its_camera = float(batch["hfov"][place]) if camera is None and "hfov" in batch else camera
        try:
            answers.append(model._range(image, (its_camera, lens), name).to_json())
            errors.append(None)
        except (OSError, RuntimeError, TypeError, ValueError) as error:
            answers.append(None)
            errors.append(str(error))
    kept = {name: values for name, values in batch.items() if name not in _IMAGES}
    return {**kept, "json": np.array(answers, object), "error": np.array(errors, object)}
