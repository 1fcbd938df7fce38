"""Writes fuzz/corpus/model: a small ONNX file with all that Farsight's reader looks at, and broken variants of it.

ONNX's own package writes them, so that the reader is held against a writer that is not ours (what ours writes is among
the seeds of farsight-laws anyhow). Needs the packages onnx and numpy. Run from the project's root: python scripts/make_model_seeds.py
"""

import copy
import json
import pathlib

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

FOLDER = pathlib.Path("fuzz/corpus/model")
CHANNELS, HIDDEN = 4, 3
HEAD = {"features": "neck", "hidden": ["h.weight", "h.bias"], "output": ["o.weight", "o.bias"]}


def constant(name, *shape):
    return numpy_helper.from_array(np.arange(np.prod(shape), dtype=np.float32).reshape(shape) / 10, name)


def value(name, channels):
    return helper.make_tensor_value_info(name, TensorProto.FLOAT, ["batch", channels, "height", "width"])


def conv(inputs, output, kernel, stride=1):
    pads = [kernel // 2] * 4
    return helper.make_node("Conv", inputs, [output], kernel_shape=[kernel] * 2, strides=[stride] * 2, pads=pads)


def whole():
    nodes = [
        conv(["image", "stem.weight"], "neck", 5, stride=4),
        conv(["neck", "c.weight"], "cls_logits", 1),
        conv(["neck", "h.weight", "h.bias"], "hidden", 3),
        helper.make_node("Relu", ["hidden"], ["active"]),
        conv(["active", "o.weight", "o.bias"], "reg_raw", 1),
    ]
    constants = [
        constant("stem.weight", CHANNELS, 3, 5, 5),
        constant("c.weight", 3, CHANNELS, 1, 1),
        constant("h.weight", HIDDEN, CHANNELS, 3, 3),
        constant("h.bias", HIDDEN),
        constant("o.weight", 8, HIDDEN, 1, 1),
        constant("o.bias", 8),
    ]
    graph = helper.make_graph(nodes, "seed", [value("image", 3)], [value("cls_logits", 3), value("reg_raw", 8)], constants)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 19)], ir_version=9)
    model.producer_name = "seed"
    helper.set_model_props(model, {"farsight.model": json.dumps({"input": [64, 32]}), "farsight.peaks_head": json.dumps(HEAD), "farsight.weights_sha256": "0"})
    onnx.checker.check_model(model, full_check=True)
    return model


def write(name, model, change=None):
    model = copy.deepcopy(model)
    if change:
        change(model)
    (FOLDER / name).write_bytes(model.SerializeToString())


def prop(key, text):
    def change(model):
        next(p for p in model.metadata_props if p.key == key).value = text

    return change


def external(model):
    tensor = model.graph.initializer[0]
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")


def operator(model):
    model.graph.node[3].op_type = "Loop"


def function(model):
    model.functions.add(name="f", domain="x")


def quantized(model):
    """The first convolution in 8 bits: its input, its weight, and what it makes, which the head reads."""
    graph = model.graph
    step = numpy_helper.from_array(np.float32(0.5), "step")
    zero, weight_zero = (numpy_helper.from_array(kind(0), name) for kind, name in [(np.uint8, "zero"), (np.int8, "weight_zero")])
    bytes_ = numpy_helper.from_array(np.arange(CHANNELS * 75, dtype=np.int8).reshape(CHANNELS, 3, 5, 5), "stem.weight")
    graph.initializer[0].CopyFrom(bytes_)
    graph.initializer.extend([step, zero, weight_zero])

    def rounded(name):
        quantize = helper.make_node("QuantizeLinear", [name, "step", "zero"], [f"{name}/quantized"])
        return [quantize, helper.make_node("DequantizeLinear", [f"{name}/quantized", "step", "zero"], [f"{name}/rounded"])]

    weight = helper.make_node("DequantizeLinear", ["stem.weight", "step", "weight_zero"], ["stem.weight/rounded"])
    stem, *rest = list(graph.node)
    stem.input[:] = ["image/rounded", "stem.weight/rounded"]
    for node in rest:
        node.input[:] = ["neck/rounded" if name == "neck" else name for name in node.input]
    del graph.node[:]
    graph.node.extend([*rounded("image"), weight, stem, *rounded("neck"), *rest])
    prop("farsight.peaks_head", json.dumps({**HEAD, "features": "neck/rounded"}))(model)
    onnx.checker.check_model(model, full_check=True)


def quantized_head(model):
    """A head that says its weight is one in 8 bits, which it must not be."""
    quantized(model)
    prop("farsight.peaks_head", json.dumps({**HEAD, "hidden": ["stem.weight", "h.bias"]}))(model)


def main():
    FOLDER.mkdir(parents=True, exist_ok=True)
    model = whole()
    data = model.SerializeToString()
    write("whole", model)
    write("foreign", model, lambda m: m.metadata_props.pop(0))
    write("config_no_json", model, prop("farsight.model", "{"))
    write("config_hostile_size", model, prop("farsight.model", '{"input": [3200000000, 3200000000]}'))
    write("external", model, external)
    write("operator", model, operator)
    write("function", model, function)
    write("no_output", model, lambda m: m.graph.output.pop())
    write("no_input", model, lambda m: m.graph.input.pop())
    write("channels", model, lambda m: setattr(m.graph.output[1].type.tensor_type.shape.dim[1], "dim_value", 7))
    write("no_graph", model, lambda m: m.ClearField("graph"))
    write("head_missing", model, prop("farsight.peaks_head", json.dumps({**HEAD, "features": "nowhere"})))
    write("head_constant", model, prop("farsight.peaks_head", json.dumps({**HEAD, "hidden": ["x", "h.bias"]})))
    write("head_shape", model, prop("farsight.peaks_head", json.dumps({**HEAD, "output": ["c.weight", "c.weight"]})))
    write("head_size", model, lambda m: m.graph.initializer[2].dims.__setitem__(0, 1 << 40))
    write("quantized", model, quantized)
    write("quantized_head", model, quantized_head)
    (FOLDER / "cut").write_bytes(data[: len(data) // 2])
    (FOLDER / "long_number").write_bytes(b"\xff" * 12)
    (FOLDER / "empty").write_bytes(b"")


main()
