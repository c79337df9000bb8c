# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Bounding-volume hierarchies of surfaces: exact signed distances, and nearest faces.

A binary tree of axis-aligned boxes over the triangles of a surface, split at the median along the
longest axis. As it is balanced, only the boxes are stored: the children of node i are 2 i and
2 i + 1, and the triangles of a leaf follow from its number. A query descends to the nearer child
first; the bits of an integer mark the levels on which the other child is still to be visited.

References
----------
J. A. Bærentzen and H. Aanæs, Signed Distance Computation Using the Angle Weighted Pseudonormal,
IEEE Transactions on Visualization and Computer Graphics 11 (3), 2005.
C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5: closest point on a triangle.

"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
import hashlib
import math

import numpy as np

from softbody_ros.core.compiled import helper, kernel
from softbody_ros.core.geometry.surface import MeshError, Surface
from softbody_ros.core.geometry.vectors import (
    Vector,
    along,
    cross,
    dot,
    minus,
    norm,
    plus,
    put_vector,
    scaled,
    vector_of,
)

LEAF = 4
"""Most triangles of a leaf."""
TIE = 1e-9
"""Relative difference of squared distances that are equal up to rounding."""
ROUNDING = 1e-9
"""Distance, relative to coordinates, above which the offset gives the normal."""
CANCELLED = 1e-12
"""Length up to which a sum of unit normals cancels: the surface is folded onto itself."""
FLAT = 0.9
"""Dihedral cosine above which a face counts as smooth at its corner."""
KEPT = 32
"""Size of the cache of trees."""
COARSEST, FINEST = 16, 64
"""Bounds of samples along the longest side of a surface, for the thickness of walls."""
HALVINGS, OPPOSITE = 20, 0.3
"""Halvings of the sampling depth, at most; cosine that tells opposite normals."""

TREE = np.dtype(
    [
        ('first_node', np.int64),  # of the row before its root, in the nodes of all trees
        ('depth', np.int64),  # levels of nodes above the leaves, of which there are 2 ** depth
        ('first_face', np.int64),  # in the faces of all trees
        ('count', np.int64),  # of faces
    ],
    align=True,
)
"""Indices of one tree in the arrays of several trees."""
NODE = np.dtype([('low', np.float64, (3,)), ('high', np.float64, (3,))], align=True)
"""Corners of a box, m."""
FACE = np.dtype(
    [
        ('corner', np.float64, (3,)),  # a, m
        ('ab', np.float64, (3,)),
        ('ac', np.float64, (3,)),
        ('pseudonormals', np.float64, (7, 3)),  # units: the face; edges ab, bc, ca; a, b, c
        ('index', np.int64),  # of the face in its surface
    ],
    align=True,
)
"""One triangle; leaf by leaf."""

Trees = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Trees in common arrays, as kernels take them: (T,) TREE, (N,) NODE and (F,) FACE."""


# ---------------------------------------------------------------------------------------- queries
@helper
def closest_on_triangle(face: np.void, point: Vector) -> tuple[float, Vector, int]:
    """
    Return the squared distance, m², from a FACE, the offset, m, from its closest point, and
    which of the pseudonormals belongs to that point.
    """  # noqa: D205
    ab, ac = vector_of(face['ab']), vector_of(face['ac'])
    offset = minus(point, vector_of(face['corner']))
    # the names of Ericson, who calls the corners a, b, c
    abab, abac, acac = dot(ab, ab), dot(ab, ac), dot(ac, ac)
    d1, d2 = dot(ab, offset), dot(ac, offset)
    d3, d4, d5, d6 = d1 - abab, d2 - abac, d1 - abac, d2 - acac
    va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
    feature, v, w = 0, 0.0, 0.0
    if d1 <= 0.0 and d2 <= 0.0:
        feature = 4
    elif d3 >= 0.0 and d4 <= d3:
        feature, v = 5, 1.0
    elif d6 >= 0.0 and d5 <= d6:
        feature, w = 6, 1.0
    elif vc <= 0.0 and d1 >= 0.0 and d3 <= 0.0:
        feature, v = 1, d1 / abab
    elif vb <= 0.0 and d2 >= 0.0 and d6 <= 0.0:
        feature, w = 3, d2 / acac
    elif va <= 0.0 and d4 >= d3 and d5 >= d6:
        feature, w = 2, (d4 - d3) / ((d4 - d3) + (d5 - d6))
        v = 1.0 - w
    else:
        v, w = vb / (va + vb + vc), vc / (va + vb + vc)
    offset = along(along(offset, -v, ab), -w, ac)
    return dot(offset, offset), offset, feature


@helper
def _square_from_box(node: np.void, point: Vector) -> float:
    """Return the squared distance from a NODE, m²."""
    low, high = node['low'], node['high']
    x = max(low[0] - point[0], point[0] - high[0], 0.0)
    y = max(low[1] - point[1], point[1] - high[1], 0.0)
    z = max(low[2] - point[2], point[2] - high[2], 0.0)
    return x * x + y * y + z * z


@helper
def square_from_plane(face: np.void, point: Vector) -> float:
    """Return the squared distance from the plane of a FACE, m²: that of the face is not less."""
    height = dot(minus(point, vector_of(face['corner'])), vector_of(face['pseudonormals'][0]))
    return height * height


@helper
def closest_face(
    trees: Trees, tree: int, point: Vector, reach: float
) -> tuple[int, float, Vector, int]:
    """
    Return the face of a tree that is nearest to a point, −1 if none is within reach.

    Of faces that share the closest point, an edge or a corner, the one that faces the point most.

    Parameters
    ----------
    trees : Trees
    tree : int
        which of them
    point : Vector
        in the frame of the surface, m
    reach : float
        square of a distance, m²

    Returns
    -------
    face : int
        row of the FACE in `trees`
    square : float
        of its distance, m²
    offset : Vector
        from the closest point, m
    feature : int
        which of the pseudonormals belongs to the closest point

    """
    headers, nodes, faces = trees
    root, depth = headers[tree]['first_node'], headers[tree]['depth']
    first, count = headers[tree]['first_face'], headers[tree]['count']
    face, square, offset, feature = -1, reach, (0.0, 0.0, 0.0), 0
    limit, facing = reach, -1.0
    node, level, pending = 1, 0, 0
    while True:
        if level == depth:
            leaf = node - (1 << depth)
            begin, end = (leaf * count) >> depth, ((leaf + 1) * count) >> depth
            for row in range(first + begin, first + end):
                if square_from_plane(faces[row], point) >= limit:
                    continue
                from_it, direction, part_feature = closest_on_triangle(faces[row], point)
                if from_it < limit:
                    height = dot(direction, vector_of(faces[row]['pseudonormals'][0]))
                    if from_it < (1.0 - TIE) * square or height * height > facing:
                        face, square, offset, feature = row, from_it, direction, part_feature
                        limit, facing = (1.0 + TIE) * square, height * height
        else:
            left = _square_from_box(nodes[root + 2 * node], point)
            right = _square_from_box(nodes[root + 2 * node + 1], point)
            if min(left, right) < limit:
                node, level, pending = 2 * node, level + 1, 2 * pending
                if right < left:
                    node += 1
                if max(left, right) < limit:
                    pending += 1
                continue
        # back to the nearest level on which the other child has not been visited
        while pending != 0:
            while pending & 1 == 0:
                node, level, pending = node >> 1, level - 1, pending >> 1
            node, pending = node ^ 1, pending ^ 1
            if _square_from_box(nodes[root + node], point) < limit:
                break
            if pending == 0:
                return face, square, offset, feature
        else:
            return face, square, offset, feature


@helper
def nearest_face(trees: Trees, tree: int, point: Vector) -> int:
    """Return the index, in its surface, of the face nearest to a point, m."""
    face = closest_face(trees, tree, point, np.inf)[0]
    return trees[2][max(face, 0)]['index']


@helper
def signed_distance_from_mesh(trees: Trees, tree: int, point: Vector) -> tuple[float, Vector]:
    """
    Return the signed distance, m, of a point from a closed surface, and its gradient.

    Negative inside. At the surface, where the offset is rounding, the gradient is replaced by the
    pseudonormal.
    """
    row, square, offset, feature = closest_face(trees, tree, point, np.inf)
    if row < 0:  # not a number
        return np.nan, (np.nan, np.nan, np.nan)
    face = trees[2][row]
    pseudonormal = vector_of(face['pseudonormals'][feature])
    distance = math.copysign(math.sqrt(square), dot(offset, pseudonormal))
    corner = vector_of(face['corner'])
    size = max(abs(point[0]), abs(point[1]), abs(point[2]))
    size += max(abs(corner[0]), abs(corner[1]), abs(corner[2]))
    if feature == 0 or abs(distance) <= ROUNDING * size:
        return distance, pseudonormal
    return distance, scaled(1.0 / distance, offset)


@kernel
def signed_distances(
    trees: Trees, tree: int, points: np.ndarray, distance: np.ndarray, normal: np.ndarray
) -> None:
    """Write the signed distances (k,), m, and normals (k, 3) of points (k, 3), m."""
    for i in range(len(points)):
        distance[i], direction = signed_distance_from_mesh(trees, tree, vector_of(points[i]))
        put_vector(normal[i], direction)


# ------------------------------------------------------------------------------------ construction
@helper
def _partition(order: np.ndarray, key: np.ndarray, begin: int, end: int, middle: int) -> None:
    """Partition order[begin:end] at rank `middle` by keys (quickselect of Hoare)."""
    low, high = begin, end - 1
    while low < high:
        pivot = key[order[(low + high) // 2]]
        i, j = low, high
        while i <= j:
            while key[order[i]] < pivot:
                i += 1
            while key[order[j]] > pivot:
                j -= 1
            if i <= j:
                order[i], order[j] = order[j], order[i]
                i, j = i + 1, j - 1
        if middle <= j:
            high = j
        elif middle >= i:
            low = i
        else:
            break


@kernel
def _sort_into_leaves(centres: np.ndarray, depth: int, order: np.ndarray) -> None:
    """Sort triangles by the leaves of a tree, in place; centres (3, m) at any scale."""
    count = len(order)
    for node in range(1, 1 << depth):
        level = 0
        while node >> (level + 1):
            level += 1
        # its leaves, and therefore its triangles
        below = depth - level
        leaf = (node - (1 << level)) << below
        begin, end = (leaf * count) >> depth, ((leaf + (1 << below)) * count) >> depth
        longest, axis = -1.0, 0
        for row in range(3):
            low = high = centres[row, order[begin]]
            for k in range(begin + 1, end):
                low, high = (
                    min(low, centres[row, order[k]]),
                    max(high, centres[row, order[k]]),
                )
            if high - low > longest:
                longest, axis = high - low, row
        middle = ((leaf + (1 << (below - 1))) * count) >> depth
        _partition(order, centres[axis], begin, end, middle)


@kernel
def _put_boxes(faces: np.ndarray, depth: int, nodes: np.ndarray) -> None:
    """Write the boxes of a tree with sorted faces, FACE, from the leaves to the root."""
    count, leaves = len(faces), 1 << depth
    for node in range(2 * leaves - 1, 0, -1):
        low, high = nodes[node]['low'], nodes[node]['high']
        for row in range(3):
            least, largest = np.inf, -np.inf
            if node >= leaves:
                leaf = node - leaves
                for k in range((leaf * count) >> depth, ((leaf + 1) * count) >> depth):
                    a = faces[k]['corner'][row]
                    b, c = a + faces[k]['ab'][row], a + faces[k]['ac'][row]
                    least, largest = min(least, a, b, c), max(largest, a, b, c)
            else:
                for child in (2 * node, 2 * node + 1):
                    least = min(least, nodes[child]['low'][row])
                    largest = max(largest, nodes[child]['high'][row])
            low[row], high[row] = least, largest


@helper
def _add(total: np.ndarray, a: Vector) -> None:
    put_vector(total, plus(vector_of(total), a))


@helper
def _unit(a: Vector, instead: Vector) -> Vector:
    """Return a / |a|, or a default if |a| is too small."""
    length = norm(a)
    return scaled(1.0 / length, a) if length > CANCELLED else instead


@kernel
def _put_faces(
    vertices: np.ndarray,
    corners: np.ndarray,
    edges: np.ndarray,
    order: np.ndarray,
    of_edge: np.ndarray,
    of_vertex: np.ndarray,
    faces: np.ndarray,
) -> None:
    """
    Write the faces of a tree, with the pseudonormals of Bærentzen and Aanæs.

    The normal of a vertex is the sum of those of its faces, weighted by the angles at it; that of
    an edge the sum of those of its two faces.

    Parameters
    ----------
    vertices : (n, 3) float
        m
    corners : (m, 3) int
        of the faces of the surface
    edges : (m, 3) int
        of the faces: ab, bc, ca
    order : (m,) int
    of_edge, of_vertex : (e, 3), (n, 3) float
        zeros; sums of normals
    faces : (m,) FACE

    """
    for k in range(len(order)):
        index, face = order[k], faces[k]
        a, b, c = corners[index, 0], corners[index, 1], corners[index, 2]
        origin = vector_of(vertices[a])
        ab, ac = minus(vector_of(vertices[b]), origin), minus(vector_of(vertices[c]), origin)
        bc = minus(vector_of(vertices[c]), vector_of(vertices[b]))
        face['index'] = index
        put_vector(face['corner'], origin)
        put_vector(face['ab'], ab)
        put_vector(face['ac'], ac)
        across = cross(ab, ac)
        area = norm(across)
        normal = scaled(1.0 / area if area > 0.0 else 0.0, across)
        put_vector(face['pseudonormals'][0], normal)
        for side in range(3):
            _add(of_edge[edges[index, side]], normal)
        _add(of_vertex[a], scaled(math.atan2(area, dot(ab, ac)), normal))
        _add(of_vertex[b], scaled(math.atan2(area, -dot(ab, bc)), normal))
        _add(of_vertex[c], scaled(math.atan2(area, dot(ac, bc)), normal))
    for k in range(len(order)):
        index, pseudonormals = order[k], faces[k]['pseudonormals']
        normal = vector_of(pseudonormals[0])
        for side in range(3):
            edge, vertex = edges[index, side], corners[index, side]
            put_vector(pseudonormals[1 + side], _unit(vector_of(of_edge[edge]), normal))
            put_vector(pseudonormals[4 + side], _unit(vector_of(of_vertex[vertex]), normal))


# ------------------------------------------------------------------------------------------- trees
@dataclass(frozen=True, eq=False)
class SurfaceTree:
    """
    A surface with a bounding-volume hierarchy over its m triangles.

    Attributes
    ----------
    surface : Surface
    header : (1,) TREE
    nodes : (2 ** (depth + 1),) NODE
        without the first, which is unused
    faces : (m,) FACE

    """

    surface: Surface
    header: np.ndarray
    nodes: np.ndarray
    faces: np.ndarray

    @property
    def arrays(self) -> Trees:
        """The arrays for kernels, in which it is tree 0."""
        return self.header, self.nodes, self.faces

    @property
    def low(self) -> np.ndarray:
        """(3,) float: lower corner of the bounding box of the surface, m."""
        return self.nodes['low'][1]

    @property
    def high(self) -> np.ndarray:
        """(3,) float: upper corner of the bounding box of the surface, m."""
        return self.nodes['high'][1]

    def distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return signed distances (k,), m, negative inside, and normals (k, 3) of points."""
        points = np.ascontiguousarray(points, dtype=np.float64)
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        signed_distances(self.arrays, 0, points, distance, normal)
        return distance, normal

    @cached_property
    def sharp_vertices(self) -> np.ndarray:
        """(k, 3) float: vertices on edges and corners of the surface, m."""
        corner, ab, ac = (self.faces[name] for name in ('corner', 'ab', 'ac'))
        corners = np.stack([corner, corner + ab, corner + ac], axis=1)
        face, vertices = self.faces['pseudonormals'][:, :1], self.faces['pseudonormals'][:, 4:]
        return np.unique(corners[(face * vertices).sum(axis=2) < FLAT], axis=0)

    @cached_property
    def resolution(self) -> float:
        """Sampling length, m: a typical edge, within bounds."""
        area = 0.5 * np.linalg.norm(np.cross(self.faces['ab'], self.faces['ac']), axis=1).sum()
        typical_edge = np.sqrt(4 / 3**0.5 * area / len(self.faces))
        longest = float((self.high - self.low).max())
        return float(np.clip(typical_edge, longest / FINEST, longest / COARSEST))

    @cached_property
    def half_thickness(self) -> float:
        """
        Lower bound of the half thickness of walls, m; at most 3^½ / 2 of `resolution`.

        Where samples moved inwards are nearer to the far side, the wall is thinner than that.
        """
        pieces, face = _split(self.surface.vertices[self.surface.faces], 1.5 * self.resolution)
        normals = np.empty((len(self.faces), 3))
        normals[self.faces['index']] = self.faces['pseudonormals'][:, 0]
        points, outwards = pieces.mean(axis=1), normals[face]
        depth = 0.5 * 3**0.5 * self.resolution
        for _ in range(HALVINGS):
            distance, normal = self.distance(points - depth * outwards)
            through = (distance > 0.0) | ((normal * outwards).sum(axis=1) < -OPPOSITE)
            if not through.any():
                break
            points, outwards = points[through], outwards[through]
            depth *= 0.5
        return depth


def _split(corners: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Subdivide triangles (m, 3, 3) until no edge is too long; return them and their parents."""
    pieces, parents = [], []
    parent = np.arange(len(corners))
    while len(corners):
        lengths = np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2)
        edge = lengths.argmax(axis=1)
        large = lengths.max(axis=1) > longest
        pieces.append(corners[~large])
        parents.append(parent[~large])
        order = (edge[large, None] + np.arange(3)) % 3
        a, b, c = np.take_along_axis(corners[large], order[..., None], axis=1).swapaxes(0, 1)
        middle = (a + b) / 2
        corners = np.concatenate([np.stack([a, middle, c], 1), np.stack([middle, b, c], 1)])
        parent = np.tile(parent[large], 2)
    return np.concatenate(pieces), np.concatenate(parents)


def make_tree(surface: Surface) -> SurfaceTree:
    """Return the tree of a surface with faces; nearest faces do not require a closed one."""
    vertices, corners = surface.vertices, surface.faces
    count, depth = len(corners), 0
    while count > LEAF << depth:
        depth += 1
    places = vertices[corners]
    centres = np.ascontiguousarray((places.min(axis=1) + places.max(axis=1)).T)
    order = np.arange(count)
    _sort_into_leaves(centres, depth, order)

    ends = np.stack([corners, np.roll(corners, -1, axis=1)]).astype(np.int64)
    numbers = ends.min(axis=0) * len(vertices) + ends.max(axis=0)
    distinct, edges = np.unique(numbers, return_inverse=True)
    of_edge, of_vertex = np.zeros((len(distinct), 3)), np.zeros((len(vertices), 3))
    faces, nodes = np.zeros(count, FACE), np.zeros(2 << depth, NODE)
    _put_faces(vertices, corners, edges.reshape(-1, 3), order, of_edge, of_vertex, faces)
    _put_boxes(faces, depth, nodes)
    return SurfaceTree(surface, np.array([(0, depth, 0, count)], dtype=TREE), nodes, faces)


def closed_tree(surface: Surface) -> SurfaceTree:
    """
    Return the tree of a closed surface, cached by all that it is.

    Raises
    ------
    MeshError
        if the surface is not closed.

    """
    facts = (surface.vertices.shape, surface.source, surface.notes)
    digest = hashlib.blake2b(str(facts).encode())
    digest.update(surface.vertices.tobytes())
    digest.update(surface.faces.tobytes())
    return _cached(_Content(digest.digest(), surface))


@dataclass(frozen=True)
class _Content:
    digest: bytes
    surface: Surface = field(compare=False)


@lru_cache(maxsize=KEPT)
def _cached(content: _Content) -> SurfaceTree:
    surface = content.surface
    if not surface.closed:
        defects, remedy = surface.openness
        name = f'mesh {surface.source}'.rstrip()
        raise MeshError(f'{name} is not closed, so that it has no inside ({defects}): {remedy}')
    return make_tree(surface)


def pack(trees: Sequence[SurfaceTree]) -> Trees:
    """Return the arrays of several trees, in this order, for kernels."""
    # with just these dtypes, as kernels compare others to them each time, field by field
    headers = np.concatenate([np.zeros(0, TREE), *(tree.header for tree in trees)], dtype=TREE)
    headers['first_node'] = np.cumsum([0, *(len(tree.nodes) for tree in trees)])[:-1]
    headers['first_face'] = np.cumsum([0, *(len(tree.faces) for tree in trees)])[:-1]
    nodes = np.concatenate([np.zeros(0, NODE), *(tree.nodes for tree in trees)], dtype=NODE)
    faces = np.concatenate([np.zeros(0, FACE), *(tree.faces for tree in trees)], dtype=FACE)
    return headers, nodes, faces
