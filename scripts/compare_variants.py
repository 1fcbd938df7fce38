#!/usr/bin/env python3
"""SMOKE, + CLFF, + DGH and both, trained alike on rendered twins of KITTI's train split, measured on those of the validation split.

    cargo xtask run synth --out TWINS --layout KITTI/training/label_2 --calib-dir KITTI/training/calib --seed 5
    cp KITTI/ImageSets/{train,val}.txt TWINS/ImageSets
    cargo xtask exec python3 scripts/compare_variants.py --farsight target/debug/farsight --data TWINS --out runs/variants

Every variant is a compact network (a quarter of the width, batch norm, plain convolutions, a stem that steps down at once) with the same seed, steps and frames; --seeds repeats all of it.
Of Farsight's own recipe they share one thing: the cells around an object's own teach the regression too, without which so short a training finds next to nothing.
A variant whose model is there already is not trained again. Needs Python alone, and a Farsight that was built with training.
"""
import argparse
import json
import pathlib
import subprocess

CORNER_NET = '{ rule = "corner_net", min_overlap = 0.7 }'
DYNAMIC = '{ rule = "dynamic", alpha = 0.12, min_radius = 1.0, max_radius = 16.0 }'
# Name, MSFE, heat map.
VARIANTS = [("smoke", "none", CORNER_NET), ("clff", "a", CORNER_NET), ("dgh", "none", DYNAMIC), ("both", "a", DYNAMIC)]

CONFIG = """\
method = "smoke"

[model]
input = [{width}, {height}]
width = {factor}
stem = "half"
norm = "batch"
neck = "plain"
msfe = "{msfe}"
heat_map = {heat_map}

[data]
split = "train"

[train]
seed = {seed}
threads = {threads}
epochs = {epochs}
batch_size = 8
learning_rate = 1e-3
weight_decay = 1e-4
warm_up_steps = 100
clip_norm = 35.0
precision = "{precision}"
checkpoint_steps = 500
log_steps = 50

[task]
neighbour_cells = 1
"""
AP_ROWS = [("2d", "2D"), ("bev", "BEV"), ("3d", "3D")]
COLUMNS = "car, AP at 40 points (Easy / Moderate / Hard); overlap 0.7, and 0.5 (loose); ranging of Moderate cars"


def run(*words):
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True).stdout


def train(args, name, msfe, heat_map, seed):
    out = args.out / f"{name}-{seed}"
    if (out / "model.safetensors").exists():
        return out
    out.mkdir(parents=True, exist_ok=True)
    width, height = args.input.split("x")
    config = args.out / f"{name}-{seed}.toml"
    config.write_text(CONFIG.format(msfe=msfe, heat_map=heat_map, seed=seed, width=width, height=height, factor=args.width,
                                    epochs=args.epochs, threads=args.threads, precision=args.precision))
    print(f"training {name}, seed {seed}", flush=True)
    run(args.farsight, "train", "--config", config, "--data", args.data, "--out", out, "--resume")
    return out


def evaluate(args, out):
    results, figures = out / "results", out / "eval.json"
    if not figures.exists():
        run(args.farsight, "eval", "--data", args.data, "--split", "val", "--model", out / "model.safetensors",
            "--results", results, "--resamples", 200, "--json", figures)
    return json.loads(figures.read_text())


def against(args, out, base):
    """The paired comparison with the baseline, as the evaluator prints it."""
    text = run(args.farsight, "eval", "--labels", args.data / "training/label_2", "--split", args.data / "ImageSets/val.txt",
               "--results", out / "results", "--against", base / "results")
    (out / "against.txt").write_text(text)
    return out / "against.txt"


def row(figures):
    """The figures of a run: three APs a column of the table, then found (%), MAE and RMSE."""
    moderate = figures["ranging"]["car"]["moderate"]
    aps = [figures[table]["car"][metric]["r40"] for table in ("ap", "ap_loose") for metric, _ in AP_ROWS]
    return [*aps, [100 * moderate["share"], moderate["mae_z"], moderate["rmse_z"]]]


def line(name, cells):
    *aps, (found, mae, rmse) = cells
    titles = 2 * [title for _, title in AP_ROWS]
    columns = [f"{title} " + "/".join(f"{v:.2f}" for v in values) for title, values in zip(titles, aps)]
    return " | ".join([f"{name:6}", *columns, f"found {found:.1f}%, MAE {mae:.2f}, RMSE {rmse:.2f} m"])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--farsight", required=True)
    parser.add_argument("--data", type=pathlib.Path, required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--input", default="416x128")
    parser.add_argument("--width", type=float, default=0.25, help="factor on SMOKE's channels")
    parser.add_argument("--epochs", type=int, default=3)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--precision", default="f32", choices=["f32", "bf16"])
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    told = {name: [] for name, _, _ in VARIANTS}
    for seed in range(args.seeds):
        outs = {name: train(args, name, msfe, heat_map, seed) for name, msfe, heat_map in VARIANTS}
        print(f"\nseed {seed}: {COLUMNS}")
        for name, out in outs.items():
            told[name].append(row(evaluate(args, out)))
            print(line(name, told[name][-1]), flush=True)
        for name, out in outs.items():
            if name != "smoke":
                print(f"{name} against smoke: {against(args, out, outs['smoke'])}")
    print(f"\nmean of {args.seeds} seeds: {COLUMNS}")
    for name, rows in told.items():
        print(line(name, [[sum(values) / len(rows) for values in zip(*cells)] for cells in zip(*rows)]))


if __name__ == "__main__":
    main()
