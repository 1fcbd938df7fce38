"""Losses of MonoDLE, OFTNet, GS3D and MonoGRNet, and means over voxels, by numpy from the formulas alone.

Prints the constants of crates/farsight-methods/tests/train/{monodle,oftnet}.rs: values, and the sum over all inputs of the
gradient (central differences) times the cosine of the input's index.

    python scripts/make_rival_goldens.py
"""

import numpy as np

OBJECTS = 5
BINS = 12


def directional(loss, x):
    """Value, and the derivative of `loss` along the cosines of the indices."""
    step = 1e-5
    along = np.cos(np.arange(x.size)).reshape(x.shape)
    return loss(x), (loss(x + step * along) - loss(x - step * along)) / (2 * step)


def show(name, result):
    value, slope = result
    print(f"{name}: [{value:.12f}, {slope:.9f}]")


i = np.arange(OBJECTS, dtype=np.float64)

depth_found = np.stack([2.0 * np.sin(0.7 * i + 0.3) - 3.0, 1.5 * np.cos(1.1 * i)], axis=1)
depth_m = 5.0 + 7.0 * i


def depth_loss(x):
    z = 1.0 / (1.0 / (1.0 + np.exp(-x[:, 0])) + 1e-6) - 1.0
    v = x[:, 1]
    return np.mean(np.sqrt(2.0) * np.exp(-v / 2.0) * np.abs(z - depth_m) + v / 2.0)


show("depth", directional(depth_loss, depth_found))

k = np.arange(3 * OBJECTS, dtype=np.float64).reshape(OBJECTS, 3)
sizes = 1.0 + 3.0 * np.abs(np.sin(0.9 * k))
sizes_found = sizes + 0.4 * np.sin(2.3 * k + 1.0)


# The value is plain L1. The factor that makes it so has no gradient, so the gradient is that of the relative error
# times the factor where it stands.
def sizes_relative(x):
    return np.mean(np.abs(x - sizes) / sizes)


value = np.mean(np.abs(sizes_found - sizes))
relative, slope = directional(sizes_relative, sizes_found)
show("dimensions", (value, slope * value / relative))

n = np.arange(2 * BINS * OBJECTS, dtype=np.float64).reshape(OBJECTS, 2 * BINS)
heading_found = np.sin(0.37 * n)
bins = (5 * np.arange(OBJECTS) + 2) % BINS
residual = 0.2 * np.sin(i)


def heading_loss(x):
    logits = x[:, :BINS]
    rows = np.arange(OBJECTS)
    entropy = np.log(np.exp(logits).sum(axis=1)) - logits[rows, bins]
    return np.mean(entropy + np.abs(x[rows, BINS + bins] - residual))


show("heading", directional(heading_loss, heading_found))


# OFTNet (spec other-systems.md 1): means over the box around a voxel's projected corners, cell by cell, and the losses.
HEIGHT, WIDTH = 5, 9
FOCAL, CENTER_U, CENTER_V = 12.0, 4.0, 1.5
CELL, SLAB, PLANE, TOP = 2.0, 1.0, 1.7, 2.0
COLUMNS, ROWS, SLABS = 4, 5, 2
feature = np.sin(0.61 * np.arange(HEIGHT * WIDTH)).reshape(HEIGHT, WIDTH)


def voxel_mean(slab, row, column):
    us, vs = [], []
    for ds in (0, 1):
        for dr in (0, 1):
            for dc in (0, 1):
                x = (column + dc - COLUMNS / 2) * CELL
                y = PLANE - TOP + (slab + ds) * SLAB
                z = (row + dr) * CELL
                if z <= 0:
                    return 0.0
                us.append(FOCAL * x / z + CENTER_U)
                vs.append(FOCAL * y / z + CENTER_V)
    # Each cell of the map reaches half a pixel to both sides of its centre and counts by what the box covers of it.
    total, area = 0.0, 0.0
    for r in range(HEIGHT):
        for c in range(WIDTH):
            w = min(max(us), c + 0.5) - max(min(us), c - 0.5)
            h = min(max(vs), r + 0.5) - max(min(vs), r - 0.5)
            if w > 0 and h > 0:
                total += w * h * feature[r, c]
                area += w * h
    return total / area if area > 0 else 0.0


for place in [(0, 0, 1), (0, 1, 0), (0, 1, 2), (0, 4, 3), (1, 1, 1), (1, 2, 3), (1, 4, 0)]:
    print(f"voxel {place}: {voxel_mean(*place):.12f}")

BATCH, CLASSES, GRID_ROWS, GRID_COLUMNS, ANSWERS = 2, 2, 3, 4, 9
size = BATCH * CLASSES * ANSWERS * GRID_ROWS * GRID_COLUMNS
answer = 0.8 * np.sin(0.53 * np.arange(size)).reshape(BATCH, CLASSES, ANSWERS, GRID_ROWS, GRID_COLUMNS)
heatmap = np.abs(np.sin(0.91 * np.arange(BATCH * CLASSES * GRID_ROWS * GRID_COLUMNS))) ** 4
heatmap = heatmap.reshape(BATCH, CLASSES, GRID_ROWS, GRID_COLUMNS)
objects = [(0, 1, 2, 3), (1, 0, 0, 0), (1, 1, 1, 2)]
wanted = np.cos(0.3 * np.arange(8 * len(objects))).reshape(len(objects), 8)


def oft_losses(x):
    scale = BATCH * GRID_ROWS * GRID_COLUMNS
    score = (np.abs(x[:, :, 0] - heatmap) * np.where(heatmap > 0.05, 100.0, 1.0)).sum() / scale
    off = np.array([np.abs(x[b, c, 1:, r, k] - w) for (b, c, r, k), w in zip(objects, wanted)])
    return [score, off[:, :3].sum() / scale, off[:, 3:6].sum() / scale, off[:, 6:].sum() / scale]


print("oftnet:", ", ".join(f"{loss:.12f}" for loss in oft_losses(answer)))
show("oftnet, all", directional(lambda x: sum(oft_losses(x)), answer))

# GS3D (spec other-systems.md 2): cross entropy of bins against how good boxes are, and a guidance.
n = np.arange(147, dtype=np.float64).reshape(3, 49)
bin_logits = 5.0 * np.sin(0.37 * n)
goodness = np.clip(np.sin(0.23 * n), 0.0, 1.0)


def refinement_loss(x):
    p = 1.0 / (1.0 + np.exp(-x))
    return -(goodness * np.log(p) + (1.0 - goodness) * np.log(1.0 - p)).sum() / 3.0


show("gs3d", directional(refinement_loss, bin_logits))

projection = np.array([[721.5, 0.0, 609.6, 44.9], [0.0, 721.5, 172.9, 0.2], [0.0, 0.0, 1.0, 0.003]])
x1, y1, x2, y2 = 500.0, 160.0, 620.0, 250.0
alpha, mean_height = -1.3, 1.53
z = 721.5 * mean_height / (0.93 * (y2 - y1))
u, v = (x1 + x2) / 2.0, y2 - 0.07 * (y2 - y1)
first, second, third = projection
lines = np.array([first[:2] - u * third[:2], second[:2] - v * third[:2]])
right = -np.array([first[2] * z + first[3] - u * (third[2] * z + third[3]),
                   second[2] * z + second[3] - v * (third[2] * z + third[3])])
x, y = np.linalg.solve(lines, right)
print(f"guidance: {x:.9f}, {y:.9f}, {z:.9f}, yaw {alpha + np.arctan2(x, z):.9f}")


def wave(step, *shape):
    return np.sin(step * np.arange(np.prod(shape), dtype=np.float64)).reshape(shape)


def entropy(logits, classes):
    shifted = logits - logits.max(axis=1, keepdims=True)
    log_p = shifted - np.log(np.exp(shifted).sum(axis=1, keepdims=True))
    return -np.mean([row[c] for row, c in zip(log_p, classes)])


def l1(found, expected):
    return np.mean(np.abs(np.asarray(found) - np.asarray(expected)))


# MonoGRNet: a grid of 3 x 2 cells, flattened; cell 3 may say anything, cells 1 and 5 have objects.
cells = wave(0.37, 6, 6).T
depth = wave(0.41, 1, 6).T
center = wave(0.43, 2, 6).T
counted, classes = [0, 1, 2, 4, 5], [0, 1, 0, 0, 1]
terms = [entropy(cells[counted, :2], classes)]
own = [1, 5]
box_targets = [wave(1.2, 4), wave(1.3, 4)]
depth_targets = [[20.5 - 25.0], [21.0 - 25.0]]
center_targets = [wave(1.4, 2), wave(1.5, 2)]
terms.append(0.1 * l1(cells[own, 2:], box_targets))
rezoom, depth_step, center_step = wave(0.47, 3, 6), wave(0.53, 3, 1), wave(0.59, 3, 2)
objects = [0, 2]
object_depths = [[30.01 - 25.0], [30.02 - 25.0]]
object_centers = [wave(0.51, 2), wave(0.52, 2)]
terms.append(l1(depth[own], depth_targets) + l1(depth[own] + depth_step[objects], object_depths))
terms.append(l1(center[own], center_targets) + l1(center[own] + center_step[objects], object_centers))
moves = [wave(0.31, 4), wave(0.32, 4)]
terms.append(0.1 * (entropy(rezoom[:, :2], [1, 0, 1]) + l1(rezoom[objects, 2:], moves)))
corners = [wave(0.71, 24), wave(0.72, 24)]
terms.append(0.5 * l1(3.0 * np.tanh(wave(0.61, 3, 24)[objects]), corners))
terms.append(0.5 * l1(2.0 * np.tanh(wave(0.67, 2, 24)), [wave(0.9, 24)] * 2))
print("monogrnet:", ", ".join(f"{term:.9f}" for term in terms))
