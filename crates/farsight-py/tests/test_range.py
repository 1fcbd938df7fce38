"""Answers, and what images and cameras they are asked with."""

import io
import pickle

import farsight
import numpy as np
import pytest
from conftest import ROOT, SCENES
from PIL import Image

K = [[700.0, 0, 620.0], [0, 710.0, 180.0], [0, 0, 1]]
P = [[700.0, 0, 620.0, 45.0], [0, 710.0, 180.0, 0.2], [0, 0, 1, 0.003]]


@pytest.fixture(scope="session")
def pixels(result):
    return np.array(result.image)


def found(result):
    """Everything but the image's name."""
    return {name: value for name, value in result.to_dict().items() if name != "image"}


@pytest.mark.slice
def test_answers_are_those_of_the_program_digit_for_digit(model, program):
    photos = sorted(SCENES.glob("*.jpg"))
    lines = program("range", *photos, "--format", "jsonl").splitlines()
    assert [model.range(str(photo)).to_json() for photo in photos] == lines
    assert any(len(model.range(photo)) > 2 for photo in photos)


@pytest.mark.parametrize(
    "camera, words",
    [
        ({"hfov": 65}, ["--hfov", "65"]),
        ({"hfov": "auto"}, ["--hfov", "auto"]),
        ({"K": K}, ["--fx", "700", "--fy", "710", "--cx", "620", "--cy", "180"]),
        ({"K": np.float32(K)}, ["--fx", "700", "--fy", "710", "--cx", "620", "--cy", "180"]),
    ],
)
def test_cameras_are_those_of_the_program(model, jsonl, photo, camera, words):
    assert model.range(photo, **camera).to_dict() == jsonl(photo, *words)[0]


def test_a_projection_is_that_of_a_calibration_file(model, jsonl, photo, tmp_path):
    calibration = tmp_path / "camera.txt"
    calibration.write_text("P2: " + " ".join(str(value) for row in P for value in row) + "\n")
    answer = model.range(photo, P=P)
    assert answer.to_dict() == jsonl(photo, "--calib", calibration)[0]
    assert np.array_equal(answer.P, P)


def test_other_models_and_engines_are_those_of_the_program(photo, jsonl):
    for name in ["farsight-s", "farsight-n"]:
        other = farsight.Model(model=name, threads=1)
        assert other.range(photo).to_dict() == jsonl(photo, "--model", name, "--threads", "1")[0]
    japan = farsight.Model(region="japan", threads=1)
    assert japan.range(photo).to_dict() == jsonl(photo, "--region", "japan", "--threads", "1")[0]
    high = farsight.Model(model="farsight-n", above_road=1.65, threads=1)
    options = ["--model", "farsight-n", "--above-road", "1.65", "--threads", "1"]
    assert high.range(photo).to_dict() == jsonl(photo, *options)[0]
    quick = farsight.Model(model="farsight-n", effort="fast", threads=1)
    assert quick.range(photo).to_dict() == jsonl(photo, "--model", "farsight-n", "--effort", "fast", "--threads", "1")[0]


def test_noise_is_smoothed_unless_it_is_to_stay(pixels):
    noise = np.random.default_rng(5).normal(0, 40, pixels.shape)
    noisy = np.clip(pixels + noise, 0, 255).astype(np.uint8)
    [smoothed, as_it_is] = [farsight.Model(model="farsight-n", denoise=denoise, threads=1) for denoise in [True, False]]
    assert smoothed.range(noisy, hfov=81).to_dict() != as_it_is.range(noisy, hfov=81).to_dict()
    assert smoothed.range(pixels, hfov=81).to_dict() == as_it_is.range(pixels, hfov=81).to_dict()


def test_what_is_to_be_told_of_a_model_is_a_warning(tmp_path):
    whole = (ROOT / "models/farsight-s.safetensors").read_bytes()
    file = tmp_path / "other.safetensors"
    # Another weight, and a key in the place of the hash's that means nothing.
    changed = bytearray(whole.replace(b"farsight.file_sha256", b"farsight.file_sha-no"))
    changed[-2] ^= 1
    file.write_bytes(changed)
    with pytest.warns(UserWarning) as told:
        farsight.Model(model=file, threads=1)
    texts = [str(warning.message) for warning in told]
    assert texts[0] == f"{file}: has no hash, so damage to it would not be noticed"
    assert "not the shipped weights, so without what is made for those: refiner, plate reader" in texts[1]


def test_a_large_image_is_drawn_at_a_stated_scale(model):
    answer = model.range(np.zeros((3000, 4000, 3), np.uint8), hfov=65)
    with pytest.warns(UserWarning, match="a large image, drawn at 1/2 of its size"):
        assert answer.plot().shape[0] == 1500


def test_a_picture_is_that_of_the_program(result, program, photo, tmp_path):
    program("range", photo, "--hfov", "81.4", "--out", tmp_path, "--quiet")
    drawn = np.asarray(Image.open(tmp_path / f"{photo.stem}.png"))
    assert np.array_equal(result.plot(tmp_path / "ours.png"), drawn)
    assert (tmp_path / "ours.png").read_bytes() == (tmp_path / f"{photo.stem}.png").read_bytes()
    assert np.array_equal(np.asarray(Image.open(io.BytesIO(result._repr_png_()))), drawn)


def test_lens_and_calibration_are_those_of_the_program(model, program, photo, pixels, calibrated, tmp_path):
    calib, lens = calibrated, "brown:-0.05,0,0,0,0"
    words = ["--calib", calib, "--lens", lens, "--out", tmp_path]
    line = program("range", photo, *words, "--format", "jsonl")
    result = model.range(photo, calib=calib, lens=lens)
    assert result.to_json() == line.rstrip("\n")
    assert np.array_equal(result.plot(), np.asarray(Image.open(tmp_path / f"{photo.stem}.png")))
    assert found(model.range(pixels, calib=str(calib), lens=lens)) == found(result)
    assert found(model.range(photo, calib=calib)) != found(result)
    for wrong, told in [
        ({"calib": tmp_path / "none.txt"}, "none.txt: cannot be read"),
        ({"hfov": 65, "calib": calib}, "hfov and calib are given"),
        ({"hfov": "wide"}, "hfov is 'wide'; expected degrees or \"auto\""),
        ({"hfov": 65, "lens": "fisheye:1"}, "is no lens; expected brown:"),
        ({"hfov": 65, "lens": "brown:-0.9,0,0,0"}, "folds the image at column"),
    ]:
        with pytest.raises(ValueError, match=told):
            model.range(photo, **wrong)


def test_a_camera_that_nobody_knows_is_estimated(model, jsonl, photo, tmp_path):
    alone = tmp_path / "alone.jpg"
    alone.write_bytes(photo.read_bytes())
    told = model.range(alone, hfov="auto").to_dict()
    assert told == jsonl(alone, "--hfov", "auto")[0]
    assert told["camera"]["origin"] == "estimated"


@pytest.mark.slice
def test_every_kind_of_image_gives_one_answer(model, photo, result, pixels):
    png = io.BytesIO()
    Image.fromarray(pixels).save(png, "png")
    odd_steps = np.asfortranarray(pixels)
    same = [photo.read_bytes(), bytearray(png.getvalue()), pixels, odd_steps, Image.fromarray(pixels), str(photo)]
    answers = model.range(same, hfov=81.4)
    assert all(found(answer) == found(result) for answer in answers)
    assert [answer.path for answer in answers] == ["image"] * 5 + [str(photo)]
    assert model.range((), hfov=65) == []


def test_a_turned_pil_image_is_seen_upright(model, pixels):
    turned = Image.fromarray(np.rot90(pixels))
    turned.getexif()[0x0112] = 6
    assert np.array_equal(model.range(turned, hfov=81.4).image, pixels)


def test_exif_data_tell_the_camera(model, pixels, tmp_path):
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 26
    # What is as wide as KITTI's images is taken for a panorama.
    Image.fromarray(pixels[:, :500]).save(tmp_path / "phone.jpg", exif=exif)
    by_path = model.range(tmp_path / "phone.jpg")
    assert by_path.to_dict()["camera"]["origin"] == "exif"
    assert found(model.range((tmp_path / "phone.jpg").read_bytes())) == found(by_path)


@pytest.mark.parametrize(
    "change, told",
    [
        (lambda a: a / 255.0, "float64 of shape"),
        (lambda a: a.astype(np.float32), "float32 of shape"),
        (lambda a: np.dstack([a, a[..., :1]]), r"uint8 of shape \(\d+, \d+, 4\)"),
        (lambda a: a[..., 0], r"uint8 of shape \(\d+, \d+\)"),
        (lambda a: a[None], r"uint8 of shape \(1, "),
        (lambda a: a[:0], r"uint8 of shape \(0, "),
    ],
)
@pytest.mark.slice
def test_a_wrong_array_says_what_was_expected(model, pixels, change, told):
    expected = r"; expected uint8 of shape \(H, W, 3\), red, green, blue, with at least one pixel"
    with pytest.raises(ValueError, match=told + ".*" + expected):
        model.range(change(pixels), hfov=65)


def test_wrong_cameras_say_what_was_expected(model, pixels, tmp_path):
    for wrong, told in [
        ({}, "does not say which camera took it; expected one of hfov, K, P and calib"),
        ({"hfov": 65, "P": P}, "hfov and P are given; expected one of hfov, K, P and calib"),
        ({"K": P}, r"K has the shape \(3, 4\); expected \(3, 3\)"),
        ({"K": np.ones((3, 3))}, "K is no intrinsic matrix"),
        ({"hfov": 180}, "expected more than 0 and less than 180"),
        ({"K": [[-1.0, 0, 0], [0, 1, 0], [0, 0, 1]]}, "expected a positive number of pixels"),
    ]:
        with pytest.raises(ValueError, match=told):
            model.range(pixels, **wrong)
    Image.fromarray(pixels).save(tmp_path / "plain.png")
    for image in [tmp_path / "plain.png", (tmp_path / "plain.png").read_bytes()]:
        with pytest.raises(ValueError, match=r"give one of hfov=DEGREES, K=\(3, 3\), P=\(3, 4\) or calib=FILE"):
            model.range(image)


def test_wrong_images_say_what_was_expected(model, tmp_path):
    (tmp_path / "text.png").write_text("no image")
    with pytest.raises(ValueError, match="no image that is known here; expected"):
        model.range(tmp_path / "text.png", hfov=65)
    with pytest.raises(ValueError, match="image: no image that is known here; expected"):
        model.range(b"no image", hfov=65)
    with pytest.raises(FileNotFoundError, match=r"none\.png"):
        model.range(tmp_path / "none.png", hfov=65)
    with pytest.raises(TypeError, match="the image is a int; expected a path"):
        model.range(7, hfov=65)


def test_wrong_models_say_what_was_expected(tmp_path):
    for wrong, told in [
        ({"engine": "tensorrt"}, "expected rten, onnxruntime or openvino"),
        ({"precision": "f16"}, "expected f32, bf16 or int8"),
        ({"precision": "bf16"}, "expected openvino"),
        ({"threads": 0}, "expected a number from 1 to 1024"),
        ({"above_road": 0}, "above_road is 0; expected metres, from 0.2 to 50"),
        ({"pitch": 90}, "pitch is 90; expected degrees, from -45 to 60"),
        ({"effort": "most"}, "expected fast, normal or best"),
        ({"region": "texas"}, "expected world, europe, north-america"),
        ({"model": tmp_path / "none.safetensors"}, "no such file; expected a model"),
    ]:
        with pytest.raises(ValueError, match=told):
            farsight.Model(**wrong)
    with pytest.raises(TypeError):
        farsight.Model("photo.jpg")


def test_a_camera_that_the_model_never_saw_is_a_warning(model, pixels):
    with pytest.warns(UserWarning, match="the model was trained with"):
        model.range(pixels, hfov=165)


@pytest.mark.slice
def test_results_have_the_documented_shapes(model, result):
    n = len(result)
    assert n > 0
    shapes = {"boxes3d": (n, 7), "boxes2d": (n, 4), "interval_m": (n, 2), "interval_50_m": (n, 2), "P": (3, 4)}
    shapes |= {"interval_68_m": (n, 2)}
    shapes |= dict.fromkeys(["range_m", "range_sigma_m", "scores", "alpha", "classes", "class_ids"], (n,))
    assert {name: getattr(result, name).shape for name in shapes} == shapes
    assert result.image.dtype == np.uint8 and result.image.shape[2] == 3
    assert np.array_equal(result.boxes3d[:, 2], result.range_m)
    assert [model.classes[place] for place in result.class_ids] == list(result.classes)
    inner, outer = result.interval_50_m, result.interval_m
    assert (outer[:, 0] < inner[:, 0]).all() and (inner[:, 1] < outer[:, 1]).all()
    one = result.to_dict()["detections"][0]
    height, width, length = one["dimensions_hwl"]
    assert result.boxes3d[0].tolist() == [*one["location"], length, height, width, one["rotation_y"]]


def test_the_corners_of_a_box_fall_into_its_box_in_the_image(result):
    for (x, y, z, length, height, width, yaw), box in zip(result.boxes3d, result.boxes2d):
        corners = [[l, h, w] for l in (-length / 2, length / 2) for h in (-height, 0) for w in (-width / 2, width / 2)]
        turn = np.array([[np.cos(yaw), 0, np.sin(yaw)], [0, 1, 0], [-np.sin(yaw), 0, np.cos(yaw)]])
        sin, cos = np.sin(np.radians(result.pitch_deg)), np.cos(np.radians(result.pitch_deg))
        turn = np.array([[1, 0, 0], [0, cos, -sin], [0, sin, cos]]) @ turn
        points = np.column_stack([np.array(corners) @ turn.T + [x, y, z], np.ones(8)]) @ result.P.T
        u, v = (points[:, :2] / points[:, 2:]).T
        limits = np.array([result.image.shape[1] - 1, result.image.shape[0] - 1] * 2)
        around = np.clip([u.min(), v.min(), u.max(), v.max()], 0, limits)
        # Sides keep a share of where the detector saw them.
        near, far = np.maximum(around, box), np.minimum(around, box)
        inner = np.prod(np.maximum(far[2:] - near[:2], 0))
        assert inner / np.prod(near[2:] - far[:2]) > 0.8


def test_nothing_found_keeps_the_shapes(model):
    empty = model.range(np.full((96, 320, 3), 127, np.uint8), hfov=70)
    assert len(empty) == 0
    assert empty.boxes3d.shape == (0, 7) and empty.interval_m.shape == (0, 2) and empty.classes.shape == (0,)
    assert empty.plot().shape[2] == 3
    assert "nothing found" in repr(empty)


def test_results_pickle_with_their_picture(result):
    again = pickle.loads(pickle.dumps(result))
    assert again.to_json() == result.to_json()
    assert np.array_equal(again.plot(), result.plot())
