#!/usr/bin/env python3
"""Seconds and AP of Farsight's evaluation and of the official C++ devkit on the same files, taking turns in one run.

    cargo build --release -p farsight -p farsight-eval --bins --examples
    target/release/examples/make_eval_set EVAL_SET 3769 1
    python3 scripts/compare_evaluators.py --devkit devkit_object/cpp/evaluate_object.cpp --set EVAL_SET \
        --table docs/results/evaluators.json

The devkit is not part of Farsight: it comes with KITTI's object benchmark (devkit_object.zip), or as github.com/xiaoliangabc/devkit_object,
commit c2bc8ce6, the copy that ours is compared with (the script says whether the file is that one, bit for bit). It needs g++ and the headers
of Boost (Debian: libboost-dev; elsewhere --boost DIR). Nothing in the devkit is changed but the number of frames; its e-mails go to a stub and
gnuplot is hidden from it, so that its time is that of the evaluation. Both programs are measured from start to exit, reading included:
seconds on the clock, and seconds of processor time (all threads), which other work on the machine disturbs less.
--set is a folder with label_2 and results, the files 000000.txt and on; --labels and --results name other ones.
--table puts a row into a table that documents quote (measured_table.py).
"""

import argparse
import hashlib
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from measured_table import MeasuredTable

# git's hash of cpp/evaluate_object.cpp in the reference copy.
REFERENCE_BLOB = "05817f89a32f4a0a74a061bcd880474d453f02d5"

CLASSES = ["car", "pedestrian", "cyclist"]
CURVES = {"2d": "detection", "aos": "orientation", "bev": "detection_ground", "3d": "detection_3d"}

# The devkit writes six decimals.
AP_TOLERANCE = 1e-4

MAIL_STUB = "struct Mail { Mail(const char* = 0) {} void msg(const char*, ...) {} };\n"


def git_hash(data):
    return hashlib.sha1(b"blob %d\0" % len(data) + data).hexdigest()


def compiled(source, frames, boost, folder):
    """The devkit for this number of frames; says what it was made from."""
    blob = git_hash(source.read_bytes())
    print(f"devkit: {source.name} {blob[:12]}, {'the reference copy' if blob == REFERENCE_BLOB else 'NOT the reference copy'}")
    text, count = re.subn(r"(?m)^(const int32_t N_TESTIMAGES\s*=\s*)\d+", rf"\g<1>{frames}", source.read_text())
    if count != 1:
        sys.exit(f"{source}: no line \"const int32_t N_TESTIMAGES = ...\"; expected the devkit's evaluate_object.cpp")
    (folder / "evaluate_object.cpp").write_text(text)
    (folder / "mail.h").write_text(MAIL_STUB)
    include = ["-isystem", str(boost)] if boost else []
    command = ["g++", "-O3", "-DNDEBUG", "-w", *include, "-o", "evaluate_object", "evaluate_object.cpp"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "evaluate_object"


def seconds(command, cwd, env):
    """Time on the clock and processor time of one run."""
    start = time.perf_counter()
    process = subprocess.Popen(command, cwd=cwd, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    _, status, usage = os.wait4(process.pid, 0)
    clock = time.perf_counter() - start
    if status != 0:
        sys.exit(f"{Path(command[0]).name} failed: wait status {status}")
    return clock, usage.ru_utime + usage.ru_stime


def devkit_ap(plots):
    """R40 and R11 of all curves that the devkit wrote, by class, metric and recall."""
    table = {}
    for name in CLASSES:
        for metric, curve in CURVES.items():
            path = plots / f"{name}_{curve}.txt"
            if path.is_file():
                rows = [[float(word) for word in line.split()] for line in path.read_text().splitlines()]
                points = list(zip(*rows))[1:]
                table[name, metric, "r40"] = [100 * sum(level[1:]) / 40 for level in points]
                table[name, metric, "r11"] = [100 * sum(level[::4]) / 11 for level in points]
    return table


def largest_difference(ours, theirs):
    """The largest difference of AP in percentage points; stops when one of the two evaluates what the other does not."""
    largest, cells = 0.0, 0
    for name in CLASSES:
        for metric in CURVES:
            for recall in ("r40", "r11"):
                here, there = ours["ap"][name][metric], theirs.get((name, metric, recall))
                if (here is None) != (there is None):
                    sys.exit(f"{name} {metric}: evaluated by one of the two only")
                if there is not None:
                    largest = max([largest, *(abs(a - b) for a, b in zip(here[recall], there))])
                    cells += len(there)
    return largest, cells


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--devkit", type=Path, required=True, help="the devkit's evaluate_object.cpp")
    parser.add_argument("--set", type=Path, help="folder with label_2 and results")
    parser.add_argument("--labels", type=Path)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--farsight", type=Path, default=Path("target/release/farsight"))
    parser.add_argument("--boost", type=Path, help="folder that holds boost/geometry.hpp")
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--table", type=Path, help="put the medians into this table (JSON)")
    args = parser.parse_args()
    labels, results = args.labels or args.set / "label_2", args.results or args.set / "results"
    frames = len(list(results.glob("*.txt")))
    detections = sum(path.read_bytes().count(b"\n") for path in results.glob("*.txt"))
    print(f"{frames} frames, {detections} detections")

    with tempfile.TemporaryDirectory() as scratch:
        scratch = Path(scratch)
        program = compiled(args.devkit, frames, args.boost, scratch)
        (scratch / "data/object").mkdir(parents=True)
        (scratch / "data/object/label_2").symlink_to(labels.resolve())
        (scratch / "results/run/plot").mkdir(parents=True)
        (scratch / "results/run/data").symlink_to(results.resolve())
        # Only what the devkit needs besides its plots.
        (scratch / "bin").mkdir()
        for tool in ("mkdir", "rm"):
            (scratch / "bin" / tool).symlink_to(shutil.which(tool))
        answer = scratch / "farsight.json"
        farsight = [args.farsight.resolve(), "eval", "--labels", labels.resolve(), "--results", results.resolve()]
        farsight += ["--resamples", "0", "--json", answer]
        one_thread = os.environ | {"RAYON_NUM_THREADS": "1"}
        runs = {
            "devkit": ([program, "run"], {"PATH": str(scratch / "bin")}),
            "Farsight": (farsight, dict(os.environ)),
            "Farsight, one thread": (farsight, one_thread),
        }
        times = {name: [] for name in runs}
        for _ in range(args.rounds):
            for name, (command, env) in runs.items():
                times[name].append(seconds(command, scratch, env))
                print(f"{name}: {times[name][-1][0]:.3f} s, processor {times[name][-1][1]:.3f} s", flush=True)
        difference, cells = largest_difference(json.loads(answer.read_text()), devkit_ap(scratch / "results/run/plot"))

    ratios = {}
    for which, heading in enumerate(["clock", "processor"]):
        print(f"\n{heading + ', seconds':<22}{'median':>9}{'least':>9}{'most':>9}   devkit / this, median of the rounds")
        for name, taken in times.items():
            own, devkit = ([round_[which] for round_ in rounds] for rounds in (taken, times["devkit"]))
            ratios[name, heading] = statistics.median(a / b for a, b in zip(devkit, own))
            print(f"{name:<22}{statistics.median(own):>9.3f}{min(own):>9.3f}{max(own):>9.3f}   {ratios[name, heading]:.1f}")
    print(f"\nlargest difference in {cells} values of AP: {difference:.1e} percentage points")
    if not cells or difference > AP_TOLERANCE:
        sys.exit("the two do not agree")
    if args.table:
        columns = ["results", "detections", "devkit, processor, s", "Farsight, processor, s", "ratio", "ratio, one thread"]
        columns += ["ratio on the clock", "largest difference of AP"]
        command = "python3 scripts/compare_evaluators.py --devkit DEVKIT --set SET"
        table = MeasuredTable.opened(args.table, f"{command} --rounds {args.rounds}", columns)
        spent = (f"{statistics.median(round_[1] for round_ in times[name]):.2f}" for name in ("devkit", "Farsight"))
        run, one = "Farsight", "Farsight, one thread"
        told = [f"{ratio:.0f}" for ratio in (ratios[run, "processor"], ratios[one, "processor"], ratios[run, "clock"])]
        table.put(results.resolve().parent.name, str(detections), *spent, *told, f"{difference:.1e}")
        table.write(args.table)


if __name__ == "__main__":
    main()
