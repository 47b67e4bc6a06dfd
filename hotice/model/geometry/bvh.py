"""Distance to triangles and their winding number in compiled code, over a tree of bounding boxes.

The tree is laid out depth first: an inner node is followed by its left child. The winding number takes the triangles of
a far node as one dipole (Barill et al. 2018, "Fast winding numbers for soups and clouds", first order): what decides
inside from outside is whether it is above one half in size, for which that is accurate enough.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hotice.compiled import compiled

_LEAF = 8
_FAR = 2.0
"""A node farther than this many of its radii counts as one dipole."""


class Tree(NamedTuple):
    """Trees of one or several meshes in shared arrays.

    `triangles` (T, 3, 3) in the order of the leaves; `nodes` (N, 15): lowest and highest corner (6), then right child
    and 0 or, of a leaf, first triangle and number (2), then area-weighted centre (3), area vector (3) and radius.
    """

    triangles: NDArray[np.float64]
    nodes: NDArray[np.float64]

    @classmethod
    def of(cls, corners: NDArray[np.float64]) -> Tree:
        """The tree over triangles (T, 3, 3), T > 0."""
        return cls(*_build(np.ascontiguousarray(corners, dtype=np.float64)))

    @classmethod
    def join(cls, trees: list[Tree]) -> tuple[Tree, list[int]]:
        """All trees in one, and the root node of each; of no trees an empty one."""
        roots, triangles = [0], 0
        nodes = [np.empty((0, 15))]
        for tree in trees:
            moved = tree.nodes.copy()
            moved[:, 6] += np.where(moved[:, 7] > 0, triangles, roots[-1])
            nodes.append(moved)
            roots.append(roots[-1] + len(moved))
            triangles += len(tree.triangles)
        corners = np.concatenate([np.empty((0, 3, 3)), *(t.triangles for t in trees)])
        return cls(corners, np.concatenate(nodes)), roots[:-1]


@compiled(nogil=True)
def _build(corners):
    count = len(corners)
    centre = np.empty((count, 3))
    area = np.empty((count, 3))
    for t in range(count):
        a, b, c = corners[t]
        centre[t] = (a + b + c) / 3.0
        area[t] = 0.5 * np.cross(b - a, c - a)
    order = np.arange(count)
    nodes = np.zeros((4 * count // _LEAF + 3, 15))
    stack = [(0, count, -1)]
    size = 0
    while len(stack):
        low, high, parent = stack.pop()
        node = size
        size += 1
        if parent >= 0:
            nodes[parent, 6] = node
        part = order[low:high]
        _summarise(corners, centre, area, part, nodes[node])
        if high - low <= _LEAF:
            nodes[node, 6], nodes[node, 7] = low, high - low
            continue
        axis = np.argmax(nodes[node, 3:6] - nodes[node, :3])
        order[low:high] = part[np.argsort(centre[part, axis])]
        middle = (low + high) // 2
        stack.append((middle, high, node))
        stack.append((low, middle, -1))
    return corners[order], nodes[:size].copy()


@compiled(nogil=True)
def _summarise(corners, centre, area, part, node):
    node[:3], node[3:6] = np.inf, -np.inf
    total = 0.0
    for t in part:
        for k in range(3):
            node[k] = min(node[k], corners[t, :, k].min())
            node[3 + k] = max(node[3 + k], corners[t, :, k].max())
        size = math.sqrt((area[t] ** 2).sum())
        total += size
        node[8:11] += size * centre[t]
        node[11:14] += area[t]
    node[8:11] /= max(total, 1e-300)
    for t in part:
        for i in range(3):
            node[14] = max(node[14], math.sqrt(((corners[t, i] - node[8:11]) ** 2).sum()))


@compiled(nogil=True)
def closest(triangles, nodes, root, x, y, z, bound):
    """Distance from a point to the mesh at `root`, or `bound` when that is smaller."""
    best = bound * bound
    stack = np.empty(64, np.int64)
    stack[0] = root
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        if _box_squared(nodes, node, x, y, z) >= best:
            continue
        first, count = int(nodes[node, 6]), int(nodes[node, 7])
        if count > 0:
            for t in range(first, first + count):
                best = min(best, triangle_squared(triangles, t, x, y, z))
            continue
        left, right = node + 1, first
        near, far = _box_squared(nodes, left, x, y, z), _box_squared(nodes, right, x, y, z)
        if near > far:
            left, right, near, far = right, left, far, near
        if far < best:
            stack[top] = right
            top += 1
        if near < best:
            stack[top] = left
            top += 1
    return math.sqrt(best)


@compiled(nogil=True)
def inside(triangles, nodes, root, x, y, z):
    """Whether the winding number of the mesh at `root` about a point is above one half in size."""
    box = nodes[root]
    if not (box[0] < x < box[3] and box[1] < y < box[4] and box[2] < z < box[5]):
        return False
    total = 0.0
    stack = np.empty(64, np.int64)
    stack[0] = root
    top = 1
    while top > 0:
        top -= 1
        node = stack[top]
        rx, ry, rz = nodes[node, 8] - x, nodes[node, 9] - y, nodes[node, 10] - z
        rr = rx * rx + ry * ry + rz * rz
        if rr > (_FAR * nodes[node, 14]) ** 2:
            total += (rx * nodes[node, 11] + ry * nodes[node, 12] + rz * nodes[node, 13]) / (rr * math.sqrt(rr))
            continue
        first, count = int(nodes[node, 6]), int(nodes[node, 7])
        if count > 0:
            for t in range(first, first + count):
                total += _solid_angle(triangles, t, x, y, z)
            continue
        stack[top] = first
        stack[top + 1] = node + 1
        top += 2
    return abs(total) > 2.0 * math.pi


@compiled(inline="always")
def _box_squared(nodes, n, x, y, z):
    dx = max(nodes[n, 0] - x, 0.0, x - nodes[n, 3])
    dy = max(nodes[n, 1] - y, 0.0, y - nodes[n, 4])
    dz = max(nodes[n, 2] - z, 0.0, z - nodes[n, 5])
    return dx * dx + dy * dy + dz * dz


@compiled
def triangle_squared(triangles, t, x, y, z):
    """Squared distance to a triangle: to its plane where the foot lies inside, else to the nearest edge."""
    ax, ay, az = triangles[t, 0, 0], triangles[t, 0, 1], triangles[t, 0, 2]
    ux, uy, uz = triangles[t, 1, 0] - ax, triangles[t, 1, 1] - ay, triangles[t, 1, 2] - az
    vx, vy, vz = triangles[t, 2, 0] - ax, triangles[t, 2, 1] - ay, triangles[t, 2, 2] - az
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    wx, wy, wz = x - ax, y - ay, z - az
    nn = nx * nx + ny * ny + nz * nz
    if nn > 0.0:
        b = nx * (wy * vz - wz * vy) + ny * (wz * vx - wx * vz) + nz * (wx * vy - wy * vx)
        c = nx * (uy * wz - uz * wy) + ny * (uz * wx - ux * wz) + nz * (ux * wy - uy * wx)
        if b >= 0.0 and c >= 0.0 and b + c <= nn:
            away = nx * wx + ny * wy + nz * wz
            return away * away / nn
    best = np.inf
    for i in range(3):
        j = (i + 1) % 3
        px, py, pz = triangles[t, i, 0], triangles[t, i, 1], triangles[t, i, 2]
        ex, ey, ez = triangles[t, j, 0] - px, triangles[t, j, 1] - py, triangles[t, j, 2] - pz
        dx, dy, dz = x - px, y - py, z - pz
        ee = ex * ex + ey * ey + ez * ez
        s = min(max((dx * ex + dy * ey + dz * ez) / ee, 0.0), 1.0) if ee > 0.0 else 0.0
        best = min(best, (dx - s * ex) ** 2 + (dy - s * ey) ** 2 + (dz - s * ez) ** 2)
    return best


@compiled
def _solid_angle(triangles, t, x, y, z):
    """Solid angle of a triangle about the point, signed (van Oosterom and Strackee 1983)."""
    ax, ay, az = triangles[t, 0, 0] - x, triangles[t, 0, 1] - y, triangles[t, 0, 2] - z
    bx, by, bz = triangles[t, 1, 0] - x, triangles[t, 1, 1] - y, triangles[t, 1, 2] - z
    cx, cy, cz = triangles[t, 2, 0] - x, triangles[t, 2, 1] - y, triangles[t, 2, 2] - z
    a = math.sqrt(ax * ax + ay * ay + az * az)
    b = math.sqrt(bx * bx + by * by + bz * bz)
    c = math.sqrt(cx * cx + cy * cy + cz * cz)
    triple = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    ab, bc, ca = ax * bx + ay * by + az * bz, bx * cx + by * cy + bz * cz, cx * ax + cy * ay + cz * az
    return 2.0 * math.atan2(triple, a * b * c + ab * c + bc * a + ca * b)


@compiled(nogil=True)
def signed_distance(triangles, nodes, root, x, y, z):
    """Signed distance of a point to the mesh at `root`, negative inside."""
    d = closest(triangles, nodes, root, x, y, z, np.inf)
    return -d if inside(triangles, nodes, root, x, y, z) else d


@compiled(nogil=True)
def signed_distances(triangles, nodes, p):
    """`signed_distance` of points (n, 3) to the first mesh, (n,)."""
    return np.array([signed_distance(triangles, nodes, 0, p[n, 0], p[n, 1], p[n, 2]) for n in range(len(p))])
