#!/usr/bin/env python3
"""Where an engine spends its time: kind of layer, numbers that it computes in, share of the network's time.

    target/release/farsight export --model models/farsight-s.safetensors --out farsight-s.onnx
    target/release/farsight export --model models/farsight-s.safetensors --int8 --float-layers 0 \
        --calibration IMAGES --out farsight-s-int8.onnx      # with --target onnxruntime the third one
    python3 scripts/profile_layers.py --onnx farsight-s.onnx --int8 farsight-s-int8.onnx \
        --int8-onnxruntime farsight-s-ort.onnx --input 960x288 --table docs/results/layers.json

ONNX Runtime and OpenVINO (from PyPI, with numpy) tell the time of each layer. Layers of one kind are added up; medians
over the runs.
"""
import argparse
import collections
import json
import pathlib
import re
import statistics
import tempfile

import numpy as np

from measured_table import MeasuredTable

COLUMNS = ["engine, file", "layers", "in", "ms", "share"]
RUNS = 15
WARM_UP = 3
# Layers below this share of the time are added up as "other".
LEAST_SHARE = 0.015


def kind(operator, numbers):
    """What a reader calls a layer, and the numbers it computes in."""
    moves = ("Reorder", "Transpose", "Concat", "Split", "Reshape", "DepthToSpace", "Slice", "Pad", "StridedSlice")
    if operator in ("QuantizeLinear", "DequantizeLinear", "FakeQuantize", "Convert", "Cast"):
        return "to and from 8 bits", ""
    if operator.startswith(moves):
        return "moves: " + operator.removesuffix("Input").removesuffix("Output"), numbers
    return operator, numbers


def onnxruntime_layers(model, image, threads, folder, _):
    """Milliseconds of each kind of layer, one dictionary a run."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    options.enable_profiling = True
    options.profile_file_prefix = str(folder / "ort")
    session = onnxruntime.InferenceSession(str(model), options, providers=["CPUExecutionProvider"])
    for _ in range(WARM_UP + RUNS):
        session.run(None, {"image": image})
    runs = []
    for event in json.loads(pathlib.Path(session.end_profiling()).read_text()):
        if event["cat"] == "Session" and event["name"] == "model_run":
            continue
        arguments = event.get("args", {})
        if event["cat"] != "Node" or not event["name"].endswith("_kernel_time"):
            continue
        node = int(arguments["node_index"])
        types = {name for shapes in arguments.get("input_type_shape", []) for name in shapes}
        numbers = "8 bits" if types & {"uint8", "int8"} else "float"
        runs.append((node, kind(arguments["op_name"], numbers), event["dur"] / 1e3))
    # One after the other, every node once a run.
    count = collections.Counter(node for node, _, _ in runs)
    seen, by_run = collections.Counter(), [collections.Counter() for _ in range(max(count.values()))]
    for node, name, ms in runs:
        by_run[seen[node]][name] += ms
        seen[node] += 1
    return by_run[WARM_UP:]


def openvino_layers(model, image, threads, _, numbers):
    import openvino

    core = openvino.Core()
    network = core.read_model(model)
    network.reshape(list(image.shape))
    hints = {"PERF_COUNT": True, "INFERENCE_NUM_THREADS": threads, "PERFORMANCE_HINT": "LATENCY"}
    if numbers == "fp32":
        # In 8 bits the other layers may compute in bfloat16, as in Farsight.
        hints["INFERENCE_PRECISION_HINT"] = "f32"
    request = core.compile_model(network, "CPU", hints).create_infer_request()
    by_run = []
    for number in range(WARM_UP + RUNS):
        request.infer({"image": image})
        layers = collections.Counter()
        for layer in request.profiling_info:
            if layer.status == openvino.ProfilingInfo.Status.EXECUTED:
                known = [("8 bits", r"_[IU]8$"), ("bfloat16", "_bf16$")]
                found = next((name for name, ending in known if re.search(ending, layer.exec_type)), "float")
                layers[kind(layer.node_type, found)] += layer.real_time.total_seconds() * 1e3
        if number >= WARM_UP:
            by_run.append(layers)
    return by_run


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--onnx", required=True, help="the plain export")
    parser.add_argument("--int8", required=True, help="the same quantised")
    parser.add_argument("--int8-onnxruntime", help="the same for ONNX Runtime (export --target onnxruntime)")
    parser.add_argument("--input", default="960x288")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--table", help="write the medians to this table (JSON)")
    options = parser.parse_args()

    width, height = map(int, options.input.split("x"))
    image = np.random.default_rng(0).standard_normal((1, 3, height, width), dtype=np.float32)
    files = "--onnx ONNX --int8 ONNX --int8-onnxruntime ONNX"
    command = f"python3 scripts/profile_layers.py {files} --input {options.input} --threads {options.threads}"
    table = MeasuredTable(command, COLUMNS)
    engines = [("ONNX Runtime", onnxruntime_layers), ("OpenVINO", openvino_layers)]
    int8 = {"ONNX Runtime": options.int8_onnxruntime or options.int8, "OpenVINO": options.int8}
    for numbers, models in (("fp32", dict.fromkeys(int8, options.onnx)), ("int8", int8)):
        for engine, layers in engines:
            model = models[engine]
            with tempfile.TemporaryDirectory() as folder:
                by_run = layers(model, image, options.threads, pathlib.Path(folder), numbers)
            names = {name for run in by_run for name in run}
            ms = {name: statistics.median(run.get(name, 0.0) for run in by_run) for name in names}
            total, other = sum(ms.values()), 0.0
            for name, value in sorted(ms.items(), key=lambda one: -one[1]):
                if value < LEAST_SHARE * total:
                    other += value
                    continue
                table.rows.append([f"{engine}, {numbers}", *name, f"{value:.1f}", f"{value / total:.0%}"])
            table.rows.append([f"{engine}, {numbers}", "other", "", f"{other:.1f}", f"{other / total:.0%}"])
    for row in [COLUMNS, *table.rows]:
        print(" | ".join(row))
    if options.table:
        table.write(options.table)


if __name__ == "__main__":
    main()
