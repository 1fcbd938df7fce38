#!/usr/bin/env python3
"""The figures of a model card: real frames, rendered twins of KITTI's validation split, rendered cameras of other fields of view.

    python3 scripts/measure_model.py --farsight target/release/farsight --kitti KITTI --labels KITTI_ALL --twins 400 --out runs/card

KITTI is a folder in KITTI's layout with real frames and ImageSets/val.txt; KITTI_ALL one with all labels and calibrations (images are not needed) and the same
file for the official split. Without them those parts are left out. --model names another model than the shipped one. Needs Python alone.
"""
import argparse
import math
import pathlib
import statistics
import subprocess

# Horizontal fields of view, degrees; the second is KITTI's.
CAMERAS = [40, 81, 95, 110]
CAMERA_SIZE = (1242, 375)
MIN_OVERLAP = 0.5
# KITTI's Moderate: height of the box, occlusion, truncation.
MODERATE = (25.0, 1, 0.3)


def rows(path):
    """Class, truncation, occlusion, 2D box, z, score of each row of a label or result file."""
    for line in path.read_text().splitlines():
        f = line.split()
        score = float(f[15]) if len(f) > 15 else None
        yield f[0], float(f[1]), int(float(f[2])), [float(v) for v in f[4:8]], float(f[13]), score


def overlap(a, b):
    width = min(a[2], b[2]) - max(a[0], b[0])
    height = min(a[3], b[3]) - max(a[1], b[1])
    if width <= 0 or height <= 0:
        return 0.0
    area = lambda box: (box[2] - box[0]) * (box[3] - box[1])
    return width * height / (area(a) + area(b) - width * height)


def is_moderate(row):
    height, occlusion, truncation = MODERATE
    kind, cut, hidden, box, _, _ = row
    return kind == "Car" and box[3] - box[1] >= height and hidden <= occlusion and cut <= truncation


def cars(labels, results, min_score):
    """Moderate cars, those found, false alarms a frame and relative errors; greedy by score, one detection an object."""
    objects, errors, false_alarms, frames = 0, [], 0, 0
    for path in sorted(results.glob("*.txt")):
        truth = list(rows(labels / path.name))
        frames += 1
        taken = set()
        detections = sorted((r for r in rows(path) if r[0] == "Car" and r[5] >= min_score), key=lambda r: -r[5])
        for detection in detections:
            best = max(range(len(truth)), key=lambda i: overlap(truth[i][3], detection[3]) if i not in taken else -1, default=None)
            if best is not None and best not in taken and overlap(truth[best][3], detection[3]) >= MIN_OVERLAP:
                taken.add(best)
                if is_moderate(truth[best]):
                    errors.append((truth[best][4], detection[4]))
            elif not any(t[0] == "DontCare" and overlap(t[3], detection[3]) > 0 for t in truth):
                # Low boxes are below what KITTI labels reliably.
                false_alarms += detection[3][3] - detection[3][1] >= MODERATE[0]
        objects += sum(is_moderate(row) for row in truth)
    return objects, errors, false_alarms / max(frames, 1), frames


def tell(name, labels, results, min_score):
    objects, errors, false_alarms, frames = cars(labels, results, min_score)
    relative = [abs(found - true) / true for true, found in errors]
    print(f"{name}: {frames} frames, score >= {min_score}: {len(errors)} of {objects} Moderate cars found"
          f" ({100 * len(errors) / max(objects, 1):.0f}%), {false_alarms:.2f} false alarms a frame")
    if errors:
        mae = statistics.mean(abs(found - true) for true, found in errors)
        print(f"    MAE {mae:.2f} m, relative error median {100 * statistics.median(relative):.1f}%, mean {100 * statistics.mean(relative):.1f}%")
    for low in range(0, 70, 10):
        part = [abs(found - true) / true for true, found in errors if low <= true < low + 10]
        if part:
            print(f"    {low:2}-{low + 10} m: {len(part)} found, median relative error {100 * statistics.median(part):.1f}%")


def evaluate(args, data, split, out):
    results = out / "results"
    command = [args.farsight, "eval", "--data", data, "--results", results, "--classic", "--resamples", "0", "--json", out / "eval.json"]
    if split:
        command += ["--split", split]
    if args.model:
        command += ["--model", args.model]
    out.mkdir(parents=True, exist_ok=True)
    answer = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True).stdout
    (out / "eval.txt").write_text(answer)
    print(answer)
    return results


def render(args, out, *options):
    if not (out / "training").exists():
        subprocess.run([str(word) for word in [args.farsight, "synth", "--out", out, *options]], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--farsight", required=True)
    parser.add_argument("--model", type=pathlib.Path)
    parser.add_argument("--kitti", type=pathlib.Path)
    parser.add_argument("--labels", type=pathlib.Path)
    parser.add_argument("--twins", type=int, default=400)
    parser.add_argument("--camera-frames", type=int, default=60)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.kitti:
        print("== real frames, never trained on")
        results = evaluate(args, args.kitti, "val", args.out / "real")
        for score in (0.25, 0.35):
            tell("real", args.kitti / "training/label_2", results, score)
    if args.labels:
        print(f"== rendered twins of the first {args.twins} frames of the validation split")
        twins = args.out / "twins"
        training = args.labels / "training"
        render(args, twins, "--layout", training / "label_2", "--calib-dir", training / "calib",
               "--split", args.labels / "ImageSets/val.txt", "--frames", args.twins, "--seed", 77)
        results = evaluate(args, twins, None, args.out / "twins_eval")
        tell("twins", twins / "training/label_2", results, 0.25)
    print("== rendered scenes, other fields of view")
    width, height = CAMERA_SIZE
    for hfov in CAMERAS:
        focal = 0.5 / math.tan(math.radians(hfov / 2))
        world = args.out / f"hfov{hfov}.toml"
        world.write_text(f"farthest_m = 75.0\n[[cameras]]\nshare = 1.0\nimage_sizes = [[{width}, {height}]]\nfocal_widths = [{focal}, {focal}]\n")
        data = args.out / f"hfov{hfov}"
        render(args, data, "--world", world, "--frames", args.camera_frames, "--seed", 4242)
        results = evaluate(args, data, None, args.out / f"hfov{hfov}_eval")
        tell(f"{hfov} degrees", data / "training/label_2", results, 0.25)


if __name__ == "__main__":
    main()
