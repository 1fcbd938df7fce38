#!/usr/bin/env python3
"""Farsight beside programs of others on the same photographs and cores, in one run: found, MAE, milliseconds, memory.

    npm pack @mediapipe/objectron@0.4.1675468480 @vladmandic/human@3.3.6      # and unpack both: package/...
    npm install @tensorflow/tfjs-core@4 @tensorflow/tfjs-converter@4 @tensorflow/tfjs-backend-wasm@4
    python3 scripts/compare_peers.py --farsight target/release/farsight --data KITTI --split configs/splits/real64.txt \
        --objectron OBJECTRON/package --human HUMAN/package --node-modules node_modules --table docs/results/peers.json

KITTI: a folder in KITTI's layout. python3 needs numpy, opencv-python-headless, ai-edge-litert and, for SMOKE, torch. The
peers find boxes in the image and know nothing of distances: similar triangles with the mean height of KITTI's cars give them
some. Both look at square tiles, as their inputs are square and KITTI's images are not; what a tile's border cuts, and what
lies in a better box, is left out, which halves their false alarms or better. SMOKE has random weights: only its
time and memory say something. Found and MAE are those of `farsight eval`, Moderate cars, at the lowest score with at most 0.3
false alarms an image.
"""
import argparse
import json
import pathlib
import resource
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np

from measured_table import MeasuredTable

COLUMNS = ["program", "found", "false alarms an image", "MAE", "relative error, median", "ms an image", "MB"]

CAR_HEIGHT_M = 1.526
CAR_SIZE = "1.53 1.63 3.88"
FALSE_ALARMS = 0.3
LEAST_SCORE = 0.1
# Two boxes are of one car from this overlap on (intersection over union), or if so much of the smaller lies in the other.
OVERLAP = 0.45
CONTAINED = 0.7
# Boxes that come so near to a border of their tile, as a share of its side, are parts of cars: another tile has the whole.
CUT_SHARE = 0.02
# Of the classes in Open Images (vehicle, car) and in COCO (car).
OPEN_IMAGES_CARS = [18, 23]
COCO_CARS = [2]


def tiles(width, height, small):
    """Squares of the whole height, and small ones around the middle row: x, y, side."""
    rows = [(x, 0, height) for x in np.linspace(0, width - height, 5)]
    if small:
        rows += [(x, height // 2 - 120, 220) for x in np.linspace(0, width - 220, 8)]
    return [(int(x), int(max(y, 0)), int(side)) for x, y, side in rows]


def is_cut(box, tile, width, height):
    """Whether the border of a tile, where it is not the image's, cuts the box."""
    x, y, side = tile
    margin = CUT_SHARE * side
    inner = (x > 0, y > 0, x + side < width, y + side < height)
    near = (box[0] < x + margin, box[1] < y + margin, box[2] > x + side - margin, box[3] > y + side - margin)
    return any(a and b for a, b in zip(inner, near))


def suppressed(boxes):
    """Rows x1, y1, x2, y2, score without those that overlap a better one, or lie in it for the most part."""
    kept = []
    area = lambda box: (box[2] - box[0]) * (box[3] - box[1])
    for box in sorted(boxes, key=lambda box: -box[4]):
        def is_same(other):
            w = min(box[2], other[2]) - max(box[0], other[0])
            h = min(box[3], other[3]) - max(box[1], other[1])
            common = max(w, 0) * max(h, 0)
            return common > OVERLAP * (area(box) + area(other) - common) or common > CONTAINED * min(area(box), area(other))

        if not any(is_same(other) for other in kept):
            kept.append(box)
    return kept


class OpenImagesSsd:
    """The SSD of MediaPipe's Objectron (Open Images V4, 300 x 300), by LiteRT."""

    def __init__(self, options):
        from ai_edge_litert.interpreter import Interpreter

        assets = (options.objectron / "objectron_solution_packed_assets.data").read_bytes()
        self.network = Interpreter(model_content=assets[184:9987912], num_threads=options.threads)
        self.network.allocate_tensors()
        outputs = self.network.get_output_details()
        self.input = self.network.get_input_details()[0]["index"]
        self.boxes = next(o["index"] for o in outputs if o["shape"][-1] == 4)
        self.classes = next(o["index"] for o in outputs if o["shape"][-1] == 24)
        scales = [0.2 + 0.75 * i / 5 for i in range(6)] + [1.0]
        anchors = []
        for layer, stride in enumerate((16, 32, 64, 128, 256, 512)):
            cells, scale = int(np.ceil(300 / stride)), scales[layer]
            shapes = [(1, 0.1), (2, scale), (0.5, scale)]
            if layer > 0:
                shapes = [(r, scale) for r in (1, 2, 0.5, 3, 0.3333)] + [(1, (scale * scales[layer + 1]) ** 0.5)]
            anchors += [
                ((y + 0.5) / cells, (x + 0.5) / cells, s / r**0.5, s * r**0.5)
                for y in range(cells) for x in range(cells) for r, s in shapes
            ]
        self.anchors = np.array(anchors, np.float32)

    def cars(self, image):
        import cv2

        found = []
        for x, y, side in tiles(image.shape[1], image.shape[0], small=True):
            tile = cv2.resize(image[y : y + side, x : x + side], (300, 300))
            self.network.set_tensor(self.input, (tile.astype(np.float32) / 127.5 - 1)[None])
            self.network.invoke()
            box = self.network.get_tensor(self.boxes).reshape(-1, 4)
            score = (1 / (1 + np.exp(-self.network.get_tensor(self.classes).reshape(-1, 24))))[:, OPEN_IMAGES_CARS].max(1)
            a = self.anchors
            cy, cx = box[:, 0] / 10 * a[:, 2] + a[:, 0], box[:, 1] / 10 * a[:, 3] + a[:, 1]
            h, w = np.exp(box[:, 2] / 5) * a[:, 2], np.exp(box[:, 3] / 5) * a[:, 3]
            corners = np.c_[cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2] * side + [x, y, x, y]
            boxes = [(*corner, s) for corner, s in zip(corners[score > LEAST_SCORE], score[score > LEAST_SCORE])]
            found += [box for box in boxes if not is_cut(box, (x, y, side), image.shape[1], image.shape[0])]
        return suppressed(found)


class CocoCenterNet:
    """The CenterNet of `@vladmandic/human` (COCO, 512 x 512), by TensorFlow.js."""

    def __init__(self, options):
        here = pathlib.Path(__file__).parent
        words = ["node", here / "peer_centernet.mjs", options.human / "models", options.node_modules, str(options.threads)]
        self.node = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def cars(self, image):
        import cv2

        found = []
        for x, y, side in tiles(image.shape[1], image.shape[0], small=False):
            tile = np.ascontiguousarray(cv2.resize(image[y : y + side, x : x + side], (512, 512)))
            self.node.stdin.write(tile.tobytes())
            self.node.stdin.flush()
            for x1, y1, x2, y2, score, kind in json.loads(self.node.stdout.readline())["found"]:
                if round(kind) in COCO_CARS and score > LEAST_SCORE:
                    f = side / 512
                    box = (x + f * x1, y + f * y1, x + f * x2, y + f * y2, score)
                    if not is_cut(box, (x, y, side), image.shape[1], image.shape[0]):
                        found.append(box)
        return suppressed(found)

    def kib(self):
        self.node.stdin.close()
        return json.loads(self.node.stderr.read().decode().splitlines()[-1])["kib"]


class RandomSmoke:
    """SMOKE at full size in eager PyTorch (1280 x 384, group norm, deformable neck), random weights."""

    def __init__(self, options):
        import torch
        from compare_training_step import Smoke

        torch.set_num_threads(options.threads)
        self.torch = torch
        self.network = Smoke([16, 32, 64, 128, 256, 512], 256, "group", "deformable").eval()

    def cars(self, image):
        import cv2

        with self.torch.inference_mode():
            planes = cv2.resize(image, (1280, 384)).astype(np.float32).transpose(2, 0, 1)[None] / 255
            self.network(self.torch.from_numpy(np.ascontiguousarray(planes)))
        return []


PEERS = {"ssd": OpenImagesSsd, "centernet": CocoCenterNet, "smoke": RandomSmoke}


def run_peer(options):
    """In a process of its own: rows of results, and what it took, as a line of JSON."""
    import cv2

    peer = PEERS[options.peer](options)
    images, times = frames(options), []
    out = pathlib.Path(options.results)
    if options.peer == "smoke":
        images = images[:8]
    for place, (name, path, projection) in enumerate(images):
        start = time.perf_counter()
        image = cv2.imread(str(path))[:, :, ::-1]
        boxes = peer.cars(image)
        # The first one warms up.
        if place > 0:
            times.append(time.perf_counter() - start)
        focal, (cx, cy) = projection[0], (projection[2], projection[6])
        rows = []
        for x1, y1, x2, y2, score in boxes:
            z = focal * CAR_HEIGHT_M / max(y2 - y1, 1.0)
            x, y = ((x1 + x2) / 2 - cx) * z / focal, (y2 - cy) * z / focal
            rows.append(f"Car -1 -1 0 {x1:.2f} {y1:.2f} {x2:.2f} {y2:.2f} {CAR_SIZE} {x:.2f} {y:.2f} {z:.2f} 0 {score:.4f}")
        (out / f"{name}.txt").write_text("".join(row + "\n" for row in rows))
    kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss + (peer.kib() if hasattr(peer, "kib") else 0)
    print(json.dumps({"ms": 1e3 * statistics.median(times), "mb": kib / 1e3}))


def frames(options):
    names = options.split.read_text().split()
    training = options.data / "training"
    def projection(name):
        rows = (training / "calib" / f"{name}.txt").read_text().splitlines()
        return [float(v) for v in next(row for row in rows if row.startswith("P2:")).split()[1:]]
    return [(name, training / "image_2" / f"{name}.png", projection(name)) for name in names]


def judged(options, results):
    """Found, false alarms, MAE and relative error at the score where false alarms are few enough."""
    labels = options.data / "training" / "label_2"
    with tempfile.TemporaryDirectory() as folder:
        answer = pathlib.Path(folder) / "eval.json"
        words = [options.farsight, "eval", "--labels", labels, "--results", results, "--split", options.split, "--resamples", "0"]
        subprocess.run([*words, "--json", answer, "--quiet"], check=True, stdout=subprocess.DEVNULL)
        points = json.loads(answer.read_text())["operating"]["car"]
    point = next(p for p in points if p["false_alarms_per_frame"] <= FALSE_ALARMS)
    share = 100 * point["found"] / point["objects"]
    return [
        f'{point["found"]} of {point["objects"]} ({share:.0f}%)',
        f'{point["false_alarms_per_frame"]:.2f} at {point["score"]:.2f}',
        f'{point["mae_z"]:.2f} m',
        f'{100 * point["median_abs_rel_z"]:.1f}%',
    ]


def farsight_row(options, results, name, words):
    """Farsight's own: answers by `range`, times and memory by `bench` on the middle image."""
    images = [str(path) for _, path, _ in frames(options)]
    ours = [options.farsight, "range", *images, *words, "--min-score", "0.05", "--kitti", results, "--quiet"]
    subprocess.run(ours, check=True, stdout=subprocess.DEVNULL)
    with tempfile.TemporaryDirectory() as folder:
        answer = pathlib.Path(folder) / "bench.json"
        bench = [options.farsight, "bench", *words, "--image", images[len(images) // 2], "--runs", "9", "--images", "1"]
        subprocess.run([*bench, "--json", answer], check=True, stdout=subprocess.DEVNULL)
        told = json.loads(answer.read_text())
    return [name, *judged(options, results), f'{told["total"]["median_ms"]:.0f}', f'{told["peak_memory_mb"]:.0f}']


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("farsight", "data", "split", "objectron", "human", "node-modules", "table", "results"):
        parser.add_argument(f"--{name}", type=pathlib.Path)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--peer", choices=PEERS)
    options = parser.parse_args()
    if options.peer:
        return run_peer(options)
    rows = []
    peers = {
        "ssd": "SSD of Objectron, 13 tiles, LiteRT; similar triangles",
        "centernet": "CenterNet of human, 5 tiles, TensorFlow.js; similar triangles",
        "smoke": "SMOKE, full size, PyTorch, random weights",
    }
    for peer, name in peers.items():
        with tempfile.TemporaryDirectory() as results:
            words = [sys.executable, __file__, *sys.argv[1:], "--peer", peer, "--results", results]
            done = subprocess.run(words, stdout=subprocess.PIPE, text=True)
            if done.returncode:
                print(f"{name}: left out (see above)", file=sys.stderr)
                continue
            told = json.loads(done.stdout.splitlines()[-1])
            found = ["-"] * 4 if peer == "smoke" else judged(options, results)
            rows.append([name, *found, f'{told["ms"]:.0f}', f'{told["mb"]:.0f}'])
            print(rows[-1], flush=True)
    for model in ("farsight-w", "farsight-n"):
        for engine, precision in (("rten", "f32"), ("openvino", "f32"), ("openvino", "int8")):
            words = ["--model", model, "--engine", engine, "--precision", precision]
            with tempfile.TemporaryDirectory() as results:
                rows.append(farsight_row(options, results, f"{model}, {engine}, {precision}", words))
                print(rows[-1], flush=True)
    if options.table:
        table = MeasuredTable("python3 scripts/compare_peers.py", COLUMNS)
        for row in rows:
            table.put(*row)
        table.write(options.table)


if __name__ == "__main__":
    main()
