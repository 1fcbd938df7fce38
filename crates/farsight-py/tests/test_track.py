"""Videos: the answers are those of `farsight track`."""

import pickle
import shutil
import subprocess

import farsight
import numpy as np
import pytest

FRAMES = 4


@pytest.fixture(scope="module")
def frames(photo, tmp_path_factory):
    """One scene again and again, as images."""
    folder = tmp_path_factory.mktemp("frames")
    for number in range(FRAMES):
        shutil.copy(photo, folder / f"{number:06}.jpg")
    return folder


@pytest.fixture(scope="module")
def followed(model, frames):
    return list(model.track(frames, fps=10, hfov=81.4))


@pytest.mark.slice
def test_answers_are_those_of_the_program(followed, program, frames):
    printed = program("track", frames, "--fps", 10, "--hfov", 81.4, "--json", "-")
    assert [frame.to_json() for frame in followed] == printed.splitlines()


def test_lens_and_calibration_are_those_of_the_program(model, program, frames, calibrated):
    lens = "brown:-0.05,0,0,0,0"
    printed = program("track", frames, "--fps", 10, "--calib", calibrated, "--lens", lens, "--json", "-")
    followed = model.track(frames, fps=10, calib=calibrated, lens=lens)
    assert [frame.to_json() for frame in followed] == printed.splitlines()


def test_ego_motion_from_the_frames_is_that_of_the_program(program, frames):
    model = farsight.Model(model="farsight-n", above_road=1.65)
    options = ["--fps", 10, "--hfov", 81.4, "--ego", "auto", "--above-road", 1.65, "--model", "farsight-n"]
    printed = program("track", frames, *options, "--json", "-")
    followed = list(model.track(frames, fps=10, hfov=81.4, ego="auto"))
    assert [frame.to_json() for frame in followed] == printed.splitlines()
    assert followed[0].ego is None
    # One scene again and again: the camera stands.
    assert abs(followed[-1].ego["speed_mps"]) < 0.5 and followed[-1].ego["speed_sigma_mps"] > 0


def test_fields_have_their_shapes(followed, photo):
    assert [frame.frame for frame in followed] == list(range(FRAMES))
    last = followed[-1]
    count = len(last)
    assert count > 0 and last.time_s == pytest.approx(0.3) and len(last.tracks) == count
    shapes = {"boxes3d": 7, "boxes2d": 4, "velocity_mps": 3}
    for name in ("range_m", "range_sigma_m", "scores", "closing_mps", "ttc_s", "ids", "classes", "coasting"):
        assert getattr(last, name).shape == (count,), name
    for name, width in shapes.items():
        assert getattr(last, name).shape == (count, width), name
    assert np.array_equal(last.boxes3d[:, 2], last.range_m) and last.P.shape == (3, 4)
    assert last.image.dtype == np.uint8 and last.image.ndim == 3
    assert np.array_equal(last.ids, followed[-2].ids)
    again = pickle.loads(pickle.dumps(last))
    assert again.to_json() == last.to_json() and np.array_equal(again.image, last.image)
    assert repr(last).startswith("<farsight.Frame 3 at 0.30 s: #1 ")


def test_frames_come_as_they_are_asked_for(model, frames):
    (frames / "zzz.jpg").write_bytes(b"no image")
    try:
        follow = model.track(sorted(frames.iterdir()), fps=10, hfov=81.4)
        assert next(follow).frame == 0
        with pytest.warns(UserWarning, match="zzz.jpg"):
            assert len(list(follow)) == FRAMES - 1
    finally:
        (frames / "zzz.jpg").unlink()


def test_a_film_is_followed_as_the_program_does(model, program, frames, tmp_path):
    if shutil.which("ffmpeg") is None:
        pytest.skip("there is no ffmpeg")
    film = tmp_path / "film.mp4"
    ffmpeg = ["ffmpeg", "-v", "error", "-framerate", "10", "-i", str(frames / "%06d.jpg"), "-pix_fmt", "yuv420p"]
    # Their sides are odd numbers, which such films do not have.
    subprocess.run([*ffmpeg, "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", str(film)], check=True)
    printed = program("track", film, "--hfov", 81.4, "--json", "-")
    followed = list(model.track(str(film), hfov=81.4))
    assert [frame.to_json() for frame in followed] == printed.splitlines()
    assert len(followed) == FRAMES and followed[-1].time_s == pytest.approx(0.3) and len(followed[-1]) > 0


def test_what_is_wrong_is_told(model, frames, tmp_path):
    with pytest.raises(ValueError, match="expected one of hfov, K, P and calib"):
        model.track(frames, fps=10, hfov=80, K=np.eye(3))
    with pytest.raises(ValueError, match="expected their number in a second"):
        model.track(frames, hfov=80)
    with pytest.raises(ValueError, match="min_score is 2; expected more than 0"):
        model.track(frames, fps=10, hfov=80, min_score=2)
    with pytest.raises(FileNotFoundError, match="nowhere: no such program"):
        list(model.track(tmp_path / "film.mp4", hfov=80, ffmpeg=tmp_path / "nowhere"))
