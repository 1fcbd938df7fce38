#!/usr/bin/env python3
"""Makes the committed reference tensors of tests/golden out of the whole set.

    thin_goldens.py WHOLE OUT   WHOLE holds the files of tests/golden/README.md with all their tensors, 17 MB

Small files are copied. Of large tensors only some values are kept; the crate farsight-testing puts them back in place.
Needs NumPy and safetensors.
"""

import argparse
import shutil
from pathlib import Path

import numpy
from safetensors import safe_open
from safetensors.numpy import save_file

COPIED = [
    "codec200", "deform_k1s1p0", "deform_k3s1p1", "deform_k3s1p1dg2", "deform_k3s1p2d2", "deform_k3s2p1",
    "disentangled", "focal", "layers", "msfe_a", "net_tiny_weights", "warp",
]
# A tensor with more values than this keeps a sample of them.
MAP_LIMIT, GRADIENT_LIMIT = 8192, 1024
SAMPLE = 256
UNKNOWN = numpy.nan


def read(path):
    with safe_open(path, "np") as file:
        return {name: file.get_tensor(name) for name in sorted(file.keys())}, file.metadata() or {}


class Thinned:
    """The tensors of one file, to be thinned one by one."""

    def __init__(self, tensors, metadata):
        self.tensors, self.metadata = tensors, metadata

    def keep(self, name, places, elsewhere):
        """Keeps the values at `places` (flat indices); `elsewhere` is what a reader puts in all other places."""
        tensor = self.tensors.pop(name)
        self.tensors[f"{name}@values"] = tensor.reshape(-1)[places]
        self.tensors[f"{name}@places"] = numpy.asarray(places, numpy.int32)
        self.tensors[f"{name}@shape"] = numpy.asarray(tensor.shape, numpy.int32)
        self.tensors[f"{name}@elsewhere"] = numpy.asarray(elsewhere, numpy.float32)

    def sample(self, limit, names):
        """Keeps a sample of each named tensor with more than `limit` values; the other values are unknown."""
        random = numpy.random.default_rng(0)
        for name in names:
            size = self.tensors[name].size
            if size > limit:
                self.keep(name, numpy.sort(random.choice(size, SAMPLE, replace=False)), UNKNOWN)

    def write(self, path):
        # One entry, because the order of several is random: equal tensors give equal bytes.
        about = "; ".join(f"{name}: {value}" for name, value in sorted(self.metadata.items()))
        save_file(dict(sorted(self.tensors.items())), path, {"about": about} if about else None)
        path.chmod(0o644)


def heatmaps(thinned):
    for name in [name for name in thinned.tensors if name.endswith(".heatmap")]:
        thinned.keep(name, numpy.flatnonzero(thinned.tensors[name]), 0)


def topk_decode(thinned):
    """The regression map is read at the peaks only."""
    cells = thinned.tensors["reg"][0].size
    at = thinned.tensors["k100.y"] * thinned.tensors["reg"].shape[2] + thinned.tensors["k100.x"]
    channels = numpy.arange(thinned.tensors["reg"].shape[0])
    thinned.keep("reg", numpy.unique(channels[:, None] * cells + at[None, :]), UNKNOWN)


def net_tiny_io(thinned):
    thinned.sample(MAP_LIMIT, [name for name in thinned.tensors if name != "input"])


def net_tiny_grad(thinned):
    # The same input as in net_tiny_io_gn.
    del thinned.tensors["input"]
    thinned.sample(GRADIENT_LIMIT, [name for name in thinned.tensors if name.startswith("grad.")])


THINNED = {
    "heatmaps": heatmaps,
    "net_tiny_grad_gn": net_tiny_grad,
    "net_tiny_io_bn": net_tiny_io,
    "net_tiny_io_gn": net_tiny_io,
    "topk_decode": topk_decode,
}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("whole", type=Path)
    parser.add_argument("out", type=Path)
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    for name in COPIED:
        shutil.copyfile(arguments.whole / f"{name}.safetensors", arguments.out / f"{name}.safetensors")
    for name, thin in THINNED.items():
        thinned = Thinned(*read(arguments.whole / f"{name}.safetensors"))
        thin(thinned)
        thinned.write(arguments.out / f"{name}.safetensors")


if __name__ == "__main__":
    main()
