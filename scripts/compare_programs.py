"""Whether two builds of Farsight answer alike: python scripts/compare_programs.py OLD NEW [IMAGE ...]

OLD and NEW are programs, such as that of commit 4277060 and today's. Both range the shipped scenes (or the images that
are named, with calibrations in KITTI's layout beside them) by farsight-s on rten, with one thread and with two.
Everything that the old JSON has must be in the new one and be equal, numbers to the last digit; new fields are let
pass. The exit status is 1 if anything differs. How to build the old one:

    git worktree add ../old 4277060 && cargo build --release --locked --manifest-path ../old/Cargo.toml

Needs nothing but Python.
"""
import argparse
import json
import pathlib
import subprocess
import sys
import tempfile

SCENES = pathlib.Path(__file__).resolve().parent.parent / "assets/scenes/image_2"


def answers(program, images, threads):
    """The parsed JSON. Before there were two models, farsight-s had no name."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "answers.json"
        common = [program, "range", *map(str, images), "--threads", str(threads), "--json", str(out)]
        named = subprocess.run([*common, "--model", "farsight-s"], capture_output=True, text=True)
        if named.returncode and "farsight-s" in named.stderr:
            named = subprocess.run(common, capture_output=True, text=True)
        if named.returncode:
            sys.exit(f"{program}: {named.stderr}")
        # Numbers stay the text that was printed.
        return json.loads(out.read_text(), parse_float=str, parse_int=str)


def differences(old, new, place):
    """Where `new` lacks or contradicts something that `old` says."""
    if isinstance(old, dict) and isinstance(new, dict):
        missing = [f"{place}.{key} is gone" for key in old if key not in new]
        return missing + [d for key in old if key in new for d in differences(old[key], new[key], f"{place}.{key}")]
    if isinstance(old, list) and isinstance(new, list):
        if len(old) != len(new):
            return [f"{place}: {len(old)} entries, now {len(new)}"]
        return [d for i, pair in enumerate(zip(old, new)) for d in differences(*pair, f"{place}[{i}]")]
    return [] if old == new else [f"{place}: {old}, now {new}"]


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("old")
    parser.add_argument("new")
    parser.add_argument("images", nargs="*", type=pathlib.Path)
    args = parser.parse_args()
    images = args.images or sorted(SCENES.glob("*.jpg"))
    differs = False
    for threads in (1, 2):
        old, new = (answers(program, images, threads) for program in (args.old, args.new))
        found = differences(old, new, "answers")
        objects = sum(len(image["detections"]) for image in old)
        differs |= bool(found)
        told = f"{len(found)} differences" if found else "the same"
        print(f"{threads} thread{'s' * (threads > 1)}: {len(old)} images, {objects} objects, {told}")
        for line in found[:20]:
            print(f"  {line}")
    sys.exit(differs)


if __name__ == "__main__":
    main()
