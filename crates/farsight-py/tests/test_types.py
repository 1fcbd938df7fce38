"""Types, as mypy sees them."""

import subprocess
import sys

import pytest

USE = """
from typing import assert_type
import numpy as np
import numpy.typing as npt
import farsight

model = farsight.Model(engine="rten", threads=2)
one = model.range("photo.jpg", hfov=65)
assert_type(one, farsight.Result)
assert_type(model.range([b"", "photo.jpg"], K=[[1, 0, 0], [0, 1, 0], [0, 0, 1]]), list[farsight.Result])
assert_type(one.boxes3d, npt.NDArray[np.float64])
assert_type(one.classes, npt.NDArray[np.str_])
for scene in farsight.render(3, seed=1):
    assert_type(scene, farsight.Scene)
farsight.evaluate("label_2", [one])
for frame in model.track("film.mp4", hfov=90):
    assert_type(frame, farsight.Frame)
    assert_type(frame.ttc_s, npt.NDArray[np.float64])
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """One for all, so that numpy is read once."""
    return tmp_path_factory.mktemp("types")


def mypy(*arguments, cwd):
    done = subprocess.run([sys.executable, "-m", *arguments], capture_output=True, text=True, cwd=cwd)
    return done.returncode, done.stdout + done.stderr


def test_the_package_is_typed(folder):
    code, told = mypy("mypy", "--strict", "--ignore-missing-imports", "-p", "farsight", cwd=folder)
    assert code == 0, told


def test_its_users_are_checked(folder):
    use = USE if sys.version_info >= (3, 11) else USE.replace("from typing import", "from typing_extensions import")
    (folder / "use.py").write_text(use)
    code, told = mypy("mypy", "--strict", "--ignore-missing-imports", "use.py", cwd=folder)
    assert code == 0, told
    (folder / "wrong.py").write_text("import farsight\nfarsight.Model().range(7, hfov='wide')\n")
    code, told = mypy("mypy", "--strict", "--ignore-missing-imports", "wrong.py", cwd=folder)
    assert code == 1 and "No overload variant" in told, told


@pytest.mark.slice
def test_stubs_are_those_of_the_native_module(folder):
    code, told = mypy("mypy.stubtest", "--ignore-disjoint-bases", "farsight._farsight", cwd=folder)
    assert code == 0, told
