"""What the exported farsight-w finds, without Farsight: onnx_ssd_example.py MODEL.onnx IMAGE.ppm CALIB.txt

As scripts/onnx_example.py, which lies beside it; docs/onnx.md explains each step.
"""
import json

import numpy as np
from onnx_example import MEAN, STD, main

SCALES, MIN_SCORE, MOST = [0.2, 0.35, 0.5, 0.65, 0.8, 0.95, 1.0], 0.25, 50
FIRST = [6, 6, 22, 22, 22, 150]


def anchors(level):
    """Heights and widths in pixels, `[2, anchors, 1, 1]`."""
    scale, between = SCALES[level], np.sqrt(SCALES[level] * SCALES[level + 1])
    pairs = [(ratio, scale) for ratio in (1, 2, 0.5, 3, 0.3333)] + [(1, between)]
    ratios, scales = np.array(pairs if level else [(1, 0.1), (2, scale), (0.5, scale)]).T[:, :, None, None]
    return 300 * scales / np.sqrt(ratios), 300 * scales * np.sqrt(ratios)


def weights(count, length, scale, offset):
    """Of the source's pixels in each of `count` output pixels: triangles; what lies outside is black."""
    at, reach = (np.arange(count)[:, None] - offset) / scale, max(1 / scale, 1)
    pad = int(2 * reach) + 2
    each = np.maximum(0, 1 - abs(np.arange(-pad, length + pad) - at) / reach)
    return (each / np.maximum(each.sum(1, keepdims=True), 1e-9))[:, pad:-pad]


def look(session, view, image, P):
    """Boxes in the image, and probabilities of vehicle, person and bicycle, `[7, boxes]`."""
    height, width = image.shape[:2]
    rows = np.array([0, height]) if not view.get("rows") else P[1, 2] + P[1, 1] * np.array([-1, 1]) * view["rows"]
    first, last = np.clip(rows, 0, height)
    if last - first < 1:
        return np.empty((7, 0))
    largest = min(np.sqrt(1e6 / (width * (last - first))), 1e6 / 320 / max(width, last - first))
    scale = min(view["focal_px"] / P[1, 1], 2, largest)
    columns, lines = [max(320, int(np.ceil(side * scale / 32)) * 32) for side in (width, last - first)]
    dx, dy = 0.5 * scale - 0.5, 0.5 * scale - 0.5 - first * scale
    pixels = np.tensordot(weights(lines, height, scale, dy), np.float64(image), (1, 0))
    pixels = np.tensordot(weights(columns, width, scale, dx), pixels, (1, 1)).transpose(1, 0, 2)
    names = [f"{kind}{level}" for level in range(6) for kind in ("boxes", "classes")]
    maps = session.run(names, {"image": np.float32((pixels / 255 - MEAN) / STD).transpose(2, 0, 1)[None]})
    found = []
    for level, (ah, aw) in enumerate(map(anchors, range(6))):
        two = maps[2 * level : 2 * level + 2]
        boxes, classes = (np.float64(m[0]).reshape(len(ah), 4, *m.shape[2:]).swapaxes(0, 1) for m in two)
        centers = np.indices(boxes.shape[2:])[:, None] * 16 * 2**level + FIRST[level]
        v, u = centers + boxes[:2] / 10 * np.array([ah, aw])
        h, w = np.exp(boxes[2:] / 5) * np.array([ah, aw]) / 2
        edges = [(at - 0.5 - d) / scale for at, d in ((u - w, dx), (v - h, dy), (u + w, dx), (v + h, dy))]
        scores = 1 / (1 + np.exp(-np.array([np.maximum(*classes[2:]), classes[1], classes[0]])))
        found.append(np.concatenate([edges, scores]).reshape(7, -1))
    x1, y1, x2, y2, *scores = np.concatenate(found, 1)
    is_cut = (first > 0) & (y1 < first + 4 / scale) | (last < height) & (y2 > last - 4 / scale)
    aside, below = 0.04 * (x2 - x1), 0.03 * (y2 - y1)
    x1, x2, y2 = x1 - aside, x2 + aside, y2 + below
    x1, y1, x2, y2 = np.clip(x1, 0, width), np.clip(y1, 0, height), np.clip(x2, 0, width), np.clip(y2, 0, height)
    return np.array([x1, y1, x2, y2, *scores])[:, ~is_cut & (x2 - x1 >= 1) & (y2 - y1 >= 1)]


def area(box, other=None):
    """The area of a box, or of what it shares with another."""
    low, high = (box[:2], box[2:]) if other is None else (np.maximum(box, other)[:2], np.minimum(box, other)[2:])
    return np.prod(np.maximum(0, high - low))


def suppressed(boxes, scores, most):
    kept = []
    for box, score in sorted(zip(boxes.T, scores), key=lambda one: -one[1]):
        if score > MIN_SCORE and all(area(box, a) <= most * (area(box) + area(a) - area(box, a)) for a, _ in kept):
            kept.append((box, score))
    return kept


def placed(model, name, box, score, P):
    length, height, width = next(c["dimensions_lhw"] for c in model["classes"] if c["class"] == name)
    z = P[1, 1] * height / (box[3] - box[1])
    rows = (box[:2] + box[2:])[:, None] / 2 * P[2] - P[:2]
    x, y = np.linalg.solve(rows[:, :2], -rows[:, 2] * z - rows[:, 3])
    found = {"class": name, "score": score, "box2d": list(box), "location": [x, y + height / 2, z], "range_m": z}
    sides = {"dimensions_hwl": [height, width, length], "rotation_y": -np.pi / 2}
    return {**found, **sides, "range_sigma_m": model["relative_error"] * z}


def detect(session, image, P):
    model = json.loads(session.get_modelmeta().custom_metadata_map["farsight.model"])
    boxes = np.concatenate([look(session, view, image, P) for view in model["views"]], 1)
    vehicles, people, bicycles = (suppressed(boxes[:4], scores, model["max_overlap"]) for scores in boxes[4:])
    found = [("Car", box, score) for box, score in vehicles]
    for box, score in people:
        ridden = next((b for b, _ in bicycles if area(b, box) >= 0.25 * area(b)), None)
        whole = box if ridden is None else np.array([*np.minimum(box, ridden)[:2], *np.maximum(box, ridden)[2:]])
        found.append(("Pedestrian" if ridden is None else "Cyclist", whole, score))
    return [placed(model, *one, P) for one in sorted(found, key=lambda one: -one[2])[:MOST]]


if __name__ == "__main__":
    main(detect)
