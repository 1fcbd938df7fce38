#!/usr/bin/env python3
"""Milliseconds an image: Farsight on each engine beside its peers on the same weights, taking turns in one run; medians.

    cargo build --release
    target/release/farsight export --model models/farsight-s.safetensors --out farsight-s.onnx
    python3 scripts/compare_engines.py --onnx farsight-s.onnx [--int8 farsight-s-int8.onnx] \
        [--int8-onnxruntime farsight-s-ort.onnx] --input 1280x384 --rounds 7 --table docs/results/engines.json

Farsight is timed from the image file to the detections (`farsight bench`), and its network alone; the peers get a tensor that is ready
and give head maps. Peers whose Python package is missing are left out: onnxruntime, openvino, torch, tract (with numpy).
Run Farsight's engines from the same packages (`farsight doctor` says which library it finds), so that the libraries are the same.
--table writes the medians as a table that documents quote (measured_table.py).
"""
import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

import numpy as np

from measured_table import MeasuredTable

# Runs of every contender in every round, after one that is not counted.
RUNS = 5


def onnxruntime_peer(model, image, threads):
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads
    session = onnxruntime.InferenceSession(model, options, providers=["CPUExecutionProvider"])
    return lambda: session.run(None, {"image": image})


def openvino_peer(precision):
    def peer(model, image, threads):
        import openvino

        hints = {"INFERENCE_PRECISION_HINT": precision, "INFERENCE_NUM_THREADS": threads, "PERFORMANCE_HINT": "LATENCY"}
        core = openvino.Core()
        network = core.read_model(model)
        network.reshape(list(image.shape))
        request = core.compile_model(network, "CPU", hints).create_infer_request()
        return lambda: request.infer({"image": image})

    return peer


def tract_peer(model, image, threads):
    """tract runs on one thread, whatever is asked for."""
    import tract

    network = tract.onnx().load(str(model))
    network.set_input_fact(0, ",".join(map(str, image.shape)) + ",f32")
    for output in range(network.output_count()):
        network.set_output_fact(output, None)
    runnable = tract.runtime_for_name("default").prepare(network.into_model())
    return lambda: runnable.run([image])


def torch_peer(model, image, threads):
    """The ONNX graph, operator by operator, as an eager PyTorch program would call them."""
    import onnx
    import torch
    import torch.nn.functional as F
    from onnx import numpy_helper

    torch.set_num_threads(threads)
    graph = onnx.load(model).graph
    constants = {c.name: torch.from_numpy(numpy_helper.to_array(c).copy()) for c in graph.initializer}

    def half_pads(a):
        return a["pads"][:2] if "pads" in a else [0, 0]

    operators = {
        "Conv": lambda a, x, w, b=None: F.conv2d(x, w, b, a["strides"], half_pads(a), a["dilations"], a["group"]),
        "ConvTranspose": lambda a, x, w, b=None: F.conv_transpose2d(x, w, b, a["strides"], half_pads(a), 0, a["group"]),
        "Relu": lambda a, x: F.relu_(x),
        "Sigmoid": lambda a, x: torch.sigmoid(x),
        "Add": lambda a, x, y: x + y,
        "Mul": lambda a, x, y: x * y,
        "Concat": lambda a, *xs: torch.cat(xs, a["axis"]),
        "MaxPool": lambda a, x: F.max_pool2d(x, a["kernel_shape"], a["strides"]),
        "GlobalAveragePool": lambda a, x: F.adaptive_avg_pool2d(x, 1),
        "Resize": lambda a, x, _, scales: F.interpolate(x, scale_factor=scales[2:].tolist(), mode="bilinear"),
    }
    missing = {node.op_type for node in graph.node} - operators.keys()
    if missing:
        raise ImportError(f"no PyTorch form of {', '.join(sorted(missing))}")
    steps = []
    for node in graph.node:
        attributes = {a.name: onnx.helper.get_attribute_value(a) for a in node.attribute}
        steps.append((operators[node.op_type], attributes, list(node.input), node.output[0]))
    tensor = torch.from_numpy(image)

    def run():
        values = {**constants, "image": tensor, "": None}
        with torch.inference_mode():
            for operator, attributes, inputs, output in steps:
                values[output] = operator(attributes, *(values[name] for name in inputs))
        return [values[o.name] for o in graph.output]

    return run


def peaks(threads):
    """What this CPU multiplies and adds in a second when nothing else holds it up: a large matrix product in PyTorch."""
    try:
        import torch
    except ImportError as missing:
        return print(f"left out: the CPU's peak: {missing}")
    torch.set_num_threads(threads)
    side = 2048
    floats = torch.randn(side, side)
    bytes_ = torch.randint(-100, 100, (side, side), dtype=torch.int8)
    for name, run in (("fp32", lambda: floats @ floats), ("int8", lambda: torch._int_mm(bytes_, bytes_))):
        print(f"peak of the CPU, {name}: {side**3 / median_ms(run) / 1e6:.0f} GMAC/s")


def median_ms(run):
    run()
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        run()
        times.append((time.perf_counter() - start) * 1e3)
    return statistics.median(times)


def farsight_bench(args, model, *options):
    """Median milliseconds from file to detections, and of the network alone."""
    with tempfile.TemporaryDirectory() as folder:
        out = pathlib.Path(folder) / "bench.json"
        command = [args.farsight, "bench", "--model", model, "--runs", str(RUNS), "--threads", str(args.threads), "--refiner", "none"]
        command += ["--input", args.input, "--json", str(out), *options]
        command += ["--image", args.image] if args.image else []
        subprocess.run(command, check=True, capture_output=True)
        figures = json.loads(out.read_text())
    return figures["total"]["median_ms"], dict(figures["stages"])["network"]["median_ms"]


def contenders(args):
    """Name and a function that gives milliseconds in all and of the network, for everything that runs here."""
    width, height = map(int, args.input.split("x"))
    image = np.random.default_rng(0).standard_normal((1, 3, height, width), dtype=np.float32)
    engines = {"rten": [], "onnxruntime": [], "openvino": []}
    models = [("fp32", args.onnx)] + ([("int8", args.int8)] if args.int8 else [])
    # As it is made for ONNX Runtime.
    made = [("fp32", args.onnx)] + [("int8", args.int8_onnxruntime)] if args.int8_onnxruntime else models
    for numbers, _ in models:
        for engine in engines:
            model = dict(made if engine == "onnxruntime" else models)[numbers]
            yield f"Farsight, {engine}, {numbers}", lambda m=model, e=engine: farsight_bench(args, m, "--engine", e)
    cpu = pathlib.Path("/proc/cpuinfo")
    if cpu.exists() and "bf16" in cpu.read_text():
        bf16 = ["--engine", "openvino", "--precision", "bf16"]
        yield "Farsight, openvino, bf16", lambda: farsight_bench(args, args.onnx, *bf16)
    peers = [
        ("ONNX Runtime alone", onnxruntime_peer, made),
        ("OpenVINO alone", openvino_peer("f32"), models),
        ("PyTorch, eager", torch_peer, models[:1]),
        ("tract", tract_peer, models[:1]),
    ]
    for name, peer, runs in peers:
        for numbers, model in runs:
            try:
                run = peer(str(model), image, args.threads)
            except (ImportError, AttributeError, RuntimeError) as missing:
                print(f"left out: {name}, {numbers}: {missing}")
                continue
            yield f"{name}, {numbers}", lambda run=run: (None, median_ms(run))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--farsight", default="target/release/farsight")
    parser.add_argument("--onnx", required=True, help="the plain export")
    parser.add_argument("--int8", help="the same quantised")
    parser.add_argument("--int8-onnxruntime", help="the same for ONNX Runtime (export --target onnxruntime)")
    parser.add_argument("--image", help="image file; default: Farsight's example scene, 1242x375")
    parser.add_argument("--input", default="1280x384")
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--table", help="write the medians to this table (JSON)")
    args = parser.parse_args()

    peaks(args.threads)
    runs = list(contenders(args))
    rounds = []
    for number in range(args.rounds):
        rounds.append({name: run() for name, run in runs})
        print(f"round {number + 1} of {args.rounds}", flush=True)
    base = "ONNX Runtime alone, fp32"
    columns = ["program, precision", "file to detections, ms", "network, ms", f"network / {base}"]
    files = "--onnx ONNX --int8 ONNX --int8-onnxruntime ONNX"
    command = f"python3 scripts/compare_engines.py {files} --input {args.input} --rounds {args.rounds}"
    table = MeasuredTable(f"{command} --threads {args.threads}", columns)
    for name, _ in runs:
        total = [r[name][0] for r in rounds if r[name][0] is not None]
        network = [r[name][1] for r in rounds]
        ratios = [r[name][1] / r[base][1] for r in rounds if base in r]
        shown = f"{statistics.median(total):.1f}" if total else ""
        ratio = f"{statistics.median(ratios):.2f}" if ratios else ""
        table.put(name, shown, f"{statistics.median(network):.1f}", ratio)
    for row in [columns, *table.rows]:
        print(" | ".join(row))
    if args.table:
        table.write(args.table)


if __name__ == "__main__":
    main()
