#!/usr/bin/env python3
"""Seconds of one training step: Farsight against PyTorch 2.11, interleaved, medians.

    cargo xtask exec cargo build --release -p farsight-methods --features train --example step_speed
    cargo xtask exec python3 scripts/compare_training_step.py --farsight target/release/examples/step_speed \
        --table docs/results/training-step.json

python3 must have PyTorch 2.11. It is eager and in single precision; with --best it is compiled (torch.compile, for
which it needs g++ and Python's headers), with channels last and autocast to bfloat16, and Farsight in bf16, too.

The PyTorch half is the same network (DLA-34, neck, heads), the same batch, focal and corner loss and torch.optim.Adam. Its
deformable convolution is the same nine bilinear taps; --torchvision uses torchvision.ops.deform_conv2d instead. --table
puts a row into a table that documents quote (measured_table.py).
"""

import argparse
import math
import statistics
import subprocess
import tempfile
import time

import torch
import torch.nn.functional as F
from torch import nn

from measured_table import MeasuredTable

COLUMNS = ["network", "input", "images", "PyTorch, s", "Farsight, s", "Farsight / PyTorch"]

TORCHVISION = False


def group_norm(channels):
    return nn.GroupNorm(32 if channels % 32 == 0 else 16, channels)


def norm(channels, kind):
    return group_norm(channels) if kind == "group" else nn.BatchNorm2d(channels)


def conv(a, b, k=3, s=1):
    return nn.Conv2d(a, b, k, s, k // 2, bias=False)


class Block(nn.Module):
    def __init__(self, a, b, stride, kind):
        super().__init__()
        self.conv1, self.norm1 = conv(a, b, 3, stride), norm(b, kind)
        self.conv2, self.norm2 = conv(b, b), norm(b, kind)

    def forward(self, x, skip):
        y = F.relu(self.norm1(self.conv1(x)), inplace=True)
        return F.relu(self.norm2(self.conv2(y)) + skip, inplace=True)


class Tree(nn.Module):
    def __init__(self, a, b, stride, extra, kind):
        super().__init__()
        self.stride = stride
        self.project = nn.Sequential(conv(a, b, 1), norm(b, kind)) if a != b else None
        self.tree1, self.tree2 = Block(a, b, stride, kind), Block(b, b, 1, kind)
        self.root = nn.Sequential(conv(2 * b + extra, b, 1), norm(b, kind), nn.ReLU(inplace=True))

    def forward(self, x, extra=()):
        low = F.max_pool2d(x, self.stride) if self.stride > 1 else x
        skip = self.project(low) if self.project else low
        first = self.tree1(x, skip)
        second = self.tree2(first, first)
        return self.root(torch.cat([second, first, *extra], 1))


class Base(nn.Module):
    def __init__(self, c, kind):
        super().__init__()
        stem = lambda a, b, k, s: nn.Sequential(conv(a, b, k, s), norm(b, kind), nn.ReLU(inplace=True))
        self.stem = nn.Sequential(stem(3, c[0], 7, 1), stem(c[0], c[0], 3, 1), stem(c[0], c[1], 3, 2))
        self.level2 = Tree(c[1], c[2], 2, 0, kind)
        self.level3 = nn.ModuleList([Tree(c[2], c[3], 2, 0, kind), Tree(c[3], c[3], 1, c[2] + c[3], kind)])
        self.level4 = nn.ModuleList([Tree(c[3], c[4], 2, 0, kind), Tree(c[4], c[4], 1, c[3] + c[4], kind)])
        self.level5 = Tree(c[4], c[5], 2, c[4], kind)

    def forward(self, x):
        levels = [self.level2(self.stem(x))]
        for level in (self.level3, self.level4):
            low = F.max_pool2d(levels[-1], 2)
            first = level[0](levels[-1])
            levels.append(level[1](first, (low, first)))
        levels.append(self.level5(levels[-1], (F.max_pool2d(levels[-1], 2),)))
        return levels


class Deform(nn.Module):
    def __init__(self, a, b):
        super().__init__()
        self.offset = nn.Conv2d(a, 27, 3, padding=1)
        nn.init.zeros_(self.offset.weight)
        nn.init.zeros_(self.offset.bias)
        self.weight = nn.Parameter(torch.empty(b, a, 3, 3).uniform_(-1 / math.sqrt(9 * a), 1 / math.sqrt(9 * a)))
        self.bias = nn.Parameter(torch.zeros(b))

    def forward(self, x):
        out = self.offset(x)
        offset, mask = out[:, :18], out[:, 18:].sigmoid()
        if TORCHVISION:
            from torchvision.ops import deform_conv2d

            return deform_conv2d(x, offset, self.weight, self.bias, padding=1, mask=mask)
        n, c, h, w = x.shape
        offset = offset.view(n, 9, 2, h, w)
        tap = torch.arange(9.0)
        rows = (tap // 3).view(-1, 1, 1) + (torch.arange(float(h)) - 1).view(1, -1, 1)
        columns = (tap % 3).view(-1, 1, 1) + (torch.arange(float(w)) - 1).view(1, 1, -1)
        y = (offset[:, :, 0] + rows) * (2 / h) + (1 / h - 1)
        xs = (offset[:, :, 1] + columns) * (2 / w) + (1 / w - 1)
        grid = torch.stack([xs, y], -1).view(n, 9 * h, w, 2)
        samples = F.grid_sample(x, grid, align_corners=False).view(n, c, 9, h, w) * mask.view(n, 1, 9, h, w)
        return F.conv2d(samples.reshape(n, c * 9, h, w), self.weight.reshape(self.weight.shape[0], -1, 1, 1), self.bias)


class Merge(nn.Module):
    def __init__(self, deep, out, factor, kind, neck):
        super().__init__()
        unit = lambda a: nn.Sequential(Deform(a, out) if neck == "deformable" else conv(a, out), norm(out, kind), nn.ReLU(inplace=True))
        self.proj, self.node = unit(deep), unit(out)
        self.up = nn.ConvTranspose2d(out, out, 2 * factor, factor, factor // 2, groups=out, bias=False)

    def forward(self, deep, shallow):
        return self.node(self.up(self.proj(deep)) + shallow)


class Smoke(nn.Module):
    def __init__(self, c, head, kind, neck):
        super().__init__()
        self.base = Base(c, kind)
        shapes = [(5, 4, 2), (4, 3, 2), (4, 3, 2), (3, 2, 2), (3, 2, 2), (3, 2, 2), (3, 2, 2), (4, 2, 4)]
        self.merges = nn.ModuleList([Merge(c[a], c[b], f, kind, neck) for a, b, f in shapes])
        self.heads = nn.ModuleList(
            [nn.Sequential(nn.Conv2d(c[2], head, 3, padding=1), norm(head, kind), nn.ReLU(inplace=True), nn.Conv2d(head, n, 1)) for n in (3, 8)]
        )

    def forward(self, x):
        l2, l3, l4, l5 = self.base(x)
        m = self.merges
        d16 = m[0](l5, l4)
        a8 = m[1](l4, l3)
        d8 = m[2](d16, a8)
        b4 = m[3](l3, l2)
        c4 = m[4](a8, b4)
        d4 = m[5](d8, c4)
        f = m[7](d16, m[6](d8, d4))
        return self.heads[0](f), self.heads[1](f)


def corners(lhw, location, yaw):
    signs = torch.tensor([[-1, 1, -1], [1, 1, -1], [1, 0, -1], [1, 0, 1], [1, 1, 1], [-1, 1, 1], [-1, 0, 1], [-1, 0, -1]])
    a, up, b = lhw[:, :1] * signs[:, 0] / 2, lhw[:, 1:2] * signs[:, 1], lhw[:, 2:] * signs[:, 2] / 2
    sin, cos = yaw.sin()[:, None], yaw.cos()[:, None]
    return torch.stack([cos * a + sin * b + location[:, :1], location[:, 1:2] - up, cos * b - sin * a + location[:, 2:]], 1)


class Objective:
    """Focal loss and disentangled corner loss for five cars an image."""

    def __init__(self, batch, width, height):
        self.batch, self.w, self.h = batch, width // 4, height // 4
        n, cars = batch * 5, torch.arange(5.0).repeat(batch)
        self.cell_x, self.cell_y = width / 8 + cars, torch.full((n,), height / 8)
        image = torch.arange(batch).repeat_interleave(5)
        self.index = image * self.w * self.h + self.cell_y.long() * self.w + self.cell_x.long()
        self.heat = torch.zeros(batch, 3, self.h, self.w)
        self.heat[image, 0, self.cell_y.long(), self.cell_x.long()] = 1.0
        self.focal, self.cx, self.cy = 0.58 * width / 4, width / 8, height / 8
        self.location = torch.stack([cars, torch.full((n,), 1.6), torch.full((n,), 20.0)], 1)
        self.lhw, self.yaw = torch.tensor([[3.9, 1.5, 1.6]]).repeat(n, 1), torch.ones(n)
        self.reference = torch.tensor([3.88, 1.63, 1.53])
        self.truth = corners(self.lhw, self.location, self.yaw)

    def __call__(self, logits, raw):
        p = logits.sigmoid().clamp(1e-4, 1 - 1e-4)
        positive = self.heat.eq(1).float()
        terms = p.log() * (1 - p) ** 2 * positive + (1 - p).log() * p**2 * (1 - self.heat) ** 4
        focal = -terms.sum() / positive.sum().clamp(min=1)
        r = raw.permute(0, 2, 3, 1).reshape(-1, 8)[self.index]
        z = r[:, 0] * 16.32 + 28.01
        lhw = (r[:, 3:6].sigmoid() - 0.5).exp() * self.reference
        direction = F.normalize(r[:, 6:8])
        yaw = torch.atan2(direction[:, 0], direction[:, 1]) - math.pi / 2 + torch.atan2(self.location[:, 0], self.location[:, 2])
        x = (self.cell_x + r[:, 1] - self.cx) * z / self.focal
        y = (self.cell_y + r[:, 2] - self.cy) * z / self.focal + lhw[:, 1] / 2
        boxes = [corners(self.lhw, self.location, yaw), corners(lhw, self.location, self.yaw), corners(self.lhw, torch.stack([x, y, z], 1), self.yaw)]
        return focal + sum((box - self.truth).abs().sum() for box in boxes) / (37.5 * self.batch)


def smoke_config(neck, kind, width, size, precision):
    model = f'method = "smoke"\n[model]\ninput = {list(size)}\nwidth = {width}\nnorm = "{kind}"\nneck = "{neck}"\n'
    return model + f'[train]\nprecision = "{precision}"\n'


def main():
    global TORCHVISION
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--farsight", required=True, help="the built example step_speed")
    p.add_argument("--neck", choices=["deformable", "plain"], default="deformable")
    p.add_argument("--norm", choices=["group", "batch"], default="group")
    p.add_argument("--width", type=float, default=0.5)
    p.add_argument("--size", type=int, nargs=2, default=(640, 192))
    p.add_argument("--batch", type=int, default=2)
    p.add_argument("--rounds", type=int, default=15)
    p.add_argument("--threads", type=int, default=2)
    p.add_argument("--torchvision", action="store_true")
    p.add_argument("--best", action="store_true", help="PyTorch compiled, channels last, bfloat16; Farsight in bf16")
    p.add_argument("--table", help="put the medians into this table (JSON)")
    args = p.parse_args()
    TORCHVISION = args.torchvision
    torch.set_num_threads(args.threads)

    scaled = lambda c: max(1, round(c * args.width / 16)) * 16
    model = Smoke([scaled(c) for c in (16, 32, 64, 128, 256, 512)], scaled(256), args.norm, args.neck).train()
    optimizer = torch.optim.Adam(model.parameters(), 1e-4, weight_decay=5e-4)
    objective = Objective(args.batch, *args.size)
    batch = torch.randn(args.batch, 3, args.size[1], args.size[0])
    forward = model
    if args.best:
        model.to(memory_format=torch.channels_last)
        batch = batch.contiguous(memory_format=torch.channels_last)
        forward = torch.compile(model)

    def pytorch_step():
        start = time.perf_counter()
        optimizer.zero_grad()
        with torch.autocast("cpu", torch.bfloat16, enabled=args.best):
            logits, raw = forward(batch)
        objective(logits.float(), raw.float()).backward()
        optimizer.step()
        return time.perf_counter() - start

    with tempfile.NamedTemporaryFile("w", suffix=".toml") as config:
        config.write(smoke_config(args.neck, args.norm, args.width, args.size, "bf16" if args.best else "f32"))
        config.flush()
        command = ["env", f"OMP_NUM_THREADS={args.threads}", args.farsight, config.name, str(args.batch)]
        farsight = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

        def farsight_step():
            farsight.stdin.write("\n")
            farsight.stdin.flush()
            return float(farsight.stdout.readline())

        for _ in range(2):
            pytorch_step(), farsight_step()
        pairs = [(pytorch_step(), farsight_step()) for _ in range(args.rounds)]
        farsight.stdin.close()
    theirs, ours = (statistics.median(side) for side in zip(*pairs))
    ratio = statistics.median(f / t for t, f in pairs)
    print(f"{args.neck} {args.norm} width {args.width} {args.size[0]}x{args.size[1]} batch {args.batch} threads {args.threads}")
    print(f"PyTorch {theirs:.3f} s   Farsight {ours:.3f} s   median ratio {ratio:.3f}")
    if args.table:
        command = "python3 scripts/compare_training_step.py --farsight target/release/examples/step_speed"
        command += " --neck NECK --norm NORM [--best]"
        table = MeasuredTable.opened(args.table, f"{command} --rounds {args.rounds} --threads {args.threads}", COLUMNS)
        network = f"{args.neck} neck, {args.norm} norm, width {args.width}" + ", torchvision" * args.torchvision
        network += ", bf16, compiled" * args.best
        size = f"{args.size[0]}x{args.size[1]}"
        table.put(network, size, str(args.batch), f"{theirs:.3f}", f"{ours:.3f}", f"{ratio:.2f}")
        table.write(args.table)


if __name__ == "__main__":
    main()
