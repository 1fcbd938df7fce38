"""Evaluation and rendered scenes."""

import json

import farsight
import numpy as np
import pytest
from PIL import Image


@pytest.fixture(scope="session")
def rendered(program, tmp_path_factory):
    """Three rendered frames in KITTI's layout."""
    folder = tmp_path_factory.mktemp("rendered")
    program("synth", "--out", folder, "--frames", "3", "--seed", "5", "--quiet")
    return folder / "training"


def test_scenes_are_those_of_the_program(rendered):
    scenes = farsight.render(3, seed=5)
    assert len(scenes) == 3
    scene = scenes[1]
    assert np.array_equal(scene.image, np.asarray(Image.open(rendered / "image_2/000001.png")))
    rows = [line.split() for line in (rendered / "label_2/000001.txt").read_text().splitlines()]
    assert scene.classes.tolist() == [row[0] for row in rows] and rows
    numbers = np.array([[float(field) for field in row[1:]] for row in rows])
    assert np.abs(numbers[:, [10, 11, 12, 9, 7, 8, 13]] - scene.boxes3d).max() <= 0.0051
    assert np.abs(numbers[:, 3:7] - scene.boxes2d).max() <= 0.0051
    assert np.array_equal(numbers[:, 1], scene.occlusion)
    first = next(iter(scenes))
    assert np.array_equal(first.image, scenes[0].image) and np.array_equal(scenes[-3].P, first.P)
    assert len(scenes[1:]) == 2
    with pytest.raises(IndexError):
        scenes[3]
    with pytest.raises(ValueError, match="expected n from 0"):
        farsight.render(-1)


@pytest.mark.slice
def test_the_report_is_that_of_the_program(model, rendered, program, tmp_path):
    results = model.range(sorted((rendered / "image_2").glob("*.png")))
    program("range", rendered / "image_2", "--kitti", tmp_path / "rows", "--quiet")
    words = ["--labels", rendered / "label_2", "--results", tmp_path / "rows", "--resamples", "50", "--quiet"]
    program("eval", *words, "--json", tmp_path / "report.json")
    expected = json.loads((tmp_path / "report.json").read_text())
    assert farsight.evaluate(rendered / "label_2", tmp_path / "rows", resamples=50) == expected
    ours = farsight.evaluate(rendered / "label_2", results, resamples=50)
    named = {f"{place:06}": result for place, result in enumerate(results)}
    assert ours["ap"] == expected["ap"] and ours["ranging"] == expected["ranging"] and ours["frames"] == 3
    assert farsight.evaluate(rendered / "label_2", named, resamples=50)["ranging"] == expected["ranging"]


def test_wrong_folders_and_results_are_told(rendered, result, tmp_path):
    for labels, results, told in [
        (tmp_path / "none", tmp_path, "no such folder; expected a folder of label files"),
        (rendered / "label_2", tmp_path, "expected result files"),
        (rendered / "label_2", [], "there are no results; expected at least one"),
        (rendered / "label_2", [result, result], "two results of a frame 000000; expected one"),
        (rendered / "label_2", {"../a": result}, "expected a name such as 000007"),
    ]:
        with pytest.raises(ValueError, match=told):
            farsight.evaluate(labels, results)
