//! KITTI readers and writers, image loading, warping, augmentation and a prefetching loader.
