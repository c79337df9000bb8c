# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Contact of bodies with each other, and of the regions of one body.

As with obstacles, see `contact`: particles are stopped, with friction; weight is carried by bodies
as wholes; restitution is that of the bodies. What one body gets, the other gives, along the same
line, so momentum and angular momentum are conserved.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array

from softbody_ros.core import contact, rigid_motion, touch
from softbody_ros.core.crowd import Crowd, Source, make_crowd
from softbody_ros.core.dynamics import Flight
from softbody_ros.core.skin import Skin
from softbody_ros.core.touch import Boxes, Touches

ROUNDS, RIGID_ROUNDS = 4, 12
PUSH_OUT_ROUNDS = 3


def meet(flights: Sequence[Flight], skins: Sequence[Skin], obstacles=()) -> None:
    """
    Let bodies meet each other, in place.

    Parameters
    ----------
    flights : sequence of Flight
    skins : sequence of Skin
        of each flight

    """
    if not flights or (sum(len(f.batch.x) for f in flights) == 1 and skins[0].pieces == 1):
        return
    tick = flights[0].tick
    parts, first = [], 0
    for flight, skin in zip(flights, skins, strict=True):
        parts.append(touch.boxes(flight.particles.x, skin, flight.tick.gains.thickness, first))
        first += len(flight.batch.x)
    found = touch.joined(parts)
    strangers = [skin.strangers for f, skin in zip(flights, skins, strict=True) for _ in f.batch.x]
    a, b = touch.pairs(found, strangers)
    if not len(a):
        return
    crowd, number = _crowd(flights, skins, found, np.concatenate([a, b]))
    found = Boxes(found.low, found.high, number[found.body], found.piece)
    touches = touch.find(crowd, found, a, b)
    if not len(touches):
        return
    _respond(crowd, touches, tick.gravity, tick.h, obstacles)


def _crowd(flights, skins, found, involved) -> tuple[Crowd, np.ndarray]:
    counts = [len(flight.batch.x) for flight in flights]
    chosen = np.zeros(sum(counts), dtype=bool)
    chosen[found.body[involved]] = True
    number = np.cumsum(chosen) - 1
    sources, begin = [], 0
    for flight, skin, count in zip(flights, skins, counts, strict=True):
        rows = np.flatnonzero(chosen[begin : begin + count])
        if len(rows):
            sources.append(Source(flight, skin, rows, int(number[begin + rows[0]])))
        begin += count
    return make_crowd(sources), number


@dataclass(frozen=True)
class Meeting:
    touches: Touches
    pair: np.ndarray  # (k,)
    lower: np.ndarray  # (p,) bodies
    upper: np.ndarray
    sign: np.ndarray  # +1 where the particle is upper's
    arms: np.ndarray  # (k,3) of lower?
    point: np.ndarray


def _respond(crowd: Crowd, touches: Touches, gravity, h, obstacles=()) -> None:
    x, v = crowd.x, crowd.v
    k = len(touches)
    C = len(crowd)
    key = np.minimum(touches.body, touches.other) * C + np.maximum(touches.body, touches.other)
    keys, pair = np.unique(key, return_inverse=True)
    one, two = np.divmod(keys, C)
    P = len(keys)
    # normals from two to one
    sign = np.where(touches.body == one[pair], 1.0, -1.0)
    normal = sign[:, None] * touches.normal
    point = x[touches.particle]
    weight = crowd.weight[touches.particle]
    share = weight / np.bincount(pair, weight, P)[pair]
    mean = lambda values: np.bincount(pair, share * values, P)
    inv_mass = 1.0 / crowd.mass
    reduced = 1.0 / (inv_mass[one] + inv_mass[two])
    arm1, arm2 = point - crowd.centre[one[pair]], point - crowd.centre[two[pair]]
    omega = crowd.angular_velocity
    P0 = np.zeros((C, 3))
    L0 = np.zeros((C, 3))  # impulses

    def speeds(velocity, omega):
        rel = (
            velocity[one[pair]]
            - velocity[two[pair]]
            + rigid_motion.cross(omega[one[pair]], arm1)
            - rigid_motion.cross(omega[two[pair]], arm2)
        )
        return np.einsum('ij,ij->i', rel, normal)

    # rows
    cols = np.concatenate([touches.particle, touches.corners.T.ravel()])
    rows = np.tile(np.arange(k), 4)
    vals = np.concatenate([np.ones(k), -touches.share.T.ravel()])
    used, local = np.unique(cols, return_inverse=True)
    G = csr_array((vals, (rows, local)), shape=(k, len(used)))
    GT = G.T.tocsr()
    n_own = touches.normal

    def give(impulse):  # (k,3) on 'one' at point; minus on two
        nonlocal P0, L0
        out1 = np.stack(
            [
                np.bincount(one[pair], impulse[:, i], C) - np.bincount(two[pair], impulse[:, i], C)
                for i in range(3)
            ],
            1,
        )
        torque = rigid_motion.cross(point, impulse)
        out2 = np.stack(
            [
                np.bincount(one[pair], torque[:, i], C) - np.bincount(two[pair], torque[:, i], C)
                for i in range(3)
            ],
            1,
        )
        P0 += out1
        L0 += out2  # about the origin
        return out1, out2

    # --- carry
    goal_gap = np.einsum('ij,ij->i', (G @ crowd.goals[used]), n_own)
    sunk = np.maximum(
        crowd.thickness[touches.body] + crowd.thickness[touches.other] - goal_gap, 0.0
    )
    depth = mean(sunk)
    pn = np.stack([np.bincount(pair, share * normal[:, i], P) for i in range(3)], 1)
    pn /= np.maximum(np.linalg.norm(pn, axis=1), 1e-300)[:, None]
    load = loads(crowd, one, two, pn, gravity)
    scale = np.minimum(crowd.scale[one], crowd.scale[two])
    acc = load / reduced
    softness = np.maximum(contact.SINKAGE * scale, 4.0 * acc * h**2)
    spring = acc * -np.expm1(-depth / softness)
    damping = 2.0 * np.sqrt(acc / softness)
    speed = mean(speeds(crowd.velocity, omega))
    force = (spring - damping * speed) / (1.0 + damping * h)
    push = h * np.clip(force, 0.0, acc) * reduced
    pressure = sunk / np.where(depth > 0.0, depth, 1.0)[pair]
    carried = push[pair] * share * pressure
    out1, out2 = give(carried[:, None] * normal)
    dV = out1 * inv_mass[:, None]
    dOmega = rigid_motion.applied(
        crowd.inverse_inertia, (out2 - rigid_motion.cross(crowd.centre, out1)) * inv_mass[:, None]
    )
    body_of = np.repeat(np.arange(C), np.diff(crowd.first))
    lift = dV[body_of] + rigid_motion.cross(dOmega[body_of], x - crowd.centre[body_of])
    v += lift
    lift *= 0.5 * h
    x += lift
    # --- limit
    J1 = np.concatenate(
        [
            _sum(share[:, None] * normal, pair, P),
            _sum(share[:, None] * rigid_motion.cross(arm1, normal), pair, P),
        ],
        1,
    )
    J2 = np.concatenate(
        [
            _sum(share[:, None] * normal, pair, P),
            _sum(share[:, None] * rigid_motion.cross(arm2, normal), pair, P),
        ],
        1,
    )
    room = LIMIT * scale - depth
    rows_one, rows_two = one, two
    if obstacles:
        o1, on, oroom, osurf = _obstacle_rows(crowd, obstacles, h)
        J1 = np.concatenate([J1, o1])
        rows_one = np.concatenate([one, on])
        room = np.concatenate([room, oroom])
    Q = len(room)
    Vb = np.concatenate([crowd.velocity + dV, omega + dOmega], 1)
    Minv = np.zeros((C, 6, 6))
    Minv[:, :3, :3] = np.eye(3) * inv_mass[:, None, None]
    Minv[:, 3:, 3:] = crowd.inverse_inertia * inv_mass[:, None, None]
    col = lambda body: 6 * body[:, None] + np.arange(6)
    r = np.repeat(np.arange(Q), 6)
    r2 = np.repeat(np.arange(P), 6)
    Jm = csr_array(
        (
            np.concatenate([J1.ravel(), -J2.ravel()]),
            (
                np.concatenate([r, r2]),
                np.concatenate([col(rows_one).ravel(), col(rows_two).ravel()]),
            ),
        ),
        shape=(Q, 6 * C),
    )
    W1 = np.einsum('pij,pj->pi', Minv[rows_one], J1)
    W2 = np.einsum('pij,pj->pi', Minv[rows_two], J2)
    Wm = csr_array(
        (
            np.concatenate([W1.ravel(), -W2.ravel()]),
            (
                np.concatenate([col(rows_one).ravel(), col(rows_two).ravel()]),
                np.concatenate([r, r2]),
            ),
        ),
        shape=(6 * C, Q),
    )
    count = np.bincount(rows_one, minlength=C) + np.bincount(rows_two, minlength=C)
    kk = np.einsum('pi,pi->p', J1, W1) * count[rows_one]
    kk[:P] += np.einsum('pi,pi->p', J2, W2) * count[rows_two]
    target = -np.maximum(room, 0.0) / h
    vb = Vb.ravel().copy()
    lamb = np.zeros(Q)
    for _ in range(LIMIT_ROUNDS):
        new = np.maximum(lamb + OMEGA * (target - Jm @ vb) / kk, 0.0)
        vb += Wm @ (new - lamb)
        lamb = new
    dvb = vb.reshape(C, 6) - Vb
    limited = lamb[:P][pair] * share
    give(limited[:, None] * normal)
    # what obstacles give
    if obstacles:
        add = _sum(lamb[P:, None] * J1[P:, :3], rows_one[P:], C)
        P0 += add
        L0 += _sum(lamb[P:, None] * J1[P:, 3:], rows_one[P:], C) + rigid_motion.cross(
            crowd.centre, add
        )
    v += dvb[body_of, :3] + rigid_motion.cross(dvb[body_of, 3:], x - crowd.centre[body_of])
    dV = dV + dvb[:, :3]
    dOmega = dOmega + dvb[:, 3:]
    if PUSH:
        rr = np.zeros(Q)
        nn = np.zeros(6 * C)
        want = np.maximum(-room, 0.0) * PUSH
        for _ in range(LIMIT_ROUNDS):
            new = np.maximum(rr + OMEGA * (want - Jm @ nn) / kk, 0.0)
            nn += Wm @ (new - rr)
            rr = new
        nn = nn.reshape(C, 6)
        shift = nn[body_of, :3]
        x += shift
        lift += shift
    # --- particles
    inv = 1.0 / crowd.weight[used]
    cnt = np.diff(GT.indptr)
    K = G.power(2) @ (inv * cnt)
    vel = v[used]
    pos = x[used]
    gap = touches.depth - np.einsum('ij,ij->i', G @ lift[used], n_own)
    total = np.zeros(k)
    e_speed = speeds(crowd.velocity + dV, omega + dOmega)
    for _ in range(ROUNDS):
        u = np.einsum('ij,ij->i', G @ vel, n_own)
        lam = np.maximum(-u, 0.0) / K
        total += lam
        vel += inv[:, None] * (GT @ (lam[:, None] * n_own))
    give((sign * total)[:, None] * n_own)
    # friction
    rel = G @ vel
    rel -= np.einsum('ij,ij->i', rel, n_own)[:, None] * n_own
    f = np.sqrt(crowd.friction[touches.body] * crowd.friction[touches.other])
    J = -(f / K)[:, None] * rel
    coul = crowd.coulomb[touches.body] | crowd.coulomb[touches.other]
    if coul.any():
        size = np.linalg.norm(rel, axis=1)
        stop = np.minimum(f * (total + carried) * K / np.maximum(size, 1e-300), 1.0)
        J = np.where(coul[:, None], -(stop / K)[:, None] * rel, J)
    vel += inv[:, None] * (GT @ J)
    give(sign[:, None] * J)
    v[used] = vel
    for _ in range(PUSH_OUT_ROUNDS):
        lam = np.maximum(gap, 0.0) / K
        move = inv[:, None] * (GT @ (lam[:, None] * n_own))
        pos += move
        gap -= np.einsum('ij,ij->i', G @ move, n_own)
    x[used] = pos
    # --- rebound
    given = np.bincount(pair, total, P)
    V1 = crowd.velocity + dV
    g = max(float(np.linalg.norm(gravity)), 1e-300)
    settling = np.sqrt(g * contact.SINKAGE * scale)
    leaving = np.clip(
        (mean(speeds(V1, omega + dOmega)) + 0.5 * given / reduced) / settling - contact.SETTLED,
        0.0,
        1.0,
    )
    eps = np.sqrt(crowd.elasticity[one] * crowd.elasticity[two])
    lost = 0.5 * (1.0 - eps) * leaving
    absorbed = -lost[pair] * total
    out1, out2 = give(sign[:, None] * absorbed[:, None] * n_own)
    # --- momentum
    V = crowd.velocity + P0 * inv_mass[:, None]
    wx = crowd.weight[:, None] * x
    sums = lambda values: np.stack(
        [np.add.reduceat(values[:, i], crowd.first[:-1]) for i in range(3)], 1
    )
    c = sums(wx) * inv_mass[:, None]
    L_origin = (
        crowd.spin * crowd.mass[:, None]
        + crowd.mass[:, None] * rigid_motion.cross(crowd.centre, crowd.velocity)
        + L0
    )
    spin = L_origin * inv_mass[:, None] - rigid_motion.cross(c, V)
    arms = x - c[body_of]
    wv = crowd.weight[:, None] * v
    Vnow = sums(wv) * inv_mass[:, None]
    spin_now = sums(rigid_motion.cross(arms, wv)) * inv_mass[:, None]
    wa = crowd.weight[:, None] * arms
    gram = np.stack([sums(wa[:, i : i + 1] * arms) for i in range(3)], 1) * inv_mass[:, None, None]
    inertia = rigid_motion._inertia(gram)
    inverse = np.linalg.inv(inertia)
    dO = rigid_motion.applied(inverse, spin - spin_now)
    v += (V - Vnow)[body_of] + rigid_motion.cross(dO[body_of], arms)
    start = 0
    for source in crowd.sources:
        n = len(source.rows) * source.skin.rest.particle_count
        source.take(source.flight.particles.x, x[start : start + n])
        source.take(source.flight.particles.v, v[start : start + n])
        start += n
        b = slice(source.first, source.first + len(source.rows))
        m = source.flight.motion
        m.centre[source.rows] = c[b]
        m.velocity[source.rows] = V[b]
        m.spin[source.rows] = spin[b]
        m.inverse_inertia[source.rows] = inverse[b]
        source.flight.tick.load[source.rows] = out_load(dV, crowd, h)[b]


LIMIT, LIMIT_ROUNDS, OMEGA, PUSH = 0.1, 20, 1.0, 0.2


def _sum(values, group, count):
    return np.stack([np.bincount(group, values[:, i], count) for i in range(values.shape[1])], 1)


def _obstacle_rows(crowd, obstacles, h):
    J, body, room, surf = [], [], [], []
    for source in crowd.sources:
        f = source.flight
        rest = f.tick.rest
        for obstacle in obstacles:
            cs = contact.find(f.particles.x, obstacle, f.tick.gains.thickness)
            number = np.full(len(f.batch.x), -1)
            number[source.rows] = source.first + np.arange(len(source.rows))
            cs = cs.where(number[cs.body] >= 0)
            if not len(cs):
                continue
            patch = contact._patch(f.particles.x, cs, f.motion, rest)
            sunk = contact.depth_of_goals(cs, obstacle, f.match.goals[1], f.tick)
            B = len(f.batch.x)
            d = patch.mean(sunk)
            j = np.concatenate(
                [
                    _sum(patch.share[:, None] * cs.normal, cs.body, B),
                    _sum(patch.share[:, None] * patch.levers, cs.body, B),
                ],
                1,
            )
            rows = np.unique(cs.body)
            J.append(j[rows])
            body.append(number[rows])
            room.append(LIMIT * rest.scale - d[rows])
    if not J:
        return np.zeros((0, 6)), np.zeros(0, int), np.zeros(0), None
    return np.concatenate(J), np.concatenate(body), np.concatenate(room), None


def out_load(dV, crowd, h):
    return dV / h


def loads(crowd, one, two, normal, gravity):
    """top down"""
    g = np.linalg.norm(gravity)
    P = len(one)
    load = np.zeros(P)
    if g == 0.0:
        return load
    down = gravity / g
    along = normal @ down  # >0: 'one' is pushed down -> two is above
    upper = np.where(along < 0, one, two)
    lowerb = np.where(along < 0, two, one)
    height = -(crowd.centre @ down)
    c = np.abs(along)
    # order of upper by height, top first
    order = np.argsort(-height[upper], kind='stable')
    force = crowd.mass * g  # downwards force to carry
    force = force.tolist()
    square = np.bincount(upper, c * c, len(crowd)).tolist()
    up, lo, cc = upper.tolist(), lowerb.tolist(), c.tolist()
    for j in order.tolist():
        u = up[j]
        l = force[u] * cc[j] / max(square[u], 0.1)
        load[j] = l
        force[lo[j]] += l * cc[j]
    return load
