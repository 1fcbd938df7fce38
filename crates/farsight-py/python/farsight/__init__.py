"""Distances from one photograph: 3D boxes of vehicles and people, with error bars.

    import farsight

    model = farsight.Model()
    result = model.range("photo.jpg", hfov=65)
    result.plot("boxes.png")
    print(result.classes, result.range_m, result.range_sigma_m)

Frames of reference are KITTI's. Camera coordinates are metres with x right, y down, z forward. Pixels are (u, v), u
right, v down, with pixel centres at whole numbers. An object stands at the centre of its bottom face. Its yaw turns
about the y axis, in radians, and is 0 when the object faces x.
"""

from ._evaluate import evaluate
from ._farsight import __version__
from ._model import Model
from ._result import Result
from ._scenes import Scene, Scenes, render
from ._track import Frame

__all__ = ["Frame", "Model", "Result", "Scene", "Scenes", "__version__", "evaluate", "render"]
