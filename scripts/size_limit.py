#!/usr/bin/env python3
"""What a detector could reach that sees everything except how large a car is.

A single image shows a car's shape and direction, not its size: a car 5% larger and 5% farther away is the same picture. This writes detections
that are perfect but for that: each labelled car, larger and farther by the factor between its real height and the height that can be guessed.

    python3 scripts/size_limit.py --labels KITTI/training/label_2 --split KITTI/ImageSets/val.txt --know shape --out LIMIT
    farsight eval --labels KITTI/training/label_2 --split KITTI/ImageSets/val.txt --results LIMIT

What is known (`--know`): `nothing` (the mean height of all cars), `shape` (height over width and over length: the best linear guess of the logarithm of the
height, found on the same labels), `ground` (shape, and the plane through the true feet of all other cars of the frame, weighted by how well each tells).
With `--cue 0.04` also something of known size on every car, a number plate or a wheel, from which the size can be read with a relative error of 4% (normally
distributed, independent of everything else, seed 0). Nearer cars get higher scores; the 17th column is how far off the distances are, so that `--scores place`
can rank by it. Needs numpy.
"""
import argparse
import math
import pathlib

import numpy

# Columns of a KITTI label.
BOX = slice(4, 8)
NUMBERS = slice(8, 15)

# So many other cars have to tell where the ground is.
FEET = 4


def cars_of(file):
    """Rows of the cars in a label file, and their height, width, length, x, y, z and rotation."""
    rows = [line.split() for line in file.read_text().splitlines()]
    rows = [row for row in rows if row[0] == "Car"]
    return rows, numpy.array([row[NUMBERS] for row in rows], dtype=float).reshape(-1, 7)


def guess_of_heights(cars, know):
    """A function from cars to the logarithm of the height that is guessed of them."""
    log = numpy.log(cars[:, :3])
    if know == "nothing":
        mean = log[:, 0].mean()
        return lambda cars: numpy.full(len(cars), mean)
    weights = numpy.linalg.lstsq(ratios(cars), log[:, 0], rcond=None)[0]
    return lambda cars: ratios(cars) @ weights


def ratios(cars):
    height, width, length = numpy.log(cars[:, :3]).T
    return numpy.stack([numpy.ones(len(cars)), height - width, height - length], axis=1)


def from_ground(cars):
    """Logarithm of the factor from each car's depth to where its line of sight meets the plane through the feet of the others; not a number where
    fewer than `FEET` others stand in the frame."""
    _, _, _, x, y, z, _ = cars.T
    terms = numpy.stack([numpy.ones(len(cars)), x, z], axis=1)
    logs = numpy.full(len(cars), numpy.nan)
    for car in range(len(cars) if len(cars) > FEET else 0):
        others = numpy.arange(len(cars)) != car
        level, across, along = numpy.linalg.lstsq(terms[others], y[others], rcond=None)[0]
        meets = level / (y[car] - across * x[car] - along * z[car])
        logs[car] = numpy.log(meets) if meets > 0 else numpy.nan
    return logs


def spread(errors):
    """Standard deviation of the errors as the median tells it: some planes are far out."""
    return 1.48 * numpy.nanmedian(numpy.abs(errors))


def log_factors(by_size, by_ground, trust):
    """Logarithm of the factor from each car's depth to what is guessed of it: by its size, and by the ground where that is known."""
    if by_ground is None:
        return by_size
    return numpy.where(numpy.isnan(by_ground), by_size, (1 - trust) * by_size + trust * by_ground)


def add_cue(logs, off, cue):
    """Weighs the guesses, which are off by `off`, with a reading that is off by `cue`; returns how far off both together are."""
    draws = numpy.random.default_rng(0)
    share = off**2 / (off**2 + cue**2)
    for name in logs:
        logs[name] = (1 - share) * logs[name] + share * draws.normal(0.0, cue, len(logs[name]))
    return off * math.sqrt(1 - share)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--labels", type=pathlib.Path, required=True)
    parser.add_argument("--split", type=pathlib.Path, required=True)
    parser.add_argument("--know", choices=["nothing", "shape", "ground"], required=True)
    parser.add_argument("--cue", type=float, help="relative error of a size read off something of known size on the car, standard deviation")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    args = parser.parse_args()
    if args.cue is not None and not args.cue > 0:
        parser.error(f"--cue is {args.cue}; expected a positive number")
    names = args.split.read_text().split()
    missing = [name for name in names if not (args.labels / f"{name}.txt").is_file()]
    if missing:
        parser.error(f"{args.labels} has no {missing[0]}.txt, which {args.split} names")
    frames = {name: cars_of(args.labels / f"{name}.txt") for name in names}
    everything = numpy.concatenate([cars for _, cars in frames.values()])
    guess = guess_of_heights(everything, args.know)
    planes, trust = {}, 0.0
    if args.know == "ground":
        planes = {name: from_ground(cars) for name, (_, cars) in frames.items()}
        size_spread = spread(guess(everything) - numpy.log(everything[:, 0]))
        ground_spread = spread(numpy.concatenate(list(planes.values())))
        trust = size_spread**2 / (size_spread**2 + ground_spread**2)
    logs = {name: log_factors(guess(cars) - numpy.log(cars[:, 0]), planes.get(name), trust) for name, (_, cars) in frames.items()}
    off = spread(numpy.concatenate(list(logs.values())))
    if args.cue is not None:
        off = add_cue(logs, off, args.cue)
    args.out.mkdir(parents=True, exist_ok=True)
    errors = []
    for name, (rows, cars) in frames.items():
        factors = numpy.exp(logs[name])
        errors.extend(numpy.abs(factors - 1))
        lines = []
        for row, car, factor in zip(rows, cars, factors):
            numbers = " ".join(f"{value:.4f}" for value in [*(car[:6] * factor), car[6]])
            score = 1 / (1 + car[5] / 20)
            lines.append(f"Car -1 -1 {row[3]} {' '.join(row[BOX])} {numbers} {score:.4f} {off * car[5] * factor:.4f}\n")
        (args.out / f"{name}.txt").write_text("".join(lines))
    cue = "" if args.cue is None else f" and a cue of {args.cue:g}"
    print(f"{len(errors)} cars of {len(frames)} frames, knowing {args.know}{cue}: mean relative error of the distance {100 * numpy.mean(errors):.1f}%")


if __name__ == "__main__":
    main()
