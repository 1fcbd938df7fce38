#!/usr/bin/env python3
"""Copies of real frames that should change nothing: mirrored, without the first columns, brighter.

    python3 scripts/disturb_frames.py --kitti KITTI --out DISTURBED
    farsight eval --data DISTURBED/mirrored --split configs/splits/real20.txt --classic

A few dozen photographs say little about errors of a few centimetres: how far the figures of the copies lie apart shows how little. KITTI is a folder in KITTI's
layout; the frames of configs/splits are copied, with labels and calibrations to match (P2 alone is changed). Needs Pillow.
"""
import argparse
import math
import pathlib

from PIL import Image, ImageEnhance, ImageOps

SPLITS = pathlib.Path(__file__).resolve().parents[1] / "configs/splits"
CUT_COLUMNS = 11
BRIGHTER = 1.15


class Same:
    """A copy in which nothing has moved."""

    def image(self, image):
        return image

    def projection(self, rows, _width):
        return rows

    def label(self, words, _width):
        return words


class Mirrored(Same):
    def image(self, image):
        return ImageOps.mirror(image)

    def projection(self, rows, width):
        # u becomes width - 1 - u, and x becomes -x.
        first = [(width - 1) * low - high for low, high in zip(rows[2], rows[0])]
        return [[-row[0], *row[1:]] for row in (first, rows[1], rows[2])]

    def label(self, words, width):
        left, right = (width - 1 - float(words[k]) for k in (6, 4))
        words = [*words[:4], f"{left:.2f}", words[5], f"{right:.2f}", *words[7:]]
        if words[0] != "DontCare":
            words[11] = f"{-float(words[11]):.2f}"
            for k in (3, 14):
                words[k] = f"{math.remainder(math.pi - float(words[k]), 2 * math.pi):.2f}"
        return words


class Cut(Same):
    def image(self, image):
        return image.crop((CUT_COLUMNS, 0, *image.size))

    def projection(self, rows, _width):
        first = [high - CUT_COLUMNS * low for low, high in zip(rows[2], rows[0])]
        return [first, rows[1], rows[2]]

    def label(self, words, _width):
        left, right = (max(float(words[k]) - CUT_COLUMNS, 0.0) for k in (4, 6))
        return [*words[:4], f"{left:.2f}", words[5], f"{right:.2f}", *words[7:]]


class Brighter(Same):
    def image(self, image):
        return ImageEnhance.Brightness(image).enhance(BRIGHTER)


def disturb_calibration(text, change, width):
    lines = []
    for line in text.splitlines():
        if line.startswith("P2:"):
            numbers = [float(word) for word in line.split()[1:]]
            rows = change.projection([numbers[k:k + 4] for k in (0, 4, 8)], width)
            line = "P2: " + " ".join(f"{value:.12e}" for row in rows for value in row)
        lines.append(line + "\n")
    return "".join(lines)


def disturb_frame(kitti, out, frame, change):
    with Image.open(kitti / f"training/image_2/{frame}.png") as file:
        image = file.convert("RGB")
    change.image(image).save(out / f"training/image_2/{frame}.png")
    calibration = (kitti / f"training/calib/{frame}.txt").read_text()
    (out / f"training/calib/{frame}.txt").write_text(disturb_calibration(calibration, change, image.width))
    labels = (kitti / f"training/label_2/{frame}.txt").read_text().splitlines()
    lines = [" ".join(change.label(line.split(), image.width)) + "\n" for line in labels]
    (out / f"training/label_2/{frame}.txt").write_text("".join(lines))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kitti", type=pathlib.Path, required=True)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    args = parser.parse_args()
    for name, change in {"mirrored": Mirrored(), "cut": Cut(), "brighter": Brighter()}.items():
        out = args.out / name
        for folder in ("training/image_2", "training/calib", "training/label_2"):
            (out / folder).mkdir(parents=True, exist_ok=True)
        for split in sorted(SPLITS.glob("*.txt")):
            for frame in split.read_text().split():
                disturb_frame(args.kitti, out, frame, change)
        print(out)


if __name__ == "__main__":
    main()
