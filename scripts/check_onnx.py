"""Checks an exported file with ONNX's own checker and runs it with ONNX Runtime.

python scripts/check_onnx.py MODEL.onnx REFERENCE.safetensors

REFERENCE holds `input`, `cls_logits` and `reg_raw`; the largest difference of each map is printed. Ends with status 77 when the packages onnx,
onnxruntime or numpy are not there.
"""

import json
import struct
import sys

try:
    import numpy as np
    import onnx
    import onnxruntime
except ImportError as missing:
    print(missing)
    sys.exit(77)


def tensors(path):
    with open(path, "rb") as file:
        data = file.read()
    (length,) = struct.unpack("<Q", data[:8])
    header = json.loads(data[8 : 8 + length])
    header.pop("__metadata__", None)

    def tensor(info):
        start, end = info["data_offsets"]
        return np.frombuffer(data[8 + length :][start:end], dtype="<f4").reshape(info["shape"])

    return {name: tensor(info) for name, info in header.items()}


def main(model_path, reference_path):
    model = onnx.load(model_path)
    onnx.checker.check_model(model, full_check=True)
    reference = tensors(reference_path)
    session = onnxruntime.InferenceSession(model_path, providers=["CPUExecutionProvider"])
    names = ["cls_logits", "reg_raw"]
    maps = session.run(names, {"image": reference["input"]})
    for name, found in zip(names, maps):
        assert found.shape == reference[name].shape, (name, found.shape, reference[name].shape)
        print(name, float(np.abs(found - reference[name]).max()))
    # The batch is free: two images at once are the same as one after the other.
    twice = session.run(names, {"image": np.concatenate([reference["input"]] * 2)})
    for name, one, two in zip(names, maps, twice):
        assert np.abs(np.concatenate([one, one]) - two).max() < 1e-4, name


main(*sys.argv[1:])
