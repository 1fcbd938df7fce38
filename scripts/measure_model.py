#!/usr/bin/env python3
"""The figures of a model card: real frames, rendered twins of KITTI's validation split, rendered cameras of other fields of view.

    farsight synth --out TWINS --layout KITTI_ALL/training/label_2 --calib-dir KITTI_ALL/training/calib --seed 5
    mkdir -p TWINS/ImageSets; cp KITTI_ALL/ImageSets/{train,val}.txt TWINS/ImageSets
    python3 scripts/disturb_frames.py --kitti KITTI --out COPIES
    python3 scripts/measure_model.py --farsight target/release/farsight --kitti KITTI --copies COPIES --twins TWINS --out runs/card

KITTI is a folder in KITTI's layout with at least the frames of configs/splits; KITTI_ALL one with all labels and calibrations (images are not needed) and the
official split. Without --kitti, --copies or --twins those parts are left out; --split names a shorter split of the twins, --model another model than the shipped
one. Needs Python alone.
"""
import argparse
import json
import math
import pathlib
import subprocess

# Horizontal fields of view, degrees; the second is KITTI's.
CAMERAS = [40, 81, 95, 110]
SPLITS = pathlib.Path(__file__).resolve().parents[1] / "configs/splits"
REAL = {"20 real frames": "real20", "64 real frames": "real64"}
CAMERA_SIZE = (1242, 375)
# Limits of score that are told, and the false alarms a frame that the last line keeps to.
SCORES = (0.25, 0.5)
FEW_FALSE_ALARMS = 0.3


def tell(name, figures):
    """Found cars, false alarms and errors at the limits of score, and by distance with all scores."""
    rows = figures["operating"]["car"]
    chosen = [row for row in rows if any(abs(row["score"] - score) < 1e-9 for score in SCORES)]
    chosen += [row for row in rows if row["false_alarms_per_frame"] <= FEW_FALSE_ALARMS][:1]
    for row in chosen:
        line = (f"{name}: {figures['frames']} frames, score >= {row['score']:.2f}: {row['found']} of {row['objects']} Moderate cars found"
                f" ({100 * row['found'] / max(row['objects'], 1):.0f}%), {row['false_alarms_per_frame']:.2f} false alarms a frame")
        if row["found"]:
            line += f", MAE {row['mae_z']:.2f} m, relative error median {100 * row['median_abs_rel_z']:.1f}%"
        print(line)
    for distance, errors in figures["ranging"]["car"]["moderate"]["by_distance"].items():
        if errors["found"]:
            print(f"    {distance:>6} m: {errors['found']} of {errors['objects']} found at any score, MAE {errors['mae_z']:.2f} m,"
                  f" bias {errors['bias_z']:+.2f} m, mean relative error {100 * errors['abs_rel_z']:.1f}%")


def evaluate(args, data, split, out):
    """The figures of the model on `data`; the report goes to eval.txt and to the screen."""
    command = [args.farsight, "eval", "--data", data, "--results", out / "results", "--classic", "--resamples", "0", "--json", out / "eval.json"]
    if split:
        command += ["--split", split]
    if args.model:
        command += ["--model", args.model]
    out.mkdir(parents=True, exist_ok=True)
    answer = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True).stdout
    (out / "eval.txt").write_text(answer)
    print(answer)
    return json.loads((out / "eval.json").read_text())


def evaluate_copies(args, name, split):
    """The figures of the frames of `split` and their copies: means over how they are shown."""
    folders = [args.kitti, *sorted(folder for folder in args.copies.iterdir() if folder.is_dir())]
    all_figures = [evaluate(args, folder, SPLITS / f"{split}.txt", args.out / f"{split}_{folder.name}") for folder in folders]
    errors = [figures["ranging"]["car"]["moderate"]["mae_z"] for figures in all_figures]
    shares = []
    for figures in all_figures:
        few = [row for row in figures["operating"]["car"] if row["false_alarms_per_frame"] <= FEW_FALSE_ALARMS]
        shares.append(few[0]["found"] / few[0]["objects"])
    for folder, error, share in zip(folders, errors, shares):
        print(f"{name}, {folder.name}: MAE {error:.2f} m at any score, {100 * share:.0f}% found with at most {FEW_FALSE_ALARMS} false alarms a frame")
    print(f"{name}, mean: MAE {sum(errors) / len(errors):.2f} m, {100 * sum(shares) / len(shares):.0f}% found")


def rank_by_place(args, data, split, out):
    """AP of the results that `evaluate` kept, ranked by place scores; to the screen and to place.txt."""
    command = [args.farsight, "eval", "--labels", data / "training/label_2", "--results", out / "results", "--split", data / f"ImageSets/{split}.txt",
               "--resamples", "0", "--scores", "place"]
    answer = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=True).stdout
    (out / "place.txt").write_text(answer)
    print("== the same, AP by place scores")
    print(answer.split("\n\n")[1])


def render(args, out, *options):
    if not (out / "training").exists():
        subprocess.run([str(word) for word in [args.farsight, "synth", "--out", out, *options]], check=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--farsight", required=True)
    parser.add_argument("--model", type=pathlib.Path)
    parser.add_argument("--kitti", type=pathlib.Path)
    parser.add_argument("--copies", type=pathlib.Path, help="what scripts/disturb_frames.py wrote")
    parser.add_argument("--twins", type=pathlib.Path)
    parser.add_argument("--split", default="val")
    parser.add_argument("--camera-frames", type=int, default=60)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    if args.kitti:
        for name, split in REAL.items():
            print(f"== {name}, never trained on")
            tell(name, evaluate(args, args.kitti, SPLITS / f"{split}.txt", args.out / split))
    if args.kitti and args.copies:
        for name, split in REAL.items():
            print(f"== {name}, and mirrored, cut and brighter copies of them")
            evaluate_copies(args, name, split)
    if args.twins:
        print(f"== rendered twins of KITTI's frames, split {args.split}")
        tell("twins", evaluate(args, args.twins, args.split, args.out / "twins"))
        rank_by_place(args, args.twins, args.split, args.out / "twins")
    print("== rendered scenes, other fields of view")
    width, height = CAMERA_SIZE
    for hfov in CAMERAS:
        focal = 0.5 / math.tan(math.radians(hfov / 2))
        world = args.out / f"hfov{hfov}.toml"
        world.write_text(f"farthest_m = 75.0\n[[cameras]]\nshare = 1.0\nimage_sizes = [[{width}, {height}]]\nfocal_widths = [{focal}, {focal}]\n")
        data = args.out / f"hfov{hfov}"
        render(args, data, "--scene-config", world, "--frames", args.camera_frames, "--seed", 4242)
        tell(f"{hfov} degrees", evaluate(args, data, None, args.out / f"hfov{hfov}_eval"))


if __name__ == "__main__":
    main()
