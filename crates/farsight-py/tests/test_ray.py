"""A local Ray of two workers. `cargo xtask wheel --test=ray` runs it."""

import importlib.util
import json
import os
import shutil
import signal
import subprocess
import sysconfig
import threading
import time
import venv
from pathlib import Path

import pytest

pytestmark = [pytest.mark.ray, pytest.mark.filterwarnings("default")]

EXAMPLE = Path(__file__).resolve().parents[1] / "examples/ray_fleet.py"

PHOTOS = 12


@pytest.fixture(scope="module")
def cluster():
    ray = pytest.importorskip("ray")
    pytest.importorskip("ray.data")
    ray.init(num_cpus=3, include_dashboard=False, log_to_driver=False)
    yield ray
    ray.shutdown()


@pytest.fixture(scope="module")
def example(cluster):
    spec = importlib.util.spec_from_file_location("ray_fleet", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def workers(ray):
    """Process ids of the living workers of this cluster, by the ids of their actors."""
    from ray._private import state

    living = {key: actor for key, actor in state.actors().items() if actor["State"] == "ALIVE"}
    return {key: actor["Pid"] for key, actor in living.items() if "Worker" in actor["ActorClassName"]}


@pytest.mark.slice
def test_a_worker_that_is_killed_loses_and_doubles_nothing(cluster, example, photo, tmp_path):
    folder = tmp_path / "photos"
    folder.mkdir()
    for number in range(PHOTOS):
        shutil.copy(photo, folder / f"{number:02}.jpg")
    (folder / "99.jpg").write_bytes(b"no image")
    out = tmp_path / "found.jsonl"
    words = [str(folder), "--hfov", "81.4", "--batch", "2", "--model", "farsight-s", "--out", str(out)]
    ended = []
    job = threading.Thread(target=lambda: ended.append(example.main(words)), daemon=True)
    job.start()
    while not out.exists() or len(out.read_text().splitlines()) < 2:
        assert job.is_alive()
        time.sleep(0.02)
    before = workers(cluster)
    assert len(before) == 2
    _, pid = min(before.items())
    os.kill(pid, signal.SIGKILL)
    done_at_the_kill = len(out.read_text().splitlines())
    job.join()
    assert ended == [1] and done_at_the_kill < PHOTOS

    lines = [json.loads(line) for line in out.read_text().splitlines()]
    expected = [str(folder / f"{number:02}.jpg") for number in range(PHOTOS)] + [str(folder / "99.jpg")]
    assert sorted(line["image"] for line in lines) == expected
    assert [line["image"] for line in lines if "error" in line] == expected[-1:]

    import farsight

    alone = farsight.Model(model="farsight-s", threads=1).range(folder / "00.jpg", hfov=81.4).to_dict()
    for line in lines:
        if "error" not in line:
            assert line == {**alone, "image": line["image"]}


def test_columns_of_images_cameras_and_errors(cluster, photo):
    import farsight.ray

    data = photo.read_bytes()
    rows = [{"bytes": data, "path": "a.jpg", "hfov": 81.4}, {"bytes": b"no", "path": "b.jpg", "hfov": 81.4}]
    found = farsight.ray.map(cluster.data.from_items(rows), num_cpus=1, model="farsight-s").take_all()
    first, second = sorted(found, key=lambda row: row["path"])
    assert json.loads(first["json"])["image"] == "a.jpg" and first["error"] is None and "bytes" not in first
    assert second["json"] is None and "b.jpg" in second["error"]
    with pytest.raises(Exception, match='expected one of "bytes", "image" and "path"'):
        farsight.ray.map(cluster.data.from_items([{"photo": 1}]), num_cpus=1, model="farsight-s").take_all()


@pytest.fixture
def python_without_the_wheel(tmp_path):
    """An interpreter that has all packages of this one but farsight."""
    venv.create(tmp_path / "without", symlinks=True)
    python = tmp_path / "without/bin/python"
    packages = tmp_path / "packages"
    packages.mkdir()
    for one in Path(sysconfig.get_path("purelib")).iterdir():
        if not one.name.startswith("farsight"):
            (packages / one.name).symlink_to(one)
    where = subprocess.run(
        [python, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))"], check=True, capture_output=True, text=True
    )
    (Path(where.stdout.strip()) / "packages.pth").write_text(f"{packages}\n")
    subprocess.run([python, "-c", "import ray"], check=True)
    assert subprocess.run([python, "-c", "import farsight"], capture_output=True).returncode == 1
    return python


def test_a_worker_without_the_wheel_says_so(cluster, photo, python_without_the_wheel):
    import farsight.ray

    rows = cluster.data.from_items([{"bytes": photo.read_bytes()}])
    options = {"runtime_env": {"py_executable": str(python_without_the_wheel)}, "max_restarts": 0}
    with pytest.raises(Exception, match=r"this Ray worker has no farsight.*; expected the wheel on every machine"):
        farsight.ray.map(rows, hfov=81.4, num_cpus=1, model="farsight-s", ray_options=options).take_all()
