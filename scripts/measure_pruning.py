#!/usr/bin/env python3
"""Cost and error of a model against the share of channels that pruning leaves, after fine-tuning.

    cargo xtask exec cargo build --workspace --features farsight/train && cargo build --release
    cargo xtask run synth --out FRAMES --frames 300 --seed 31
    cargo xtask exec python3 scripts/measure_pruning.py --trainer target/debug/farsight --farsight target/release/farsight \\
        --config configs/farsight-s.toml --model models/farsight-s.safetensors --data FRAMES --out runs/pruning

The whole model gets the same further training as the pruned ones. FRAMES is a folder in KITTI's layout; all its frames are evaluated.
Needs Python 3.11 alone, and a Farsight that was built with training.
"""
import argparse
import json
import pathlib
import re
import statistics
import subprocess

# Rounds in which the networks are timed.
ROUNDS = 5


def run(*words):
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True).stdout


def finetune(args, start, out):
    """Trains on from `start` as the config says, but for another seed, length and rate."""
    if (out / "model.safetensors").exists():
        return
    text = args.config.read_text()
    changes = {"start_from": f'"{start}"', "seed": 1000, "epochs": 1, "learning_rate": args.rate, "frames_per_epoch": args.frames,
               "warm_up_steps": 10}
    for key, value in changes.items():
        text, count = re.subn(rf"(?m)^{key} = .*$", f"{key} = {value}", text)
        assert count == 1, f"{args.config} has {count} lines with {key}; expected one"
    config = out.with_suffix(".toml")
    config.write_text(text)
    run(args.trainer, "train", "--config", config, "--out", out, "--resume")


def size(args, model):
    """Parameters and GMAC, as `farsight info` prints them."""
    _, parameters, gmacs = run(args.farsight, "info", model).splitlines()[-1].split()
    return parameters, float(gmacs)


def network_ms(args, models):
    """Medians over rounds in which all models take turns."""
    bench = args.out / "bench.json"
    times = {model: [] for model in models}
    for _ in range(ROUNDS):
        for model in models:
            run(args.farsight, "bench", "--model", model, "--refiner", "none", "--runs", 7, "--json", bench)
            times[model].append(dict(json.loads(bench.read_text())["stages"])["network"]["median_ms"])
    return {model: statistics.median(values) for model, values in times.items()}


def error(args, model, name):
    """Ranging figures of Moderate cars at a score of 0.25, and bird's-eye AP at 0.5, which a model that finds nothing does not have."""
    figures = args.out / f"{name}.json"
    if not figures.exists():
        run(args.farsight, "eval", "--data", args.data, "--model", model, "--results", args.out / f"{name}-results", "--min-score", 0.25,
            "--refiner", "none", "--above-road", "none", "--resamples", 0, "--json", figures)
    figures = json.loads(figures.read_text())
    bev = figures["ap_loose"]["car"]["bev"]
    return figures["ranging"]["car"]["moderate"], bev["r40"][1] if bev else 0.0


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("trainer", "farsight", "config", "model", "data", "out"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    parser.add_argument("--keep", type=float, nargs="+", default=[1.0, 0.75, 0.5, 0.25])
    parser.add_argument("--frames", type=int, default=1600)
    parser.add_argument("--rate", type=float, default=3e-4)
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for keep in args.keep:
        name = f"keep{round(100 * keep)}"
        start = args.model if keep == 1.0 else args.out / f"{name}.safetensors"
        if keep != 1.0:
            run(args.farsight, "prune", "--model", args.model, "--keep", keep, "--out", start)
        print(f"training on with {100 * keep:.0f}% of the channels", flush=True)
        finetune(args, start, args.out / name)
        model = args.out / name / "model.safetensors"
        rows.append((keep, model, error(args, start, f"{name}-raw")[0], *error(args, model, name)))
    times = network_ms(args, [row[1] for row in rows])
    print("| share kept | parameters | GMAC | network, ms | found | MAE | AP BEV at 0.5 | found without fine-tuning |\n|---:|---:|---:|---:|---:|---:|---:|---:|")
    for keep, model, before, ranging, bev in rows:
        parameters, gmacs = size(args, model)
        mae = "-" if ranging["mae_z"] is None else f"{ranging['mae_z']:.2f} m"
        print(f"| {keep:.2f} | {parameters} | {gmacs:.2f} | {times[model]:.1f} | {ranging['found']} of {ranging['objects']} ({100 * ranging['share']:.0f}%)"
              f" | {mae} | {bev:.2f} | {100 * before['share']:.0f}% |")


if __name__ == "__main__":
    main()
