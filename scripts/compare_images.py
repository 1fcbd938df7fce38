#!/usr/bin/env python3
"""How photographs and their rendered twins differ as images, and the cars in them: medians over the frames that both folders have.

    python3 scripts/compare_images.py --photographs KITTI/training/image_2 --rendered TWINS/training/image_2 --labels KITTI/training/label_2

Needs numpy and Pillow.
"""
import argparse
import pathlib

import numpy
from PIL import Image

# Grey values from which a pixel counts as white, and below which as dark.
WHITE = 250
DARK = 40

# Cars in plain view are compared from this height of the 2D box on, pixels; where in the box the windows are and where the body is, from the top.
LEAST_CAR = 40
WINDOWS = 0.13, 0.33
BODY = 0.45, 0.65


def grey_values(file):
    with Image.open(file) as image:
        return numpy.asarray(image.convert("L"), dtype=float)


def statistics(grey):
    """Standard deviation of the grey values, percent of white and of dark pixels, mean difference between neighbours in a row."""
    return grey.std(), 100 * (grey >= WHITE).mean(), 100 * (grey < DARK).mean(), numpy.abs(numpy.diff(grey, axis=1)).mean()


def part(grey, box, rows, margin):
    """Pixels of a box between two shares of its height from the top, without a share of its width at both sides."""
    left, top, right, bottom = box
    inset = margin * (right - left)
    first, last = (int(top + share * (bottom - top)) for share in rows)
    return grey[first : last + 1, int(left + inset) : int(right - inset) + 1]


def cars(grey, label_file):
    """Of each car in plain view: mean and deviation of its windows, the same of its body, percent of dark pixels from windows to body."""
    for row in (line.split() for line in label_file.read_text().splitlines()):
        box = [float(value) for value in row[4:8]]
        in_view = row[0] == "Car" and row[2] == "0" and float(row[1]) < 0.05
        if not in_view or box[3] - box[1] < LEAST_CAR:
            continue
        windows, body = part(grey, box, WINDOWS, 0.3), part(grey, box, BODY, 0.3)
        both = part(grey, box, (WINDOWS[0], BODY[1]), 0.15)
        yield windows.mean(), windows.std(), body.mean(), body.std(), 100 * (both < DARK).mean()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--photographs", type=pathlib.Path, required=True)
    parser.add_argument("--rendered", type=pathlib.Path, required=True)
    parser.add_argument("--labels", type=pathlib.Path, required=True)
    args = parser.parse_args()
    shared = sorted({file.name for file in args.photographs.glob("*.png")} & {file.name for file in args.rendered.glob("*.png")})
    if not shared:
        parser.error(f"no PNG file is in both {args.photographs} and {args.rendered}")
    for name, folder in ("photographs", args.photographs), ("rendered", args.rendered):
        images, found = [], []
        for file in shared:
            grey = grey_values(folder / file)
            images.append(statistics(grey))
            found.extend(cars(grey, (args.labels / file).with_suffix(".txt")))
        spread, white, dark, neighbours = numpy.median(images, axis=0)
        print(f"{name:12} {len(shared)} frames: deviation {spread:.0f}, white {white:.1f}%, dark {dark:.0f}%, neighbours {neighbours:.1f}")
        windows, glass_spread, body, body_spread, dark = numpy.median(found, axis=0) if found else [numpy.nan] * 5
        print(
            f"{'':12} {len(found)} cars: windows {windows:.0f}, deviation within them {glass_spread:.0f}; "
            f"body {body:.0f}, within it {body_spread:.0f}; dark {dark:.0f}%"
        )


if __name__ == "__main__":
    main()
