# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Contact problems for tests of the solver, and the same operator as a dense matrix."""

import numpy as np

from softbody_ros.core.compiled import kernel
from softbody_ros.core.contact.newton import INNER, descend, majorise, minimise
from softbody_ros.core.contact.problem import Problem, find_diagonals, sum_forces
from softbody_ros.core.contact.rows import ROW
from softbody_ros.core.contact.solver import STEPS, solve, sweep, update_discs
from softbody_ros.core.lanes import LANES

RIGID, LINEAR, QUADRATIC = 6, 15, 33


def width(modes):
    """Return the room for the amplitudes of so many modes."""
    return -(-modes // LANES) * LANES


@kernel
def updated_discs(rows: np.ndarray, extrapolates: bool) -> None:
    """Update the friction discs of rows (k,) ROW."""
    update_discs(rows, extrapolates)


@kernel
def solve_all(rows, jacobian, counts, mobility, modes, shifts, hessian, filled, tolerance, result):
    problem = Problem(rows, jacobian, counts, mobility, modes, shifts, hessian, filled)
    is_rough = result[0] > 0.0
    residual, sweeps, steps = solve(problem, tolerance, 1.0, STEPS, False, is_rough)
    result[0], result[1], result[2] = residual, sweeps, steps


@kernel
def step_all(rows, jacobian, counts, mobility, modes, shifts, hessian, filled, tolerance, kind):
    problem = Problem(rows, jacobian, counts, mobility, modes, shifts, hessian, filled)
    find_diagonals(problem)
    sum_forces(problem)
    majorise(problem, np.empty(len(mobility)))
    if kind[0] == 0.0:
        minimise(problem, tolerance * tolerance, INNER)
    elif kind[0] == 1.0:
        descend(problem, np.empty((5, len(rows), 3)))
    else:
        sweep(problem, np.arange(len(rows)))


class Case:
    """
    A contact problem of bodies with given numbers of modes.

    Parameters
    ----------
    counts : (m,)
        of modes
    mobility : (p,)
        g of particles
    stiffer : (p, 3), optional
        K of forces on them, of each body by itself: K = S k

    """

    def __init__(self, counts, mobility=(), stiffer=None):
        self.counts = np.array(counts, np.int64)
        self.mobility = np.array(mobility, np.float64)
        self.stiffer = np.zeros((len(self.mobility), 3)) if stiffer is None else stiffer
        self.rows, self.jacobian = [], []
        self.modes = self.shifts = np.zeros(0)

    def add(self, one, j_one, two=-1, j_two=None, shares=(), frame=None, **values):
        """Add a contact: J (3, M) of both sides, shares by particle, and fields of its row."""
        row = np.zeros((), ROW)
        row['one'], row['two'], row['viscosity'], row['obstacle'] = one, two, -1.0, -1
        row['softness'] = 1.0
        frame = np.eye(3) if frame is None else frame
        row['normal'], row['tangents'] = frame[0], frame[1:]
        for corner, (particle, share) in enumerate(shares):
            row['particles'][corner], row['shares'][corner] = particle, share
        for name, value in values.items():
            row[name] = value
        jacobian = np.zeros((2, 3, width(max(self.counts, default=RIGID)) + 1))
        jacobian[0, :, : j_one.shape[-1]] = j_one
        if two >= 0:
            jacobian[1, :, : j_two.shape[-1]] = j_two
        for particle, share in shares:
            side, member = (0, one) if share > 0.0 else (1, two)
            if self.counts[member] > RIGID:
                last = width(self.counts[member])
                jacobian[side, :, last] += share * frame @ self.stiffer[particle]
        self.rows.append(row)
        self.jacobian.append(jacobian)

    def pin(self, one, j_one, shares=(), **values):
        self.add(one, j_one, shares=shares, base=(np.inf, 0.0, 0.0), friction=np.inf, **values)

    def freeze(self):
        if isinstance(self.rows, list):
            self.rows = np.array(self.rows, ROW)
            self.jacobian = np.array(self.jacobian).reshape(
                len(self.rows), 2, 3, width(max(self.counts, default=RIGID)) + 1
            )

    def solve(self, tolerance=1e-11, is_large=False, is_rough=False):
        """Solve; return the residual, and numbers of sweeps and steps."""
        result = np.array([float(is_rough), 0.0, 0.0])
        solve_all(*self.arguments(0 if is_large else len(self.counts)), tolerance, result)
        return result

    def step(self, kind):
        """Take one step: of Newton's method (0), of conjugate gradients (1), or a sweep (2)."""
        step_all(*self.arguments(len(self.counts)), 1e-12, np.array([float(kind)]))

    def arguments(self, factored):
        self.freeze()
        members, most = len(self.counts), max(self.counts, default=RIGID)
        self.modes = np.zeros((3, members, self.jacobian.shape[-1]))
        self.shifts = np.zeros((2, 3, len(self.mobility)))
        return (
            self.rows, self.jacobian.reshape(-1, self.jacobian.shape[3]), self.counts,
            self.mobility, self.modes, self.shifts,
            np.zeros((factored, factored, most, most)), np.zeros((factored, factored), np.bool_),
        )  # fmt: skip

    def operator(self):
        """Return W + c, (3 k, 3 k), assembled independently."""
        self.freeze()
        count, most = len(self.rows), max(self.counts, default=RIGID)
        modes = np.zeros((count, 3, len(self.counts), most))
        shares = np.zeros((count, 3, len(self.mobility), 3))
        owners = np.full(len(self.mobility), -1)
        compliance = np.zeros((count, 3))
        for k, row in enumerate(self.rows):
            modes[k, :, row['one'], : self.counts[row['one']]] = self.jacobian[
                k, 0, :, : self.counts[row['one']]
            ]
            if row['two'] >= 0:
                modes[k, :, row['two'], : self.counts[row['two']]] += self.jacobian[
                    k, 1, :, : self.counts[row['two']]
                ]
            frame = np.vstack([row['normal'], row['tangents']])
            for particle, share in zip(row['particles'], row['shares'], strict=True):
                if share != 0.0:
                    shares[k, :, particle] += share * frame
                    owners[particle] = row['one'] if share > 0.0 else row['two']
            compliance[k] = row['compliance'][[0, 1, 1]]
        modes = modes.reshape(3 * count, -1)
        shares = shares.reshape(3 * count, -1)
        each = np.diag(np.repeat(self.mobility, 3))
        for member in range(len(self.counts)):
            own = np.where((owners == member)[:, None], self.stiffer, 0.0).ravel()
            each -= np.outer(own, own)
        return modes @ modes.T + shares @ each @ shares.T + np.diag(compliance.ravel())

    def slips(self):
        force = self.rows['force'].ravel()
        return (self.rows['bias'].ravel() + self.operator() @ force).reshape(-1, 3)

    def check(self, scale=1.0):
        """Assert the laws of all rows; slips are exact to 1e-9 of a scale."""
        rows, s = self.rows, self.slips()
        bilateral = np.isinf(rows['base'][:, 0])
        assert np.isfinite(rows['force']).all()
        assert np.abs(s[bilateral]).max(initial=0.0) < 1e-9 * scale
        rows, s = rows[~bilateral], s[~bilateral]
        if len(rows) == 0:
            return
        total = rows['base'] + rows['force']
        assert total[:, 0].min() >= 0.0
        assert s[:, 0].min() > -1e-9 * scale
        largest = np.abs(total).max(initial=1.0)
        acting = total[:, 0] > 1e-9 * largest
        assert np.abs(s[acting, 0]).max(initial=0.0) < 1e-9 * scale
        size = np.linalg.norm(total[:, 1:], axis=1)
        with np.errstate(invalid='ignore'):
            limit = np.where(total[:, 0] > 0.0, rows['friction'] * total[:, 0], 0.0)
        assert (size <= limit + 1e-12 * largest).all()
        slip = np.linalg.norm(s[:, 1:], axis=1)
        assert slip[size < (1.0 - 1e-6) * limit - 1e-9 * largest].max(initial=0.0) < 1e-9 * scale
        sliding = slip > 1e-9 * scale
        against = (total[sliding, 1:] * s[sliding, 1:]).sum(axis=1)
        error = np.abs(against + size[sliding] * slip[sliding])
        assert (error <= 1e-9 * scale * largest).all()
        assert np.abs(size - limit)[sliding].max(initial=0.0) < 1e-6 * largest


def frame_of(normal):
    """Return a normal and two tangents as rows."""
    normal = np.asarray(normal) / np.linalg.norm(normal)
    one = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    one /= np.linalg.norm(one)
    return np.array([normal, one, np.cross(normal, one)])


class Body:
    """A box of particles with the modes of shape matching, for a force that acts over a tick."""

    def __init__(self, points, mass=1.0, features=0, soft=1.0, residual=0.3):
        """
        Take particles of equal mass, and compliances relative to the free ones.

        Parameters
        ----------
        points : (n, 3)
        features : int
            3 (linear) or 9 (quadratic): of modes that a goal follows; or 0
        soft : float
            compliance of these modes, relative to that of a free body
        residual : float
            the same of single particles

        """
        self.points, self.mass, self.features = points, mass, features
        self.residual = residual if features else 0.0
        self.soft = soft if features else 0.0
        q = points - points.mean(axis=0)
        columns = [q, q**2, q * np.roll(q, -1, axis=1)]
        f = np.hstack(columns)[:, :features]
        f = f - f.mean(axis=0)
        gram = f.T @ f / len(q)
        self.psi = np.zeros((len(q), 0))
        if features:
            values, vectors = np.linalg.eigh(gram)
            kept = values > 1e-9 * values.max()
            self.psi = np.zeros((len(q), features))
            self.psi[:, kept] = f @ (vectors[:, kept] / np.sqrt(values[kept]))
        self.q = q
        inertia = (q**2).sum() / len(q) * np.eye(3) - q.T @ q / len(q)
        self.root = np.linalg.cholesky(np.linalg.inv(inertia))
        # moments of features with offsets: turning by a force turns these modes, too
        self.moments = np.einsum('ni,nf->if', q, self.psi) / len(q)
        self.count = RIGID + 3 * features
        self.mobility = np.full(len(q), self.residual * len(q) / mass)

    def stiffer(self, share, direction=None):
        """Return k (n, 3) that takes away a share of displacements along one, or the volume."""
        if not self.residual > 0.0:
            return np.zeros(self.q.shape)
        along = outwards(self.q) if direction is None else direction
        return np.sqrt(share) * along / np.linalg.norm(along / np.sqrt(self.mobility)[:, None])

    def modes_at(self, point, psi, frame, sign=1.0):
        """Return J (3, M) of a force at a point along three directions."""
        rows = []
        for e in frame:
            c = np.sqrt((1.0 - self.residual) / self.mass)
            turn = self.root.T @ np.cross(point, e)
            theta = self.root @ turn
            followed = np.outer(e, psi) - np.cross(theta, self.moments.T).T
            d = np.sqrt(max(self.soft - self.residual, 0.0) / self.mass)
            rows.append(np.concatenate([c * e, c * turn, d * followed.ravel()]))
        return sign * np.array(rows)

    def at(self, weights, frame, sign=1.0):
        """Return J of a force that is shared by particles: {particle: λ}."""
        point = sum(w * self.q[i] for i, w in weights.items())
        psi = sum(w * self.psi[i] for i, w in weights.items())
        return self.modes_at(point, psi, frame, sign)


def outwards(points):
    """Return directions outwards at the surface of a cube, half edge 1; (n, 3)."""
    return np.where(np.abs(points) > 1.0 - 1e-9, np.sign(points), 0.0)


def grid_cube(n, size=1.0):
    """Return the surface grid of a cube of n × n particles a face, half edge `size`."""
    axis = np.linspace(-size, size, n)
    points = np.array(np.meshgrid(axis, axis, axis, indexing='ij')).reshape(3, -1).T
    return points[np.abs(points).max(axis=1) > size * (1.0 - 1e-9)]


def corners_on(body, height, point):
    """Return {particle: λ} of the triangle, of the grid at a height of a body, with a point."""
    chosen = np.flatnonzero(np.abs(body.q[:, 2] - height) < 1e-9)
    flat = body.q[chosen][:, :2]
    axis = np.unique(np.round(flat[:, 0], 9))
    step = axis[1] - axis[0]
    low = np.clip(np.floor((point - axis[0]) / step + 1e-9), 0, len(axis) - 2).astype(int)
    a, b = (point - axis[low]) / step
    nodes = [(0, 0), (1, 0), (1, 1)] if a >= b else [(0, 0), (0, 1), (1, 1)]
    shares = [1.0 - a, a - b, b] if a >= b else [1.0 - b, b - a, a]
    result = {}
    for (i, j), share in zip(nodes, shares, strict=True):
        where = axis[low[0] + i], axis[low[1] + j]
        index = chosen[np.argmin(np.abs(flat - where).sum(axis=1))]
        if share > 1e-12:
            result[index] = share
    return result


def stack(
    n=9, ratio=1.0, features=9, soft=1.0, residual=0.3, shift=0.03, friction=0.5, stiffer=0.0
):
    """
    Return two cubes on the ground, one upon the other: contacts of each with a face of the other.

    Parameters
    ----------
    n : int
        particles along an edge
    ratio : float
        of the masses, the upper one being heavier
    shift : float
        of the upper cube, relative to its half edge
    stiffer : float
        share of the particles' response to changes of volume that is taken away

    """
    lower = Body(grid_cube(n), 1.0, features, soft, residual)
    upper = Body(grid_cube(n), ratio, features, soft, residual)
    case = Case(
        [lower.count, upper.count], np.concatenate([lower.mobility, upper.mobility]),
        np.concatenate([lower.stiffer(stiffer), upper.stiffer(stiffer)]),
    )  # fmt: skip
    first, frame = len(lower.q), frame_of((0.0, 0.0, 1.0))
    offset, facts = np.array([shift, 0.4 * shift]), {'friction': friction}
    sag, slide = 1e-3, (2e-4, 1e-4)
    own = residual > 0.0 and features > 0
    stiff = {} if own else {'compliance': 1e-3}
    for i in np.flatnonzero(lower.q[:, 2] < -1.0 + 1e-9):
        case.add(
            0, lower.at({i: 1.0}, frame), shares=[(i, 1.0)] if own else (),
            frame=frame, bias=(-sag, 0.0, 0.0), **facts, **stiff,
        )  # fmt: skip
    for i in np.flatnonzero(upper.q[:, 2] < -1.0 + 1e-9):
        at = upper.q[i, :2] + offset
        if np.abs(at).max() <= 1.0:
            corners = corners_on(lower, 1.0, at)
            shares = [(first + i, 1.0), *((j, -w) for j, w in corners.items())]
            case.add(
                1, upper.at({i: 1.0}, frame), 0, lower.at(corners, frame, -1.0),
                shares=shares if own else (), frame=frame, bias=(-sag * 0.5, *slide),
                **facts, **stiff,
            )  # fmt: skip
    for i in np.flatnonzero(lower.q[:, 2] > 1.0 - 1e-9):
        at = lower.q[i, :2] - offset
        if np.abs(at).max() <= 1.0:
            corners = corners_on(upper, -1.0, at)
            shares = [(i, 1.0), *((first + j, -w) for j, w in corners.items())]
            case.add(
                0, lower.at({i: 1.0}, -frame), 1, upper.at(corners, -frame, -1.0),
                # exactly the negative frame, so that twins are the same row
                shares=shares if own else (), frame=-frame, bias=(-sag * 0.5, *slide),
                **facts, **stiff,
            )  # fmt: skip
    case.freeze()
    return case
