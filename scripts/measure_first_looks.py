#!/usr/bin/env python3
"""What the first look of models finds in photographs: the table of docs/backbones.md.

    measure_first_looks.py --farsight target/release/farsight --kitti KITTI [--cameras DIR ...] --out DIR NAME=MODEL.safetensors ...

KITTI is a folder in KITTI's layout with the frames of configs/splits; each folder of --cameras has image_2, label_2 and calib. No refiner,
no plates. On KITTI's frames cars, pedestrians and cyclists are counted (Moderate, overlap of 0.5 in the image) at the lowest score with at
most 0.3 false alarms of the class a frame, cars also at an overlap of 0.3 (boxes in the image are those of the boxes in space, so a car whose size or
distance is off can miss 0.5), and the mean absolute error of all cars found at any score; of the other cameras vehicles of all kinds that are
at most partly hidden and cut off, at most 0.5 false alarms a frame, where a detection below 25 px or one on any other labelled object is
none. A checkpoint of a run is a model, too: its optimiser is left out. Needs Python alone.
"""
import argparse
import json
import pathlib
import struct
import subprocess

SPLITS = pathlib.Path(__file__).resolve().parents[1] / "configs/splits"
KITTI_FALSE_ALARMS = 0.3
CAMERA_FALSE_ALARMS = 0.5
CLASSES = ("car", "pedestrian", "cyclist")
VEHICLES = {"Car", "Van", "Truck", "Tram"}
LEAST_HEIGHT_PX = 25.0
OVERLAP = 0.5
LOOSE_OVERLAP = 0.3
LEAST_SCORE = 0.05


def model_from_checkpoint(path, out):
    """`path`, or where it is a checkpoint of `farsight train` the model in it, written to `out`."""
    content = path.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    facts = header.pop("__metadata__", {})
    if "farsight.progress" not in facts:
        return path
    kept, data = {}, bytearray()
    for name, entry in header.items():
        if name.startswith(("adam.", "average.")):
            continue
        start, end = entry["data_offsets"]
        kept[name] = {**entry, "data_offsets": [len(data), len(data) + end - start]}
        data += content[8 + length + start : 8 + length + end]
    kept["__metadata__"] = {"farsight.model": json.dumps(json.loads(facts["farsight.run"])["model"])}
    text = json.dumps(kept).encode()
    text += b" " * (-len(text) % 8)
    out.write_bytes(struct.pack("<Q", len(text)) + text + data)
    return out


def evaluate(args, model, data, split, out):
    """Figures and results of `model` on `data`."""
    out.mkdir(parents=True, exist_ok=True)
    command = [args.farsight, "eval", "--data", data, "--model", model, "--refiner", "none", "--plates", "none", "--above-road", "none",
               "--results", out / "results", "--resamples", "0", "--threads", "1", "--json", out / "eval.json"]
    if split:
        command += ["--split", split]
    subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True)
    return json.loads((out / "eval.json").read_text())


def loosely(args, data, split, out):
    """Figures of the results that `evaluate` kept, at the looser overlap."""
    command = [args.farsight, "eval", "--labels", data / "training/label_2", "--results", out / "results", "--split", split, "--resamples", "0",
               "--ranging-overlap", LOOSE_OVERLAP, "--json", out / "loose.json"]
    subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True)
    return json.loads((out / "loose.json").read_text())


def found_of(figures, kind):
    """The most that are found with few false alarms, of how many."""
    few = [row for row in figures["operating"].get(kind, []) if row["false_alarms_per_frame"] <= KITTI_FALSE_ALARMS]
    best = max(few, key=lambda row: row["found"], default=None)
    return f"{best['found']} of {best['objects']}" if best else "-"


def rows(path):
    """Class, truncation, occlusion, box and score of each line of a label or result file."""
    for line in path.read_text().splitlines():
        words = line.split()
        yield words[0], float(words[1]), int(float(words[2])), [float(v) for v in words[4:8]], float(words[15]) if len(words) > 15 else 0.0


def overlap(a, b):
    inside = [max(0.0, min(a[i + 2], b[i + 2]) - max(a[i], b[i])) for i in (0, 1)]
    shared = inside[0] * inside[1]
    area = lambda box: (box[2] - box[0]) * (box[3] - box[1])
    return shared / max(area(a) + area(b) - shared, 1e-9)


def vehicles_found(labels, results):
    """Found, all, and the score: at the lowest one with few false alarms a frame."""
    judged, total, frames = [], 0, 0
    for label_file in sorted(labels.glob("*.txt")):
        frames += 1
        objects = [row for row in rows(label_file)]
        wanted = [row[3] for row in objects if row[0] in VEHICLES and row[1] <= 0.3 and row[2] <= 1
                  and row[3][3] - row[3][1] >= LEAST_HEIGHT_PX]
        others = [row[3] for row in objects if row[3] not in wanted]
        total += len(wanted)
        free = list(wanted)
        result_file = results / label_file.name
        found = sorted((row for row in rows(result_file) if row[0] in VEHICLES), key=lambda row: -row[4]) if result_file.exists() else []
        for row in found:
            best = max(free, key=lambda box: overlap(box, row[3]), default=None)
            if best is not None and overlap(best, row[3]) >= OVERLAP:
                free.remove(best)
                judged.append((row[4], True))
            elif row[3][3] - row[3][1] >= LEAST_HEIGHT_PX and not any(covered(box, row[3]) for box in others):
                judged.append((row[4], False))
    hits = alarms = 0
    best = (0, 1.0)
    for score, hit in sorted(judged, reverse=True):
        if score < LEAST_SCORE:
            break
        hits, alarms = hits + hit, alarms + (not hit)
        if alarms <= CAMERA_FALSE_ALARMS * frames:
            best = (hits, score)
    return best[0], total, best[1]


def covered(box, found):
    """Whether half of `found` lies in `box`."""
    inside = [max(0.0, min(box[i + 2], found[i + 2]) - max(box[i], found[i])) for i in (0, 1)]
    return inside[0] * inside[1] >= OVERLAP * (found[2] - found[0]) * (found[3] - found[1])


def measure(args, name, model):
    out = args.out / name
    out.mkdir(parents=True, exist_ok=True)
    model = model_from_checkpoint(model, out / "model.safetensors")
    cells = []
    for split in ("real64", "real20"):
        figures = evaluate(args, model, args.kitti, SPLITS / f"{split}.txt", out / split)
        cells += [found_of(figures, kind) for kind in CLASSES]
        cells.append(found_of(loosely(args, args.kitti, SPLITS / f"{split}.txt", out / split), "car"))
        cells.append(f"{figures['ranging']['car']['moderate']['mae_z']:.2f} m")
    for camera in args.cameras:
        data = out / camera.name / "data"
        data.mkdir(parents=True, exist_ok=True)
        link = data / "training"
        if not link.exists():
            link.symlink_to(camera.resolve())
        evaluate(args, model, data, None, out / camera.name)
        found, total, _ = vehicles_found(camera / "label_2", out / camera.name / "results")
        cells.append(f"{found} of {total}")
    print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--farsight", type=pathlib.Path, required=True)
    parser.add_argument("--kitti", type=pathlib.Path, required=True)
    parser.add_argument("--cameras", type=pathlib.Path, nargs="*", default=[])
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("models", nargs="+", metavar="NAME=MODEL")
    args = parser.parse_args()
    heads = [f"{split}: {head}" for split in ("64", "20") for head in (*CLASSES, "car at 0.3", "car MAE")] + [camera.name for camera in args.cameras]
    print("| model | " + " | ".join(heads) + " |\n|" + "---|" * (len(heads) + 1), flush=True)
    for entry in args.models:
        name, model = entry.split("=", 1)
        measure(args, name, pathlib.Path(model))


if __name__ == "__main__":
    main()
