#!/usr/bin/env python3
"""Designs of a small network side by side: parameters, time, and what each learns from the same rendered scenes.

    cargo xtask run synth --out runs/scenes --frames 300 --seed 999
    cargo xtask exec python3 scripts/compare_designs.py --farsight target/debug/farsight --scenes runs/scenes --out runs/designs

Every design gets the same seed, scenes, schedule and classes, those of configs/history/farsight-s-fourth.toml; only the lines below differ. A design whose model is there already is
not trained again. Time: `farsight bench` on the built-in engine with an image of --scenes, in turns, medians; leave the machine alone meanwhile.
Needs Python alone, and a Farsight that was built with training.
"""
import argparse
import json
import pathlib
import re
import statistics
import subprocess

ROOT = pathlib.Path(__file__).resolve().parent.parent
# Channels of the six levels, channels of the heads, MSFE. The first is configs/farsight-n.toml.
DESIGNS = {
    "n": ([16, 16, 16, 32, 48, 80], 32, "a"),
    "n, no MSFE": ([16, 16, 16, 32, 48, 80], 32, "none"),
    "n, deep levels wider": ([16, 16, 16, 32, 64, 128], 32, "a"),
    "n, fine levels wider": ([16, 16, 32, 32, 48, 64], 32, "a"),
}
ROUNDS, RUNS = 3, 9


def config(args, levels, head, msfe):
    """configs/history/farsight-s-fourth.toml with another network, shorter, from nothing."""
    text = (ROOT / "configs/history/farsight-s-fourth.toml").read_text()
    width, height = args.input.split("x")
    lines = {
        r"input = .*": f"input = [{width}, {height}]",
        r"width = .*": f"width = 0.25\nlevel_channels = {levels}\nhead_channels = {head}",
        r"msfe = .*": f'msfe = "{msfe}"',
        r"focal_range_px = .*": "",
        r"image_sizes = .*": f"image_sizes = [[{width}, {height}]]",
        r"frames_per_epoch = .*": f"frames_per_epoch = {args.frames}",
        r"epochs = .*": "epochs = 1",
        r"start_from = .*": "",
        r"statistics_batches = .*": "",
        r"seed = .*": "seed = 0",
    }
    for pattern, line in lines.items():
        text, count = re.subn(rf"(?m)^{pattern}$", line, text)
        assert count, f"configs/history/farsight-s-fourth.toml has no line {pattern}"
    return text


def run(*words):
    return subprocess.run([str(word) for word in words], check=True, capture_output=True, text=True).stdout


def learnt(args, out):
    """What the design finds after its training."""
    model = out / "model.safetensors"
    if not model.exists():
        run(args.farsight, "train", "--config", out.with_suffix(".toml"), "--out", out, "--resume")
    figures = out / "eval.json"
    run(args.farsight, "eval", "--data", args.scenes, "--model", model, "--resamples", 0, "--json", figures)
    return json.loads(figures.read_text())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--farsight", required=True)
    parser.add_argument("--scenes", type=pathlib.Path, required=True, help="labelled scenes to measure on, in KITTI's layout")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--input", default="416x128")
    parser.add_argument("--frames", type=int, default=2000, help="rendered scenes to learn from")
    parser.add_argument("--time-input", default="1280x384")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    outs, rows = {}, {}
    for number, (name, design) in enumerate(DESIGNS.items()):
        outs[name] = args.out / f"design-{number}"
        outs[name].with_suffix(".toml").write_text(config(args, *design))
        figures = learnt(args, outs[name])
        moderate = figures["ranging"]["car"]["moderate"]
        ap = figures["ap_loose"]["car"]
        rows[name] = f"{100 * moderate['share']:.1f}% found, MAE {moderate['mae_z']:.2f} m, AP at 0.5: BEV {ap['bev']['r40'][1]:.2f}, 3D {ap['3d']['r40'][1]:.2f}"
        print(f"{name}: {rows[name]}", flush=True)
    image = sorted((args.scenes / "training/image_2").iterdir())[0]
    times = {name: [] for name in DESIGNS}
    for _ in range(ROUNDS):
        for name, out in outs.items():
            told = out / "bench.json"
            run(args.farsight, "bench", "--image", image, "--model", out.with_suffix(".toml"), "--input", args.time_input, "--runs", RUNS, "--json", told)
            times[name].append(json.loads(told.read_text())["total"]["median_ms"])
    print()
    for name, out in outs.items():
        print(f"{name}: {statistics.median(times[name]):.0f} ms from file to detections at {args.time_input} | {rows[name]}")


if __name__ == "__main__":
    main()
