#!/usr/bin/env python3
"""Writes the checkpoints that the import tests read.

    make_checkpoint_fixtures.py                    the committed fixtures, a few tens of kB each
    make_checkpoint_fixtures.py --golden DIR OUT   the golden networks of DIR (net_tiny, net_full) as checkpoints in OUT, 400 MB

Needs PyTorch (2.x) and NumPy, and spec/statedict_map.csv, which is the only source of names here: the rules under test are
not used. The committed network is SMOKE on a DLA-34 with 16 channels in every level and in the heads. Its numbers are views of one
small block, so that the files stay small; `pool_value` and `pool_offset` have their twins in tests/checkpoint_fixtures.rs.
"""

import argparse
import collections
import csv
import datetime
import json
import struct
from pathlib import Path

import numpy
import torch

ROOT = Path(__file__).resolve().parent.parent
FIXTURES = ROOT / "crates/farsight-methods/tests/fixtures"
WIDTH = 16
POOL_LENGTH = 4400
# How many maps the root of a tree joins (spec section 2.3).
ROOT_INPUTS = {"level2": 2, "level3.tree1": 2, "level3.tree2": 4, "level4.tree1": 2, "level4.tree2": 4, "level5": 3}


class TrainingNote:
    """A class that no reader of checkpoints knows."""

    def __init__(self, text):
        self.text = text


def pool_value(k):
    """A number that half precision holds exactly."""
    return (k * 7919 % 2039 - 1019) / 4096


def pool_offset(index):
    """Where in the pool the tensor with this place in the sorted official names starts."""
    return index * 53 % 500


def narrow_shape(name, shape):
    """The shape in the narrow network of a tensor that has `shape` in the full one."""
    if name.endswith("root.conv.weight"):
        tree = name.removeprefix("backbone.body.base.").removesuffix(".root.conv.weight")
        return (WIDTH, ROOT_INPUTS[tree] * WIDTH, 1, 1)
    # 1 (depthwise), 3 (input, classes), 8 (regressions) and 27 (offsets and masks) are no widths; kernels are the last
    # two.
    widths = [size if size in (1, 3, 8, 27) else WIDTH for size in shape[:2]]
    return (*widths, *shape[2:])


def read_table(spec):
    with open(spec / "statedict_map.csv", newline="") as file:
        return list(csv.DictReader(file))


def narrow_network(table):
    """Official names to tensors that share one block of halves, except some with a block and a format of their own."""
    pool = torch.tensor([pool_value(k) for k in range(POOL_LENGTH)], dtype=torch.float16)
    shapes = {row["official_smoke"]: [int(size) for size in row["shape"].split("x")] for row in table}
    network = {}
    for index, name in enumerate(sorted(shapes)):
        shape = narrow_shape(name, shapes[name])
        count = int(numpy.prod(shape))
        tensor = pool[pool_offset(index) :][:count].view(shape)
        if name.startswith("heads.") and name.endswith("bias"):
            tensor = tensor.double()
        elif ".ida_up." in name and ".norm." in name:
            tensor = torch.nn.Parameter(tensor.float())
        elif name.endswith("ida_0.proj_1.deform_conv.weight"):
            # Not contiguous, in memory or in the file.
            tensor = tensor.permute(1, 0, 2, 3).contiguous().permute(1, 0, 2, 3)
        network[name] = tensor
    return network


def as_mmdet3d(table, network):
    names = {row["official_smoke"]: row["mmdet3d"] for row in table}
    last = "heads.predictor.class_head.3."
    # Pedestrian, Cyclist, Car instead of Car, Cyclist, Pedestrian.
    return {names[name]: tensor.flip(0) if name.startswith(last) else tensor for name, tensor in network.items()}


def state_dict(tensors):
    """As a module's state_dict() returns it, with its private attribute."""
    state = collections.OrderedDict(tensors)
    state._metadata = collections.OrderedDict([("", {"version": 1})])
    return state


def adam():
    """An optimiser's state with tensors of its own."""
    parameter = torch.nn.Parameter(torch.ones(3))
    optimizer = torch.optim.Adam([parameter], lr=2.5e-4)
    parameter.sum().backward()
    optimizer.step()
    return optimizer.state_dict()


def official(tensors):
    return {
        "model": state_dict(tensors),
        "optimizer": adam(),
        "scheduler": {"milestones": collections.Counter([10000, 18000]), "gamma": 0.1, "last_epoch": 25000},
        "random": torch.get_rng_state()[:16].clone(),
        "iteration": 25000,
    }


def mmdet3d(tensors):
    meta = {
        "CLASSES": ("Pedestrian", "Cyclist", "Car"),
        "epoch": 72,
        "huge": 1 << 80,
        "negative": -70000,
        "time": datetime.datetime(2021, 10, 27, 10, 23, 3),
        "loss": numpy.float64(0.5),
        "losses": numpy.arange(3.0),
        "seen": {"Car", "Cyclist"},
        "frozen": frozenset([1]),
        "raw": b"bytes",
        "device": torch.device("cpu"),
        "size": torch.Size([384, 1280]),
        "note": TrainingNote("by another program"),
        "defaults": collections.defaultdict(list, bias=[0.0]),
    }
    return {"meta": meta, "state_dict": state_dict(tensors), "optimizer": adam()}


def imagenet(table):
    """A corner of DLA-34 as ImageNet checkpoints have it: two channels, batch norms with statistics, a classifier."""
    kept = ("base_layer.", "level0.", "level2.tree1.", "level2.root.", "level2.project.")
    state, norms = collections.OrderedDict(), collections.OrderedDict()
    for row in table:
        name = row["imagenet_dla34"]
        if name.startswith(kept):
            shape = [min(int(size), 2) for size in row["shape"].split("x")]
            state[name] = torch.full(shape, pool_value(len(state)))
            if len(shape) == 1:
                norms[name.rsplit(".", 1)[0]] = None
    for norm in norms:
        state[f"{norm}.running_mean"] = torch.zeros(2)
        state[f"{norm}.running_var"] = torch.ones(2)
        state[f"{norm}.num_batches_tracked"] = torch.tensor(7)
    state["fc.weight"], state["fc.bias"] = torch.zeros(3, 2, 1, 1), torch.zeros(3)
    return state


def save(content, path, legacy, protocol=2):
    torch.save(content, path, _use_new_zipfile_serialization=not legacy, pickle_protocol=protocol)
    print(f"{path.stat().st_size:>10} {path}")


def write_committed(table):
    FIXTURES.mkdir(parents=True, exist_ok=True)
    network = narrow_network(table)
    tracked = {"backbone.body.base.level0.1.num_batches_tracked": torch.tensor(3)}
    parallel = {f"module.{name}": tensor for name, tensor in network.items()}
    theirs = as_mmdet3d(table, network)
    save(official(network | tracked), FIXTURES / "official_zip.pth", legacy=False)
    save(official(parallel), FIXTURES / "official_legacy.pth", legacy=True)
    save(mmdet3d(theirs), FIXTURES / "mmdet3d_zip.pth", legacy=False, protocol=4)
    save(mmdet3d(theirs), FIXTURES / "mmdet3d_legacy.pth", legacy=True)
    save(imagenet(table), FIXTURES / "imagenet_legacy.pth", legacy=True)
    save(imagenet(table), FIXTURES / "imagenet_zip.pth", legacy=False)
    print(sum(tensor.numel() for tensor in network.values()), "parameters")


def read_safetensors(path):
    """Name to tensor, without needing the safetensors package."""
    content = path.read_bytes()
    (length,) = struct.unpack("<Q", content[:8])
    header = json.loads(content[8 : 8 + length])
    header.pop("__metadata__", None)
    data = bytearray(content[8 + length :])
    def tensor(entry):
        assert entry["dtype"] == "F32", path
        start, end = entry["data_offsets"]
        return torch.frombuffer(data[start:end], dtype=torch.float32).view(entry["shape"])
    return {name: tensor(entry) for name, entry in header.items()}


def write_golden(table, golden, out):
    out.mkdir(parents=True, exist_ok=True)
    parameters = {row["official_smoke"] for row in table}
    for size in ("tiny", "full"):
        weights = read_safetensors(golden / f"net_{size}_weights.safetensors")
        network = {name: tensor for name, tensor in weights.items() if name in parameters}
        for legacy in (False, True):
            layout = "legacy" if legacy else "zip"
            save(official(network), out / f"net_{size}_official_{layout}.pth", legacy)
            save(mmdet3d(as_mmdet3d(table, network)), out / f"net_{size}_mmdet3d_{layout}.pth", legacy)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--spec", type=Path, default=ROOT.parent / "shared/spec", help="folder of statedict_map.csv")
    parser.add_argument("--golden", type=Path, nargs=2, metavar=("DIR", "OUT"))
    arguments = parser.parse_args()
    torch.manual_seed(0)
    table = read_table(arguments.spec)
    if arguments.golden:
        write_golden(table, *arguments.golden)
    else:
        write_committed(table)


if __name__ == "__main__":
    main()
