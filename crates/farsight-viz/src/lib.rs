//! Detections drawn on the image and seen from above.
