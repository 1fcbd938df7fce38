"""Engines that other packages bring along."""

import importlib.util
from pathlib import Path

import farsight
import numpy as np
import pytest


def package_folder(engine):
    """Where the packages lie, found without loading one: two copies of a library in one process may not get along."""
    found = importlib.util.find_spec(engine)
    if found is None:
        pytest.skip(f"{engine} is not installed")
    return Path(found.origin).parents[1]


@pytest.mark.parametrize("engine", ["onnxruntime", "openvino"])
def test_answers_are_those_of_the_program_and_close_to_those_of_rten(engine, model, photo, jsonl):
    folder = package_folder(engine)
    answer = farsight.Model(engine=engine, threads=1).range(photo, hfov=81.4)
    words = ["--hfov", "81.4", "--engine", engine, "--engine-path", folder, "--threads", "1"]
    assert answer.to_dict() == jsonl(photo, *words)[0]
    ours = model.range(photo, hfov=81.4)
    assert len(ours) > 2 and answer.classes.tolist() == ours.classes.tolist()
    # Each engine adds up in its own order: millimetres, and hundredths of a pixel.
    for name in ("boxes3d", "boxes2d", "range_m", "range_sigma_m", "scores"):
        assert np.allclose(getattr(answer, name), getattr(ours, name), rtol=1e-3, atol=1e-2), name


def test_a_device_that_is_not_there_is_an_error():
    with pytest.raises(ValueError, match="no device \"tpu\"; expected cpu, cuda, tensorrt or gpu"):
        farsight.Model(device="tpu")
    with pytest.raises(ValueError, match="the engine rten has no device cuda; onnxruntime has"):
        farsight.Model(device="cuda")
