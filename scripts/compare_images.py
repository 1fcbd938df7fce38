#!/usr/bin/env python3
"""How photographs and their rendered twins differ as images: medians over the frames that both folders have.

    python3 scripts/compare_images.py --photographs KITTI/training/image_2 --rendered TWINS/training/image_2

Needs numpy and Pillow.
"""
import argparse
import pathlib

import numpy
from PIL import Image

# Grey values from which a pixel counts as white, and below which as dark.
WHITE = 250
DARK = 40


def statistics(file):
    """Standard deviation of the grey values, percent of white and of dark pixels, mean difference between neighbours in a row."""
    with Image.open(file) as image:
        grey = numpy.asarray(image.convert("L"), dtype=float)
    return grey.std(), 100 * (grey >= WHITE).mean(), 100 * (grey < DARK).mean(), numpy.abs(numpy.diff(grey, axis=1)).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photographs", type=pathlib.Path, required=True)
    parser.add_argument("--rendered", type=pathlib.Path, required=True)
    args = parser.parse_args()
    shared = sorted({file.name for file in args.photographs.glob("*.png")} & {file.name for file in args.rendered.glob("*.png")})
    if not shared:
        parser.error(f"no PNG file is in both {args.photographs} and {args.rendered}")
    for name, folder in ("photographs", args.photographs), ("rendered", args.rendered):
        spread, white, dark, neighbours = numpy.median([statistics(folder / file) for file in shared], axis=0)
        print(f"{name:12} {len(shared)} frames: deviation {spread:.0f}, white {white:.1f}%, dark {dark:.0f}%, neighbours {neighbours:.1f}")


if __name__ == "__main__":
    main()
