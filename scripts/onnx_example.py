"""What an exported detector finds, without Farsight: python scripts/onnx_example.py MODEL.onnx IMAGE.ppm CALIB.txt
IMAGE is a binary PPM, CALIB a text with "P2: " and 12 numbers (3x4 projection). docs/onnx.md explains each step. The
answers are those of `farsight range --refiner none --plates none --above-road none --max-overlap 1 --json -`.
"""
import json
import sys

import numpy as np
import onnxruntime

MEAN, STD = np.float32([0.485, 0.456, 0.406]), np.float32([0.229, 0.224, 0.225])


def input_size(model, focal, width, height):
    w, h = model["input"]
    scaled = focal * w / width
    low, high = model.get("focal_range_px") or (scaled, scaled)
    new = int(np.clip(np.floor(w * np.clip(scaled, low, high) / scaled / 32 + 0.5) * 32, 32, 2 * w))
    h = -(-h * new // (w * 32)) * 32
    return (new, h) if height * new / width <= h + 32 else (new, max(h, min(-(-height * new // (width * 32)), new // 32) * 32))


def resized(image, size):
    """Bilinear, pixel p of the input at T^-1 p of the image, black outside; and T."""
    scale, T = size[0] / image.shape[1], np.eye(3)
    for axis, (out, length) in enumerate(zip(size, image.shape[1::-1])):
        T[axis] = np.eye(3)[axis] * scale + [0, 0, out / 2 - scale * length / 2]
        at = np.clip((np.arange(out) - T[axis, 2]) / scale, -1, length) + 1
        image = np.pad(image, [(1, 2) if a == 1 - axis else (0, 0) for a in range(3)])
        share = np.float32(at % 1).reshape((1, -1, 1) if axis == 0 else (-1, 1, 1))
        image = image.take(np.int64(at), 1 - axis) * (1 - share) + image.take(np.int64(at) + 1, 1 - axis) * share
    return image, T


def decode(model, channel, cell, logit, raw, P, F, image_size):
    cls, depth, focal = model["classes"][channel], model["depth"], 4 * F[1, 1]
    zoom = focal / depth["focal_px"] if depth.get("focal_px") else 1.0
    z = (raw[0] * depth["std_m"] + depth["mean_m"]) * zoom
    rows = (cell + raw[1:3])[:, None] * F[2] - F[:2]
    x, y = np.linalg.solve(rows[:, :2], -rows[:, 2] * z - rows[:, 3])
    length, height, width = cls["dimensions_lhw"] * np.exp(1 / (1 + np.exp(-raw[3:6])) - 0.5)
    y, yaw = y + height / 2, np.arctan2(raw[6], raw[7]) - np.pi / 2 + np.arctan2(x, z)
    turn = np.array([[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]])
    ground = np.array([[1, 1], [1, -1], [-1, -1], [-1, 1]]) * [length / 2, width / 2] @ turn + [x, z]
    corners = np.array([P @ [gx, up, gz, 1] for gx, gz in ground for up in (y, y - height)])
    seen = np.clip(corners[:, :2] / corners[:, 2:], 0, image_size)
    box2d, fit, error = [*seen.min(0), *seen.max(0)], cls.get("score"), depth.get("error")
    if fit:
        tall = np.log(np.clip((box2d[3] - box2d[1]) * focal / P[1, 1], *fit["heights_px"]) / 25)
        logit = fit["peak"] * logit + fit["height"] * tall + fit["height_squared"] * tall**2 + fit["bias"]
    is_cut = box2d[0] <= 0 or box2d[1] <= 0 or box2d[2] >= image_size[0] or box2d[3] >= image_size[1]
    found = {"class": cls["class"], "score": 1 / (1 + np.exp(-logit)), "box2d": box2d, "location": [x, y, z],
             "dimensions_hwl": [height, width, length], "rotation_y": (yaw + np.pi) % (2 * np.pi) - np.pi, "range_m": z}
    sigma = error and np.exp(error["bias"] + error["depth"] * np.log(z / zoom) + error["score"] * logit + error["cut"] * is_cut)
    return {**found, "range_sigma_m": sigma and sigma * zoom}


def detect(session, image, P):
    model, (height, width) = json.loads(session.get_modelmeta().custom_metadata_map["farsight.model"]), image.shape[:2]
    pixels, T = resized(np.float32(image), input_size(model, P[1, 1], width, height))
    logits, raw = session.run(["cls_logits", "reg_raw"], {"image": ((pixels / 255 - MEAN) / STD).transpose(2, 0, 1)[None]})
    around = np.pad(logits[0], ((0, 0), (1, 1), (1, 1)), constant_values=-np.inf)
    peaks = logits[0] >= np.lib.stride_tricks.sliding_window_view(around, (3, 3), (1, 2)).max((3, 4))
    F, least = np.diag([0.25, 0.25, 1]) @ T @ P, 0.5 if model["classes"][0].get("score") else 0.25
    found = [decode(model, c, np.array([u, v]), float(logits[0, c, v, u]), np.float64(raw[0, :, v, u]), P, F, (width, height))
             for c, v, u in np.argwhere(peaks & (logits[0] > np.log(0.03 / 0.97)))]
    return sorted((one for one in found if one["score"] > least), key=lambda one: -one["score"])


def main(detect):
    session = onnxruntime.InferenceSession(sys.argv[1], providers=["CPUExecutionProvider"])
    data = open(sys.argv[2], "rb").read()
    width, height = map(int, data.split(maxsplit=3)[1:3])
    pixels = np.frombuffer(data, np.uint8)[-3 * width * height :].reshape(height, width, 3)
    P2 = next(line for line in open(sys.argv[3]) if line.startswith("P2:")).split()[1:]
    print(json.dumps(detect(session, pixels, np.array(P2, float).reshape(3, 4)), default=float, indent=1))


if __name__ == "__main__":
    main(detect)
