"""What the tests share."""

import json
import os
import subprocess
from pathlib import Path

import farsight
import pytest

ROOT = Path(__file__).resolve().parents[3]
SCENES = ROOT / "assets/scenes/image_2"


@pytest.fixture(scope="session")
def model():
    return farsight.Model()


@pytest.fixture(scope="session")
def photo():
    """A shipped scene, whose camera KITTI's layout knows."""
    return SCENES / "000000.jpg"


@pytest.fixture(scope="session")
def calibrated(photo, tmp_path_factory):
    """The calibration of the scene, with a road."""
    file = tmp_path_factory.mktemp("calib") / "front.txt"
    text = (photo.parents[1] / "calib" / f"{photo.stem}.txt").read_text()
    file.write_text(f"{text}road: 0.01 0.0 1.5 0.01 0.01 0.1\n")
    return file


@pytest.fixture(scope="session")
def result(model, photo):
    return model.range(photo, hfov=81.4)


@pytest.fixture(scope="session")
def program():
    """Runs `farsight` and returns what it prints."""
    path = os.environ.get("FARSIGHT_PROGRAM")
    if path is None:
        pytest.skip("FARSIGHT_PROGRAM names no program to compare with; `cargo xtask wheel --test` does")

    def run(*arguments):
        words = [path, *map(str, arguments)]
        return subprocess.run(words, check=True, stdout=subprocess.PIPE, text=True, encoding="utf-8").stdout

    return run


@pytest.fixture
def jsonl(program):
    """The objects that `farsight range` prints."""
    return lambda *arguments: [
        json.loads(line) for line in program("range", *arguments, "--format", "jsonl").splitlines()
    ]
