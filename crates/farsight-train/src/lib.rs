//! Training on libtorch: executor, losses, optimiser, trainer, checkpoints.
