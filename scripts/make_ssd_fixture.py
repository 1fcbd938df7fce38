#!/usr/bin/env python3
"""Writes what the test of the shipped SSD compares with (crates/farsight-methods/tests/it/ssd.rs): LiteRT's answers for one image.

    make_ssd_fixture.py object_detection_ssd_mobilenetv2_oidv4_fp16.tflite

The file is that of the npm package @mediapipe/objectron (docs/backbones.md). Needs NumPy, ai-edge-litert and safetensors. Every 7th of the 1,917
anchors is kept: the box, and the logits of bicycle, person, vehicle and car. The twin of `image` is in the test.
"""

import sys
from pathlib import Path

import numpy
from ai_edge_litert.interpreter import Interpreter
from safetensors.numpy import save_file

FIXTURE = Path(__file__).resolve().parent.parent / "crates/farsight-methods/tests/fixtures/ssd_litert.safetensors"
SIDE = 300
LABELS = [1, 4, 18, 23]
MEAN, STD = numpy.array([0.485, 0.456, 0.406]), numpy.array([0.229, 0.224, 0.225])


def image():
    """Normalised as our networks get it, `[3, side, side]`."""
    k = numpy.arange(3 * SIDE * SIDE, dtype=numpy.float64)
    values = 2.0 * numpy.sin(0.37 * k) * numpy.cos(0.0011 * k)
    return values.astype(numpy.float32).reshape(3, SIDE, SIDE)


def main():
    interpreter = Interpreter(sys.argv[1])
    interpreter.allocate_tensors()
    colours = image().transpose(1, 2, 0).astype(numpy.float64) * STD + MEAN
    interpreter.set_tensor(interpreter.get_input_details()[0]["index"], (2.0 * colours - 1.0).astype(numpy.float32)[None])
    interpreter.invoke()
    outputs = {output["name"]: interpreter.get_tensor(output["index"])[0] for output in interpreter.get_output_details()}
    boxes, classes = outputs["raw_outputs/box_encodings"][::7], outputs["raw_outputs/class_predictions"][::7, LABELS]
    save_file({"boxes": numpy.ascontiguousarray(boxes), "classes": numpy.ascontiguousarray(classes)}, FIXTURE)


if __name__ == "__main__":
    main()
