#!/usr/bin/env python3
"""Computes the reference tensors of MSFE designs B and C in double precision, with PyTorch's functions and gradients.

    make_msfe_goldens.py OUT   writes msfe_b.safetensors and msfe_c.safetensors

Written from the definition of the designs (MSFE/DGH spec section 3), not from Farsight's code. Only the names of the
parameters are Farsight's. C3, C4, C5 are the maps at strides 8, 16, 32, F is the neck's map at stride 4, D the width of
the fusion.

lateral   lat_i = ReLU(GN(conv1x1(C_i -> D))), no bias
GN        group norm, 32 groups, or 16 where 32 does not divide the channels; epsilon 1e-5
SE(x)     sigmoid(W2 ReLU(W1 mean(x) + b1) + b2) x, W1 to an eighth of the channels
up        bilinear, align_corners = false
B         x = SE(concat(lat_3, up2(lat_4), up4(lat_5))); 1x1 to D, then two 3x3, each with GN and ReLU;
          F + up2(GN(conv1x1(D -> F's channels)))
C         P_i = SE(lat_i); td4 = f(P4, up2(P5)); out3 = f(P3, up2(td4)); out4 = f(P4, td4, down(out3));
          out5 = f(P5, down(out4)); C_i + GN(conv1x1(out_i -> C_i)); down is a max-pool of 2;
          f(x, ...) = ReLU(GN(conv1x1(depthwise3x3(sum of w_k x_k)))), w_k = ReLU(v_k) / (sum of ReLU(v) + 1e-4)

In a fresh network the last norm's scale is zero, so that the design is the identity. Here it is random, as all else.
Inputs and weights are rounded to single precision before use, so what is stored is exact. Results are rounded when they
are stored. Needs PyTorch 2.11, NumPy and safetensors; on the CPU.
"""

import argparse
from pathlib import Path

import torch
import torch.nn.functional as F

from thin_goldens import GRADIENT_LIMIT, Thinned

BATCH = 2
# Channels, height and width of C3, C4, C5 and F.
C3, C4, C5, NECK = (16, 8, 4), (32, 4, 2), (48, 2, 1), (16, 16, 8)


class Parameters:
    """Draws each parameter when it is first asked for, and keeps it."""

    def __init__(self, seed):
        self.random = torch.Generator().manual_seed(seed)
        self.tensors = {}

    def draw(self, shape, low, high):
        values = torch.rand(shape, generator=self.random, dtype=torch.float64) * (high - low) + low
        return values.to(torch.float32).to(torch.float64).requires_grad_()

    def get(self, name, shape, low, high):
        if name not in self.tensors:
            self.tensors[name] = self.draw(shape, low, high)
        return self.tensors[name]

    def conv(self, x, name, channels, kernel=1, bias=False, depthwise=False):
        inputs = 1 if depthwise else x.shape[1]
        reach = (3 / (inputs * kernel * kernel)) ** 0.5
        weight = self.get(f"{name}.weight", (channels, inputs, kernel, kernel), -reach, reach)
        offset = self.get(f"{name}.bias", (channels,), -0.5, 0.5) if bias else None
        return F.conv2d(x, weight, offset, padding=kernel // 2, groups=channels if depthwise else 1)

    def norm(self, x, name):
        channels = x.shape[1]
        weight = self.get(f"{name}.weight", (channels,), 0.5, 1.5)
        bias = self.get(f"{name}.bias", (channels,), -0.3, 0.3)
        return F.group_norm(x, 32 if channels % 32 == 0 else 16, weight, bias, eps=1e-5)

    def conv_norm_relu(self, x, conv, norm, channels, kernel=1):
        return F.relu(self.norm(self.conv(x, conv, channels, kernel), norm))

    def attention(self, x, name):
        channels = x.shape[1]
        hidden = F.relu(self.conv(x.mean((2, 3), keepdim=True), f"{name}.down", channels // 8, bias=True))
        return torch.sigmoid(self.conv(hidden, f"{name}.up", channels, bias=True)) * x

    def lateral(self, x, level, width):
        return self.conv_norm_relu(x, f"p{level}.lat", f"p{level}.lat_norm", width)

    def fusion(self, maps, name):
        raw = self.get(f"{name}.fusion_weight", (len(maps),), 0.2, 1.5)
        weights = F.relu(raw) / (F.relu(raw).sum() + 1e-4)
        total = sum(weight * x for weight, x in zip(weights, maps))
        deep = self.conv(total, f"{name}.dw", total.shape[1], kernel=3, depthwise=True)
        return self.conv_norm_relu(deep, f"{name}.pw", f"{name}.norm", total.shape[1])


def up(x, factor=2):
    return F.interpolate(x, scale_factor=factor, mode="bilinear", align_corners=False)


def design_b(p, c3, c4, c5, f, width=32):
    x = torch.cat([p.lateral(c3, 3, width), up(p.lateral(c4, 4, width)), up(p.lateral(c5, 5, width), 4)], 1)
    x = p.attention(x, "se")
    for name, kernel in (("reduce", 1), ("fuse1", 3), ("fuse2", 3)):
        x = p.conv_norm_relu(x, name, f"{name}_norm", width, kernel)
    return {"out": f + up(p.norm(p.conv(x, "back", f.shape[1]), "back_norm"))}


def design_c(p, c3, c4, c5, width=48):
    # A weight below zero counts as zero.
    p.tensors["out4.fusion_weight"] = torch.tensor([0.75, -0.25, 1.25], dtype=torch.float64, requires_grad=True)
    p3, p4, p5 = (p.attention(p.lateral(c, i, width), f"p{i}.se") for i, c in ((3, c3), (4, c4), (5, c5)))
    td4 = p.fusion([p4, up(p5)], "td4")
    out3 = p.fusion([p3, up(td4)], "out3")
    out4 = p.fusion([p4, td4, F.max_pool2d(out3, 2)], "out4")
    out5 = p.fusion([p5, F.max_pool2d(out4, 2)], "out5")
    fused = {3: (c3, out3), 4: (c4, out4), 5: (c5, out5)}
    back = {i: p.norm(p.conv(x, f"p{i}.back", c.shape[1]), f"p{i}.back_norm") for i, (c, x) in fused.items()}
    return {f"out{i}": c + back[i] for i, (c, _) in fused.items()}


def golden(design, inputs, seed):
    """Inputs, parameters, outputs, and the gradients of sum(out * grad_out)."""
    p = Parameters(seed)
    inputs = {name: p.draw((BATCH, *shape), -2, 2) for name, shape in inputs.items()}
    outputs = design(p, *inputs.values())
    weights = {f"grad_{name}": p.draw(output.shape, -1, 1).detach() for name, output in outputs.items()}
    sum((output * weights[f"grad_{name}"]).sum() for name, output in outputs.items()).backward()
    tensors = inputs | p.tensors | outputs | weights
    tensors |= {f"d_{name}": tensor.grad for name, tensor in inputs.items()}
    tensors |= {f"grad.{name}": tensor.grad for name, tensor in p.tensors.items()}
    return {name: tensor.detach().to(torch.float32).numpy() for name, tensor in tensors.items()}


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    out = parser.parse_args().out
    torch.set_num_threads(1)
    pyramid = {"c3": C3, "c4": C4, "c5": C5}
    for name, design, inputs in (("msfe_b", design_b, pyramid | {"f": NECK}), ("msfe_c", design_c, pyramid)):
        thinned = Thinned(golden(design, inputs, 31), {"design": name[-1].upper()})
        thinned.sample(GRADIENT_LIMIT, [name for name in thinned.tensors if name.startswith("grad.")])
        thinned.write(out / f"{name}.safetensors")


if __name__ == "__main__":
    main()
