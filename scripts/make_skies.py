"""Makes the skies of crates/farsight-synth/skies from the radiance maps of the npm package @pmndrs/assets.

    npm pack @pmndrs/assets@1.7.0 && tar -xzf pmndrs-assets-1.7.0.tgz
    python3 scripts/make_skies.py package/hdri crates/farsight-synth/skies

The maps are Poly Haven's, CC0. Of each the half above the horizon is kept, turned so that its brightest place lies on
the z axis, as a square that a sum of absolute values makes of the hemisphere (hemi-octahedral map): direction (x, up,
z) with |x| + up + |z| = 1 lies at columns x + z and rows x - z, both from -1 to 1 between the middles of the outer
pixels. A byte is 255 times the square root of a quarter of the radiance, whose median over the map's luminance is 1;
what is brighter than 4 is cut. Needs numpy, pillow and OpenEXR.
"""

import base64
import pathlib
import re
import sys
import tempfile

import numpy as np
import OpenEXR
from PIL import Image

NAMES = ["city", "dawn", "forest", "park", "sky", "sunrise", "sunset", "venice"]
SIDE = 256
LIMIT = 4.0
LUMINANCE = np.array([0.2126, 0.7152, 0.0722])


def radiance(path):
    """The map in a JavaScript file: rows from straight up to straight down, columns once around."""
    data = base64.b64decode(re.search(r"base64,([A-Za-z0-9+/=]+)", path.read_text()).group(1))
    with tempfile.NamedTemporaryFile(suffix=".exr") as file:
        file.write(data)
        file.flush()
        with OpenEXR.File(file.name) as exr:
            channels = exr.channels()
            if "RGB" in channels:
                pixels = channels["RGB"].pixels
            else:
                pixels = np.stack([channels[name].pixels for name in "RGB"], axis=-1)
    pixels = np.asarray(pixels, dtype=np.float64)
    # Suns that are too bright for their numbers are none; compression makes some of the dark negative.
    pixels[~np.isfinite(pixels)] = np.nanmax(pixels, initial=0, where=np.isfinite(pixels))
    return np.maximum(pixels, 0)


def sampled(pixels, around, elevation):
    """Bilinear, by angles; `around` from 0 to 1."""
    height, width = pixels.shape[:2]
    column = around * width - 0.5
    row = np.clip((0.5 - elevation / np.pi) * height - 0.5, 0, height - 1)
    x, y = np.floor(column).astype(int), np.minimum(np.floor(row).astype(int), height - 2)
    u, v = (column - x)[..., None], (row - y)[..., None]
    at = lambda dx, dy: pixels[y + dy, (x + dx) % width]
    return (1 - v) * ((1 - u) * at(0, 0) + u * at(1, 0)) + v * ((1 - u) * at(0, 1) + u * at(1, 1))


def sky(pixels):
    """The square, in linear numbers."""
    upper = pixels[: pixels.shape[0] // 2]
    light = np.minimum(upper @ LUMINANCE, np.percentile(upper @ LUMINANCE, 99.5)).sum(axis=0)
    sun = np.argmax(np.convolve(np.concatenate([light, light[:24]]), np.ones(25), "valid")) + 12.5
    # Four by four samples a pixel.
    fine = (np.arange(4 * SIDE) - 1.5) / 4 / (SIDE - 1) * 2 - 1
    u, v = np.meshgrid(np.clip(fine, -1, 1), np.clip(fine, -1, 1))
    x, z = (u + v) / 2, (u - v) / 2
    up = np.maximum(1 - np.abs(x) - np.abs(z), 0)
    elevation = np.arctan2(up, np.hypot(x, z))
    around = np.arctan2(x, z) / (2 * np.pi) + sun / pixels.shape[1]
    square = sampled(pixels, around, elevation).reshape(SIDE, 4, SIDE, 4, 3).mean(axis=(1, 3))
    return square / np.median(square @ LUMINANCE)


def main():
    maps, out = map(pathlib.Path, sys.argv[1:])
    for name in NAMES:
        square = sky(radiance(maps / f"{name}.exr.js"))
        coded = np.rint(255 * np.sqrt(np.clip(square / LIMIT, 0, 1))).astype(np.uint8)
        Image.fromarray(coded).save(out / f"{name}.png", optimize=True)


main()
