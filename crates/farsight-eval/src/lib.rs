//! The KITTI evaluation and ranging errors.
