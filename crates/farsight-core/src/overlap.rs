//! Overlap of upright boxes, rotated in the ground plane.
