# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Embedded surfaces: a fine one, for pictures, is carried by the coarse one that is simulated.

A point P of the embedded surface belongs to the nearest point C of the simulated one at rest, with
barycentric coordinates b in a triangle of vertices X_k, and stays where the triangle and the
deformation gradients F_k of its corners take it:

    p = Σ b_k [x_k + F_k (P − C + ½ (C − X_k))].

The factor ½ makes the interpolation of gradients exact for quadratic deformations, as Phong
tessellation has it for normals. Vertices and their gradients are shared by the triangles around
them, so p is continuous in P wherever C is, whatever the simulated vertices do.

The gradient of a vertex fits its edges, e to e', and its unit normal n to a vector m (the fourth
point of Sumner and Popović), by least squares:

    F = argmin Σ |F e − e'|² / |e|² + μ |F n − m|².

Along the surface that is all there is to know. Across it, m is what the affine map A that fits the
whole body best makes of n, turned as the normals are turned against A; as far as A does not
explain the edges, it is the normal. So rigid and affine deformations are reproduced exactly, and
bodies that fold keep the thickness of what lies on their surface.

M. Müller, B. Heidelberger, M. Teschner, M. Gross: Meshless deformations based on shape matching,
    SIGGRAPH 2005: A is their eq. 7, without the rotation taken out.
R. W. Sumner, J. Popović: Deformation transfer for triangle meshes, SIGGRAPH 2004, section 3.
T. Boubekeur, M. Alexa: Phong tessellation, SIGGRAPH Asia 2008.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.compiled import kernel
from softbody_ros.core.geometry.bvh import Trees, closest_face, make_tree
from softbody_ros.core.geometry.surface import MeshError, Surface, vertex_normals
from softbody_ros.core.geometry.vectors import (
    NO_MATRIX,
    ZERO,
    added,
    along,
    applied,
    cofactors,
    cross,
    dot,
    matrix_of,
    minus,
    norm,
    outer,
    plus,
    product,
    put_vector,
    scaled,
    vector_of,
)
from softbody_ros.core.shape_matching.polar_decomposition import rotation_of
from softbody_ros.core.shape_matching.rest_shape import area_shares, pseudo_inverse

TANGENTIAL = 0.5
"""Share of the first-order term along the surface, see the module."""
THIN = 1e-4
"""det M / (tr M / 3)³ of the edges around a vertex below which they do not span a gradient."""
OPPOSITE = 1e-3
"""1 + the cosine of two normals below which no rotation between them is defined."""
TILE = 64
"""Vertices that are carried at a time."""
COLUMNS = 12
"""Numbers of a simulated vertex by which it carries others: x − ½ F X, the columns of F."""


class Rings(NamedTuple):
    """
    The neighbourhoods of n simulated vertices, as kernels take them; E edges, each twice.

    Attributes
    ----------
    rest : (n, 3) float
        positions at rest about their centre, m
    shares : (n,) float
        of the area
    fit : (6, 3) float
        pseudo-inverse of Σ w X Xᵀ, 1/m², and the projection on its null space
    faces : (f, 3) int
    first : (n + 1,) int
        where the edges of a vertex begin
    neighbour : (E,) int
        at the other end of each edge
    weight : (E,) float
        1 / |e|², 1/m²
    along_edge : (E, 3) float
        what F takes of e': F = Σ e' cᵀ + …, 1/m
    across : (n, 3) float
        … + m cᵀ …
    rest_of_it : (n, 3, 3) float
        … + A E, where the edges do not span a gradient
    normal : (n, 3) float
        sums of twice the area vectors of the faces at rest, m²

    """

    rest: np.ndarray
    shares: np.ndarray
    fit: np.ndarray
    faces: np.ndarray
    first: np.ndarray
    neighbour: np.ndarray
    weight: np.ndarray
    along_edge: np.ndarray
    across: np.ndarray
    rest_of_it: np.ndarray
    normal: np.ndarray


class Embedding:
    """
    A surface of k vertices that a simulated one of n vertices carries.

    Parameters
    ----------
    simulated, visual : Surface
        in the same frame

    Attributes
    ----------
    visual : Surface
        the embedded surface at rest
    corners : (k, 3) int
        the simulated vertices that carry each vertex of it
    weights : (k, 3) float
        their barycentric coordinates, which sum to 1

    Raises
    ------
    MeshError
        if one of them has no triangles.

    """

    def __init__(self, simulated: Surface, visual: Surface) -> None:
        if not len(simulated.faces):
            raise MeshError(
                'mesh cannot be carried: the simulated one is a cloud of points, not triangles'
            )
        if not len(visual.faces):
            raise MeshError('mesh is a cloud of points: give triangles, by which it is shown')
        self.visual = visual
        tree = make_tree(simulated)
        count = len(visual.vertices)
        face, nearest = np.zeros(count, np.int64), np.zeros((count, 3))
        find_nearest(tree.arrays, visual.vertices, face, nearest)
        self.corners = simulated.faces[face]
        self.weights = _barycentric(simulated.vertices[self.corners], nearest)
        self._rings = _rings(simulated)
        carriers = (self.weights[:, :, None] * self._rings.rest[self.corners]).sum(axis=1)
        # P − C + ½ C, and − ½ X_k in the place of a vertex
        middle = simulated.vertices[0] - self._rings.rest[0]
        offsets = visual.vertices - middle - (1.0 - TANGENTIAL) * carriers
        self._order = np.argsort(face, kind='stable')
        self._first = np.searchsorted(face[self._order], np.arange(len(simulated.faces) + 1))
        columns = np.concatenate([self.weights, offsets], axis=1)[self._order]
        self._columns = np.ascontiguousarray(columns.T)

    def positions(self, simulated: np.ndarray) -> np.ndarray:
        """
        Return the positions (k, 3) of the embedded surface, m.

        Parameters
        ----------
        simulated : (n, 3) float
            positions of the simulated vertices, m

        """
        x = np.ascontiguousarray(simulated, dtype=np.float64)
        table = np.empty((len(x), COLUMNS))
        put_gradients(x, self._rings, np.zeros((len(x), 3)), table)
        result = np.empty((len(self.corners), 3))
        carry(table, self._rings.faces, self._first, self._order, self._columns, result)
        return result

    def values(self, simulated: np.ndarray) -> np.ndarray:
        """Return values (k,) at the embedded surface, interpolated from simulated ones (n,)."""
        return np.asarray((self.weights * simulated[self.corners]).sum(axis=1))


# -------------------------------------------------------------------------------------------- rest
@kernel
def find_nearest(trees: Trees, points: np.ndarray, face: np.ndarray, nearest: np.ndarray) -> None:
    """Write the faces (k,) of tree 0 nearest to points (k, 3), and the places (k, 3) there, m."""
    for i in range(len(points)):
        point = vector_of(points[i])
        row, _, offset, _ = closest_face(trees, 0, point, np.inf)
        face[i] = trees[2][max(row, 0)]['index']
        put_vector(nearest[i], minus(point, offset))


def _barycentric(corners: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the coordinates (k, 3) of points (k, 3) in triangles (k, 3, 3), 0 … 1, m."""
    ab, ac = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    ap = points - corners[:, 0]
    abab, abac, acac = _dots(ab, ab), _dots(ab, ac), _dots(ac, ac)
    abap, acap = _dots(ab, ap), _dots(ac, ap)
    area = abab * acac - abac * abac
    flat = area <= 1e-20 * (abab + acac) ** 2  # rounding
    with np.errstate(divide='ignore', invalid='ignore'):
        v = np.where(flat, 0.0, (acac * abap - abac * acap) / area)
        w = np.where(flat, 0.0, (abab * acap - abac * abap) / area)
    result = np.clip(np.stack([1.0 - v - w, v, w], axis=1), 0.0, 1.0)
    return result / result.sum(axis=1, keepdims=True)


def _rings(surface: Surface) -> Rings:
    vertices, faces = surface.vertices, surface.faces.astype(np.int64)
    count = len(vertices)
    shares = area_shares(surface)
    rest = vertices - (shares[:, None] * vertices).sum(axis=0)
    gram = np.array([[(shares * p * q).sum() for p in rest.T] for q in rest.T])

    ends = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    keys = np.unique(np.concatenate([ends[:, 0] * count + ends[:, 1],
                                     ends[:, 1] * count + ends[:, 0]]))  # fmt: skip
    one, other = keys // count, keys % count
    edges = rest[other] - rest[one]
    lengths = _dots(edges, edges)
    weight = np.divide(1.0, lengths, out=np.zeros(len(edges)), where=lengths > 0.0)

    normal = vertex_normals(vertices, faces)
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    unit = np.divide(normal, size, out=np.zeros_like(normal), where=size > 0.0)
    mu = 0.5 * np.bincount(one, minlength=count)
    spread = mu[:, None, None] * unit[:, :, None] * unit[:, None]
    for row in range(3):
        for column in range(3):
            products = weight * edges[:, row] * edges[:, column]
            spread[:, row, column] += np.bincount(one, products, minlength=count)
    inverse = _inverses(spread)
    along_edge = weight[:, None] * np.einsum('ijk,ik->ij', inverse[one], edges)
    across = mu[:, None] * np.einsum('ijk,ik->ij', inverse, unit)
    spanned = unit[:, :, None] * across[:, None]
    for row in range(3):
        for column in range(3):
            products = edges[:, row] * along_edge[:, column]
            spanned[:, row, column] += np.bincount(one, products, minlength=count)
    return Rings(
        rest=rest,
        shares=shares,
        fit=np.concatenate(pseudo_inverse(gram)),
        faces=faces,
        first=np.searchsorted(one, np.arange(count + 1)),
        neighbour=other,
        weight=weight,
        along_edge=along_edge,
        across=across,
        rest_of_it=np.eye(3) - spanned,
        normal=normal,
    )


def _inverses(matrices: np.ndarray) -> np.ndarray:
    """Return the inverses of symmetric matrices (n, 3, 3), zeros of those nearly singular."""
    rows = [matrices[:, row] for row in range(3)]
    cofactor = np.stack([np.cross(rows[i - 2], rows[i - 1]) for i in range(3)], axis=1)
    determinant = _dots(rows[0], cofactor[:, 0])
    trace = np.trace(matrices, axis1=1, axis2=2)
    regular = determinant > THIN * (trace / 3.0) ** 3
    factor = np.divide(1.0, determinant, out=np.zeros(len(matrices)), where=regular)
    return factor[:, None, None] * cofactor.transpose(0, 2, 1)


def _dots(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]


# ------------------------------------------------------------------------------------------ motion
@kernel
def put_gradients(x: np.ndarray, rings: Rings, normals: np.ndarray, table: np.ndarray) -> None:
    """
    Write what simulated vertices carry others by.

    Parameters
    ----------
    x : (n, 3) float
        positions, m
    rings : Rings
    normals : (n, 3) float
        zeros
    table : (n, 12) float
        of each vertex x − ½ F X, m, and the columns of its deformation gradient F

    """
    centre = ZERO
    for i in range(len(x)):
        centre = along(centre, rings.shares[i], vector_of(x[i]))
    moment = NO_MATRIX
    for i in range(len(x)):
        arm = scaled(rings.shares[i], minus(vector_of(x[i]), centre))
        moment = added(moment, outer(arm, vector_of(rings.rest[i])))
    # of sheets the fit says nothing across them: there it is the rotation
    affine = product(moment, matrix_of(rings.fit[:3]))
    affine = added(affine, product(rotation_of(moment), matrix_of(rings.fit[3:])))
    cofactor = cofactors(affine)

    for k in range(len(rings.faces)):
        a, b, c = rings.faces[k, 0], rings.faces[k, 1], rings.faces[k, 2]
        origin = vector_of(x[a])
        area = cross(minus(vector_of(x[b]), origin), minus(vector_of(x[c]), origin))
        for corner in range(3):
            normal = normals[rings.faces[k, corner]]
            put_vector(normal, plus(vector_of(normal), area))

    for i in range(len(x)):
        place, rest = vector_of(x[i]), vector_of(rings.rest[i])
        gradient = product(affine, matrix_of(rings.rest_of_it[i]))
        unexplained, total = 0.0, 0.0
        for k in range(rings.first[i], rings.first[i + 1]):
            other = rings.neighbour[k]
            edge = minus(vector_of(x[other]), place)
            predicted = applied(affine, minus(vector_of(rings.rest[other]), rest))
            error = minus(edge, predicted)
            unexplained += rings.weight[k] * dot(error, error)
            total += rings.weight[k] * dot(edge, edge)
            gradient = added(gradient, outer(edge, vector_of(rings.along_edge[k])))
        at_rest = vector_of(rings.normal[i])
        length, now = norm(at_rest), norm(vector_of(normals[i]))
        turned = applied(cofactor, at_rest)
        expected = norm(turned)
        if length > 0.0:
            image = scaled(1.0 / length, applied(affine, at_rest))
            if now > 0.0:
                unit = scaled(1.0 / now, vector_of(normals[i]))
                share = 0.0
                if unexplained < total and expected > 0.0:
                    turned = scaled(1.0 / expected, turned)
                    # the least rotation that takes one normal to the other
                    nearness = 1.0 + dot(turned, unit)
                    if nearness > OPPOSITE:
                        share = 1.0 - unexplained / total
                        axis = cross(turned, unit)
                        once = cross(axis, image)
                        image = plus(image, along(once, 1.0 / nearness, cross(axis, once)))
                image = plus(scaled(share, image), scaled(1.0 - share, unit))
            gradient = added(gradient, outer(image, vector_of(rings.across[i])))
        put_vector(table[i, :3], along(place, -TANGENTIAL, applied(gradient, rest)))
        for column in range(3):
            for line in range(3):
                table[i, 3 + 3 * column + line] = gradient[line][column]


@kernel
def carry(
    table: np.ndarray,
    faces: np.ndarray,
    first: np.ndarray,
    order: np.ndarray,
    columns: np.ndarray,
    result: np.ndarray,
) -> None:
    """
    Write the positions (k, 3) of an embedded surface, m.

    Face by face, whose vertices have the same corners: so one loop is over neighbours in memory,
    and makes several of them at a time.

    Parameters
    ----------
    table : (n, 12) float
        of `put_gradients`
    faces : (f, 3) int
        of the simulated surface
    first : (f + 1,) int
        where the vertices that belong to each face begin
    order : (k,) int
        the numbers of the vertices, face by face
    columns : (6, k) float
        of these barycentric coordinates, and P − ½ C from the centre at rest, m
    result : (k, 3) float

    """
    places = np.empty((3, TILE))
    for face in range(len(faces)):
        a, b, c = table[faces[face, 0]], table[faces[face, 1]], table[faces[face, 2]]
        for begin in range(first[face], first[face + 1], TILE):
            end = min(begin + TILE, first[face + 1])
            u, v, w = columns[0, begin:end], columns[1, begin:end], columns[2, begin:end]
            x, y, z = columns[3, begin:end], columns[4, begin:end], columns[5, begin:end]
            for axis in range(3):
                a0, a1, a2, a3 = a[axis], a[axis + 3], a[axis + 6], a[axis + 9]
                b0, b1, b2, b3 = b[axis], b[axis + 3], b[axis + 6], b[axis + 9]
                c0, c1, c2, c3 = c[axis], c[axis + 3], c[axis + 6], c[axis + 9]
                row = places[axis]
                for i in range(end - begin):
                    row[i] = (
                        u[i] * (a0 + a1 * x[i] + a2 * y[i] + a3 * z[i])
                        + v[i] * (b0 + b1 * x[i] + b2 * y[i] + b3 * z[i])
                        + w[i] * (c0 + c1 * x[i] + c2 * y[i] + c3 * z[i])
                    )
            for i in range(end - begin):
                vertex = order[begin + i]
                result[vertex, 0] = places[0, i]
                result[vertex, 1] = places[1, i]
                result[vertex, 2] = places[2, i]
