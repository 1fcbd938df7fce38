//! Image in, detections out: the engine trait and the detector.
