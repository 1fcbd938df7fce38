#!/usr/bin/env python3
"""A folder of images from start to exit: an old program beside ways to run today's farsight-s, in turns in one run.

    git worktree add ../old 4277060 && cargo build --release --locked --manifest-path ../old/Cargo.toml
    python3 scripts/compare_folder.py --old ../old/target/release/farsight --images IMAGES --rounds 3 \
        --table docs/results/folder.json

IMAGES: a folder with calibrations in KITTI's layout beside it. The old program has farsight-s alone, and no name for it.
Needs nothing but Python, and the libraries of the engines.
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

from measured_table import MeasuredTable

COLUMNS = ["program", "seconds", "images a second", "times as fast", "objects"]
INT8 = ["--precision", "int8"]
WAYS = [
    ("farsight-s, rten", ["farsight-s", "--engine", "rten"]),
    ("farsight-s, rten, --effort fast", ["farsight-s", "--engine", "rten", "--effort", "fast"]),
    ("farsight-s, ONNX Runtime", ["farsight-s", "--engine", "onnxruntime"]),
    ("farsight-s, ONNX Runtime, 8 bits", ["farsight-s", "--engine", "onnxruntime", *INT8]),
    ("farsight-s, OpenVINO", ["farsight-s", "--engine", "openvino"]),
    ("farsight-s, OpenVINO, 8 bits", ["farsight-s", "--engine", "openvino", *INT8]),
    ("farsight-n, OpenVINO, 8 bits", ["farsight-n", "--engine", "openvino", *INT8]),
]


def timed(command):
    """Seconds of the command, images and objects in its answers."""
    with tempfile.TemporaryDirectory() as folder:
        answers = pathlib.Path(folder) / "answers.json"
        start = time.perf_counter()
        subprocess.run([*command, "--json", answers], check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        seconds = time.perf_counter() - start
        images = json.loads(answers.read_text())
    return seconds, len(images), sum(len(image["detections"]) for image in images)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--old", required=True, help="the old program")
    parser.add_argument("--farsight", default="target/release/farsight")
    parser.add_argument("--images", required=True, help="a folder")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--table", help="write the medians to this table (JSON)")
    options = parser.parse_args()

    ways = [("commit 4277060, rten", [options.old, "range", options.images])]
    for name, words in WAYS:
        ways.append((name, [options.farsight, "range", options.images, "--model", *words]))
    rounds = []
    for number in range(options.rounds):
        rounds.append([timed(command) for _, command in ways])
        print(f"round {number + 1} of {options.rounds}", [f"{seconds:.1f}" for seconds, _, _ in rounds[-1]], flush=True)
    images = rounds[0][0][1]
    table = MeasuredTable(f"python3 scripts/compare_folder.py --rounds {options.rounds}", COLUMNS)
    for place, (name, _) in enumerate(ways):
        seconds = statistics.median(measured[place][0] for measured in rounds)
        faster = statistics.median(measured[0][0] / measured[place][0] for measured in rounds)
        table.put(name, f"{seconds:.1f}", f"{images / seconds:.1f}", f"{faster:.2f}", str(rounds[0][place][2]))
    for row in [COLUMNS, *table.rows]:
        print(" | ".join(row))
    if options.table:
        table.write(options.table)


if __name__ == "__main__":
    main()
