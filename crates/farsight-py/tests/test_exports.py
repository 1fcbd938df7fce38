"""Results as other packages take them."""

import sys
import types

import numpy as np
import pytest


@pytest.mark.slice
def test_pandas(result):
    table = result.to_pandas()
    assert len(table) == len(result)
    assert table["class"].tolist() == result.classes.tolist()
    assert np.array_equal(table[["x", "y", "z", "length", "height", "width", "yaw"]], result.boxes3d)
    assert np.array_equal(table[["range_low_m", "range_high_m"]], result.interval_m)
    assert np.array_equal(table[["x1", "y1", "x2", "y2"]], result.boxes2d)


@pytest.mark.filterwarnings("ignore")
def test_supervision(model, result):
    detections = result.to_supervision()
    assert np.array_equal(detections.xyxy, result.boxes2d)
    assert np.array_equal(detections.data["range_m"], result.range_m)
    near = detections[detections.data["range_m"] < 25]
    assert 0 < len(near) < len(detections)
    empty = model.range(np.full((96, 320, 3), 127, np.uint8), hfov=70).to_supervision()
    assert len(empty) == 0


def test_fiftyone(monkeypatch, result):
    """With a stand-in: the package brings a database of its own."""
    fiftyone = types.ModuleType("fiftyone")
    fiftyone.Detection = fiftyone.Detections = types.SimpleNamespace
    monkeypatch.setitem(sys.modules, "fiftyone", fiftyone)
    height, width = result.image.shape[:2]
    for one, box, where in zip(result.to_fiftyone().detections, result.boxes2d, result.boxes3d):
        left, top, wide, tall = one.bounding_box
        assert np.allclose([left * width, top * height, (left + wide) * width, (top + tall) * height], box)
        x, y, z, length, height_m, width_m, yaw = where
        assert np.allclose(one.location, [x, y - height_m / 2, z])
        assert one.dimensions == [length, height_m, width_m] and one.rotation == [0.0, yaw, 0.0]


@pytest.mark.parametrize("package", ["pandas", "supervision", "fiftyone"])
def test_a_package_that_is_missing_is_named(monkeypatch, result, package):
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ImportError, match=f"needs {package}, which is not installed: pip install {package}"):
        getattr(result, f"to_{package}")()
