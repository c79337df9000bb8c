# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A grid around a closed surface in which every cell knows the faces that are nearest to it.

Where sampled distance fields interpolate, and round off edges and thin walls, this one computes
the distance to the few triangles that can be nearest.

References
----------
J. A. Bærentzen and H. Aanæs, Signed Distance Computation Using the Angle Weighted Pseudonormal,
IEEE Transactions on Visualization and Computer Graphics 11 (3), 2005.
C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5: closest point on a triangle.

"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property, lru_cache
import hashlib
from itertools import chain

import numpy as np
from scipy import ndimage
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from softbody_ros.core.columns import ranges, summed
from softbody_ros.core.geometry.grid import Grid, grid_around
from softbody_ros.core.geometry.mesh import MeshError, Surface

FEWEST_CELLS, MOST_CELLS = 16, 64
"""Cells along the longest side of a surface."""
MARGIN = 2
"""Cells between a surface's bounding box and the border of the grid."""
BLOCK = 4096
"""Cells whose candidates are found at once: bounds the memory."""
FLAT = 0.9
"""Cosine between the normals of a face and of its corner from which on there is no edge."""
KEPT = 32
"""Grids that are remembered."""
HALVINGS, OPPOSITE = 20, 0.3
"""Walls thinner than 2⁻²⁰ of a cell count as that; cosine from which on normals are opposite."""


@dataclass(frozen=True, eq=False)
class NearestFaces:
    """
    For each of N cells the faces that can be nearest to a point in it.

    A cell whose centre is nearer to the surface than its diagonal has them all. A cell further
    away has only the face nearest to its centre, so that there distances may be too large, by less
    than two diagonals and on smooth surfaces in second order only.

    Attributes
    ----------
    triangles : Triangles
    low, high : (3,) float
        bounding box of the surface, m
    grid : Grid
        with a border of one cell that has no faces
    first : (N + 1,) int
        where the faces of each cell begin in `faces`
    faces : (k,) int
        the nearest to the centre of the cell first
    bound : (k,) float32
        that the distance of each from the centre is not less than, m
    nearest_face : (N,) int
        the first of each cell, −1 for the border
    level : (N,) float
        signed distance of the centre, in no cell more than `diagonal`, m

    """

    triangles: Triangles
    low: np.ndarray
    high: np.ndarray
    grid: Grid
    first: np.ndarray
    faces: np.ndarray
    bound: np.ndarray
    nearest_face: np.ndarray
    level: np.ndarray

    @cached_property
    def sharp_vertices(self) -> np.ndarray:
        """(k, 3) float: those at which the surface has an edge or a corner, m."""
        triangles = self.triangles
        corners = np.stack([0.0 * triangles.ab, triangles.ab, triangles.ac])
        corners = (triangles.corner + corners).transpose(2, 0, 1)
        face, vertices = triangles.pseudonormals[:, :1], triangles.pseudonormals[:, 4:]
        sharp = np.einsum('fki,fvi->fv', face, vertices) < FLAT
        return np.unique(corners[sharp], axis=0)

    @property
    def diagonal(self) -> float:
        """Of a cell, m."""
        return 3**0.5 * self.grid.cell

    @property
    def exact_to(self) -> float:
        """Distance from the surface up to which distances are exact, m."""
        return 0.5 * self.diagonal

    def at_least(self, distance: np.ndarray) -> np.ndarray:
        """Return lower bounds (k,) of the true distances, from those of `distance`."""
        far = np.maximum(distance - 2.0 * self.diagonal, self.exact_to)
        return np.where(distance > self.exact_to, far, distance)

    def is_clear(self, points: np.ndarray, distance: np.ndarray) -> np.ndarray:
        """Return (k,) bool: points surely not nearer than distances (k,); a quick test."""
        cells = self.grid.cells(points)
        return self.level[cells] - self._from_centres(points, cells) > distance

    @cached_property
    def half_thickness(self) -> float:
        """
        Of the thinnest wall, m, from below; at most `exact_to`.

        From points of the surface inwards, until the far side of the wall is nearer.
        """
        corners = np.stack([0.0 * self.triangles.ab, self.triangles.ab, self.triangles.ac])
        corners = (self.triangles.corner + corners).transpose(2, 0, 1)
        pieces, face = _split(corners, 1.5 * self.grid.cell)
        points, outwards = pieces.mean(axis=1), self.triangles.pseudonormals[face, 0]
        depth = self.exact_to
        for _ in range(HALVINGS):
            distance, normal = self.distance(points - depth * outwards)
            through = (distance > 0.0) | (np.einsum('ij,ij->i', normal, outwards) < -OPPOSITE)
            if not through.any():
                break
            points, outwards = points[through], outwards[through]
            depth *= 0.5
        return depth

    def distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """
        Return signed distances (k,), negative inside, and outward normals (k, 3).

        Exact near the surface, see `NearestFaces`. Outside of the grid it is the distance from the
        bounding box: not larger than that from the surface.

        Parameters
        ----------
        points : (k, 3) float
            m

        """
        cells = self.grid.cells(points)
        count = self.first[cells + 1] - self.first[cells]
        distance, normal = np.empty(len(points)), np.empty((len(points), 3))
        within = count > 0
        if within.any():
            distance[within], normal[within] = self._distance_within(
                points[within], cells[within], count[within]
            )
        beyond = ~within
        if beyond.any():
            offset = points[beyond] - np.clip(points[beyond], self.low, self.high)
            distance[beyond] = np.linalg.norm(offset, axis=1)
            normal[beyond] = offset / distance[beyond, None]
        return distance, normal

    def _from_centres(self, points: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Return the distances (k,) of points (k, 3) from the centres of cells (k,), m."""
        place = np.stack(np.unravel_index(cells, self.grid.shape))
        offset = points.T - self.grid.origin[:, None] - self.grid.cell * (place + 0.5)
        return np.sqrt(_dot(offset, offset))

    def _distance_within(
        self, points: np.ndarray, cells: np.ndarray, count: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        places = points.T
        entry = ranges(self.first[cells], count)
        # most cannot be nearer than the first one is: bounds are from the centre of the cell
        nearest = np.sqrt(self.triangles.closest(places, self.nearest_face[cells])[0])
        reach = nearest + self._from_centres(points, cells)
        possible = self.bound[entry] <= np.repeat(reach, count)
        index = np.repeat(np.arange(len(count)), count)[possible]
        faces = self.faces[entry[possible]]
        square = self.triangles.closest(places[:, index], faces)[0]
        start = np.searchsorted(index, np.arange(len(count)))
        least = np.minimum.reduceat(square, start)
        hits = np.flatnonzero(square == least[index])
        face = faces[hits[np.searchsorted(hits, start)]]
        distance, normal = self.triangles.signed_distance(places, face)
        # a far cell is on one side; its face, if it is not the nearest, may be seen from the other
        level = self.level[cells]
        turned = (np.abs(level) >= self.diagonal) & (level * distance < 0.0)
        return np.where(turned, -distance, distance), np.where(turned[:, None], -normal, normal)


def nearest_faces(surface: Surface) -> NearestFaces:
    """
    Return the grid of a closed surface; the same one for the same vertices and faces.

    Raises
    ------
    MeshError
        if the surface is not closed.

    """
    digest = hashlib.blake2b(str(surface.vertices.shape).encode())
    digest.update(surface.vertices.tobytes())
    digest.update(surface.faces.tobytes())
    return _cached(_Content(digest.digest(), surface))


@dataclass(frozen=True)
class _Content:
    digest: bytes
    surface: Surface = field(compare=False)


@lru_cache(maxsize=KEPT)
def _cached(content: _Content) -> NearestFaces:
    return _built(content.surface)


# -------------------------------------------------------------------------------------- triangles
@dataclass(frozen=True, eq=False)
class Triangles:
    """
    The m triangles of a closed surface.

    Attributes
    ----------
    corner : (3, m) float
        the first corner a of each, m
    ab, ac : (3, m) float
        from there to the others, m
    pseudonormals : (m, 7, 3) float
        unit normals of the face, of its edges ab, bc, ca and of its corners a, b, c

    """

    corner: np.ndarray
    ab: np.ndarray
    ac: np.ndarray
    pseudonormals: np.ndarray

    @cached_property
    def products(self) -> np.ndarray:
        """(3, m) float: ab · ab, ab · ac and ac · ac, m²."""
        return np.stack([_dot(self.ab, self.ab), _dot(self.ab, self.ac), _dot(self.ac, self.ac)])

    def closest(
        self, points: np.ndarray, faces: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """
        Return how far points are from faces, one from one.

        Parameters
        ----------
        points : (3, k) float
            m
        faces : (k,) int

        Returns
        -------
        square : (k,) float
            squares of the distances, m²
        offset : (3, k) float
            from the closest points of the faces to the points, m
        feature : (k,) int
            which of the `pseudonormals` belongs to the closest point

        """
        ab, ac = self.ab[:, faces], self.ac[:, faces]
        abab, abac, acac = self.products[:, faces]
        offset = points - self.corner[:, faces]
        # the names of Ericson, who calls the corners a, b, c
        d1, d2 = _dot(ab, offset), _dot(ac, offset)
        d3, d4, d5, d6 = d1 - abab, d2 - abac, d1 - abac, d2 - acac
        va, vb, vc = d3 * d6 - d5 * d4, d5 * d2 - d1 * d6, d1 * d4 - d3 * d2
        v, w = _ratio(vb, va + vb + vc), _ratio(vc, va + vb + vc)
        feature = np.zeros(len(faces), dtype=np.int8)

        def take(which: np.ndarray, number: int, new_v: np.ndarray, new_w: np.ndarray) -> None:
            np.copyto(v, new_v, where=which)
            np.copyto(w, new_w, where=which)
            np.copyto(feature, number, where=which)

        none, all_ = np.zeros(1), np.ones(1)
        d43, d56 = d4 - d3, d5 - d6
        along = _ratio(d43, d43 + d56)
        take((va <= 0.0) & (d43 >= 0.0) & (d56 >= 0.0), 2, 1.0 - along, along)
        take((vb <= 0.0) & (d2 >= 0.0) & (d6 <= 0.0), 3, none, _ratio(d2, acac))
        take((vc <= 0.0) & (d1 >= 0.0) & (d3 <= 0.0), 1, _ratio(d1, abab), none)
        take((d6 >= 0.0) & (d5 <= d6), 6, none, all_)
        take((d3 >= 0.0) & (d4 <= d3), 5, all_, none)
        take((d1 <= 0.0) & (d2 <= 0.0), 4, none, none)
        offset -= v * ab
        offset -= w * ac
        return _dot(offset, offset), offset, feature

    def signed_distance(
        self, points: np.ndarray, faces: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return signed distances (k,) and normals (k, 3) of points (3, k) to their faces (k,)."""
        square, offset, feature = self.closest(points, faces)
        pseudonormal = self.pseudonormals[faces, feature]
        distance = np.copysign(np.sqrt(square), np.einsum('ik,ki->k', offset, pseudonormal))
        # near the surface offsets are rounding: there pseudonormals are the way out
        scale = np.abs(points).max(axis=0) + np.abs(self.corner[:, faces]).max(axis=0)
        oblique = (feature > 0) & (np.abs(distance) > 1e-9 * scale)
        normal = offset.T / np.where(oblique, distance, 1.0)[:, None]
        return distance, np.where(oblique[:, None], normal, pseudonormal)


def make_triangles(surface: Surface) -> Triangles:
    """Return the triangles of a closed surface with their pseudonormals."""
    vertices, faces = surface.vertices, surface.faces
    a, b, c = vertices[faces.T]
    normal = _units(np.cross(b - a, c - a))
    edges = np.stack([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]], axis=1)
    ends = np.sort(edges, axis=2).astype(np.int64)
    _, edge = np.unique(ends[..., 0] * len(vertices) + ends[..., 1], return_inverse=True)
    edge = edge.reshape(-1)
    of_edges = summed(np.repeat(normal, 3, axis=0), edge, edge.max() + 1)[edge]

    sides = _units(np.stack([b - a, c - b, a - c], axis=1))
    cosines = -np.einsum('fsi,fsi->fs', sides, np.roll(sides, 1, axis=1))
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))
    weighted = angles[..., None] * normal[:, None]
    of_vertices = summed(weighted.reshape(-1, 3), faces.ravel(), len(vertices))[faces]

    pseudonormals = np.concatenate(
        [normal[:, None], of_edges.reshape(-1, 3, 3), of_vertices], axis=1
    )
    lengths = np.linalg.norm(pseudonormals, axis=2, keepdims=True)
    # where a surface is folded back onto itself the normals cancel
    pseudonormals = np.where(lengths > 1e-12, pseudonormals, normal[:, None])
    corner, ab, ac = (np.ascontiguousarray(part.T) for part in (a, b - a, c - a))
    return Triangles(corner, ab, ac, _units(pseudonormals))


# ------------------------------------------------------------------------------------ the grid
def _built(surface: Surface) -> NearestFaces:
    if not surface.closed:
        raise MeshError(
            'mesh is not closed, so that it has no inside: fill its holes, and let all its '
            'triangles be seen anticlockwise from outside'
        )
    triangles = make_triangles(surface)
    corners = surface.vertices[surface.faces]
    low, high = corners.min(axis=(0, 1)), corners.max(axis=(0, 1))
    area = 0.5 * np.linalg.norm(np.cross(triangles.ab, triangles.ac, axis=0), axis=0).sum()
    typical_edge = np.sqrt(4 / 3**0.5 * area / len(corners))
    longest = (high - low).max()
    cell = float(np.clip(typical_edge, longest / MOST_CELLS, longest / FEWEST_CELLS))
    grid = grid_around(low, high, cell, MARGIN)
    centres = grid.centres()

    search = Samples(corners, 1.5 * cell)
    diagonal = 3**0.5 * cell
    reach = diagonal + search.radius
    # from a sample: not less than from the surface
    from_sample = search.tree.query(centres, distance_upper_bound=reach)[0]
    near = np.isfinite(from_sample)
    count = np.ones(len(centres), dtype=np.int64)
    far_faces = _face_of_far_cells(centres[~near], search, triangles)
    near_faces, near_bound, count[near] = _faces_of_near_cells(
        centres[near], from_sample[near], diagonal, search, triangles
    )
    of_near = np.repeat(near, count)
    faces = np.empty(len(of_near), dtype=np.int32)
    faces[of_near], faces[~of_near] = near_faces, far_faces
    bound = np.zeros(len(faces), dtype=np.float32)
    bound[of_near] = near_bound
    first_face = faces[np.cumsum(count) - count]
    level = np.concatenate(
        [
            triangles.signed_distance(block.T, face)[0]
            for block, face in zip(_blocks(centres), _blocks(first_face), strict=True)
        ]
    )
    level[~near] = np.copysign(np.inf, level[~near])
    level = _same_in_each_part(np.clip(level, -diagonal, diagonal).reshape(grid.shape))

    padded_count = np.pad(count.reshape(grid.shape), 1).ravel()
    first = np.concatenate([[0], np.cumsum(padded_count)])
    nearest_face = np.full(len(padded_count), -1, dtype=np.int32)
    nearest_face[padded_count > 0] = first_face
    return NearestFaces(
        triangles,
        low,
        high,
        grid.with_border(),
        first,
        faces,
        bound,
        nearest_face,
        np.pad(level, 1, constant_values=0.0).ravel(),
    )


class Samples:
    """Points on all triangles, so close that each triangle is within `radius` of its own."""

    def __init__(self, corners: np.ndarray, spacing: float) -> None:
        pieces, parents = _split(corners, spacing)
        samples = pieces.mean(axis=1)
        self.radius = float(np.linalg.norm(pieces - samples[:, None], axis=2).max())
        self.tree = cKDTree(samples)
        self.parent = parents


def _split(corners: np.ndarray, longest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the triangles (m, 3, 3), their edges halved until none is too long; and parents."""
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


def _face_of_far_cells(centres: np.ndarray, samples: Samples, triangles: Triangles) -> np.ndarray:
    """Return the face (k,) nearest to each centre, of those of the nearest samples."""
    if not len(centres):
        return np.zeros(0, dtype=np.int64)
    few = min(4, samples.tree.n)
    _, nearest = samples.tree.query(centres, k=list(range(1, few + 1)))
    faces = samples.parent[nearest]
    square = triangles.closest(np.repeat(centres.T, few, axis=1), faces.ravel())[0]
    best = square.reshape(faces.shape).argmin(axis=1)
    return faces[np.arange(len(faces)), best]


def _faces_of_near_cells(
    centres: np.ndarray,
    bound: np.ndarray,
    diagonal: float,
    search: Samples,
    triangles: Triangles,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    Return the faces that can be nearest to a point of each cell, nearest first.

    And lower bounds of their distances from the centre, and how many each cell has.

    A face that is nearest to a point of a cell is not further from the centre than the nearest
    face of the centre and a diagonal. `bound` (k,) is not less than the distance of the latter.
    """
    faces, bounds, counts = [], [], []
    for start in range(0, len(centres), BLOCK):
        block = centres[start : start + BLOCK]
        radius = bound[start : start + BLOCK] + diagonal + search.radius
        found = search.tree.query_ball_point(block, radius, return_sorted=False)
        count = np.fromiter(map(len, found), np.int64, len(found))
        samples = np.fromiter(chain.from_iterable(found), np.int64, count.sum())
        cell = np.repeat(np.arange(len(block)), count)
        # several samples may be of the same face
        links = coo_array(
            (np.ones(len(cell), dtype=bool), (cell, search.parent[samples])),
            shape=(len(block), triangles.corner.shape[1]),
        ).tocsr()
        count, face = np.diff(links.indptr), links.indices
        cell = np.repeat(np.arange(len(block)), count)
        distance = np.sqrt(triangles.closest(block.T[:, cell], face)[0])
        least = np.minimum.reduceat(distance, links.indptr[:-1])
        kept = np.flatnonzero(distance <= (least + diagonal)[cell])
        kept = kept[np.lexsort((distance[kept], cell[kept]))]
        faces.append(face[kept])
        bounds.append(distance[kept] * (1.0 - 1e-6))
        counts.append(np.bincount(cell[kept], minlength=len(block)))
    return np.concatenate(faces), np.concatenate(bounds), np.concatenate(counts)


def _same_in_each_part(level: np.ndarray) -> np.ndarray:
    """Return the levels with connected far cells on the same side: that of most of them."""
    far = np.abs(level) == np.abs(level).max()
    parts, number = ndimage.label(far)
    votes = ndimage.sum_labels(np.sign(level), parts, np.arange(number + 1))
    return np.where(far, np.copysign(level, votes[parts]), level)


# ------------------------------------------------------------------------------------- arithmetic
def _blocks(values: np.ndarray) -> list[np.ndarray]:
    return [values[start : start + BLOCK] for start in range(0, len(values), BLOCK)]


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum('ik,ik->k', a, b)


def _ratio(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return part / np.where(whole != 0.0, whole, 1.0)


def _units(vectors: np.ndarray) -> np.ndarray:
    lengths = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(lengths > 0.0, lengths, 1.0)
