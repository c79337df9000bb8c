# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The record of a body for kernels: indices into the arrays of a world, parameters, results.

The particles of all bodies are columns of common arrays, body after body, so that one kernel call
processes all bodies. Positions and velocities are double-buffered, (2, 3, N): `now` is the half
that holds the state; a tick writes the other one, which becomes the state when it is complete.
"""

from __future__ import annotations

from collections.abc import Collection
import zlib

import numpy as np

RIGID, LINEAR_MODE, QUADRATIC_MODE = 0, 1, 2
"""Values of `mode`, in the order of `config.MODES`."""
QUADRATIC_FEATURES = 9

IDENTITIES = 1 << 19


def identities(names: Collection[str]) -> list[int]:
    """
    Return a number below IDENTITIES for each name of a body, or an obstacle; no two are equal.

    They do not depend on the order of the names, and mostly not on the others.
    """
    number: dict[str, int] = {}
    taken: set[int] = set()
    for name in sorted(names):
        free = zlib.crc32(name.encode()) % IDENTITIES
        while free in taken:
            free = (free + 1) % IDENTITIES
        number[name] = free
        taken.add(free)
    return [number[name] for name in names]


BODY = np.dtype(
    [
        ('id', np.int64),  # see `identities`
        # indices into the arrays of the world
        ('first', np.int64),  # its first particle
        ('count', np.int64),
        ('surface', np.int64),  # of these at the surface, the first ones; others touch nothing
        ('now', np.int64),  # half of `x` and `v` that holds the state
        ('shape', np.int64),  # its rest shape, in the table of rest shapes
        ('matched', np.int64),  # the same with the weights of the match, where it has pins
        # whether its particles have goals of their own: with regions or pins, if it deforms
        ('follows_goals', np.bool_),
        # column of `q` with the features in its map of its first particle
        ('first_goal', np.int64),
        ('first_match', np.int64),  # match of the whole body; those of its regions follow
        ('regions', np.int64),  # their number K, or 0
        ('first_pin', np.int64),
        ('pins', np.int64),  # number of pinned particles
        # parameters, as gains of one tick: see shape_matching/gains.py
        ('mode', np.int64),
        # of goals, and of their velocities: shares of deformation and of its change of volume
        ('deformation', np.float64, (2,)),
        ('volume_conservation', np.float64, (2,)),
        ('look_ahead', np.float64, (3,)),  # to the match, in the states of `responses`, s
        # share of the velocity of deformation at the end of a tick that begins the next one
        ('lasting', np.float64),
        ('kept_velocity', np.float64),
        ('yield_strain', np.float64),
        ('creep', np.float64),
        ('largest_strain', np.float64),
        ('whole_body_weight', np.float64),
        ('elasticity', np.float64),
        ('friction', np.float64),
        ('coulomb', np.bool_),
        ('thickness', np.float64),  # m
        ('mass', np.float64),  # kg
        # of regular states, degenerate ones, and of bodies that touch something; each of followed
        # modes, residual and change of volume
        ('responses', np.float64, (3, 3, 7)),
        ('stiffnesses', np.float64, (3,)),  # ω² of regular states, 1/s²
        ('volume_share', np.float64),  # of the stiffness against changes of volume
        ('relaxation', np.float64),  # share of a change of it that is adopted in a tick
        # how much the fit may lack of its volume, relative to what the enclosed one may lack
        ('compressible', np.float64),
        ('pins_linear', np.float64, (3,)),  # m/s
        ('pins_angular', np.float64, (3,)),  # rad/s
        ('pins_shift', np.float64, (3,)),  # displacement of their centre in a tick, m
        ('pins_acceleration', np.float64, (3,)),  # of their centre, m/s²
        ('holder', np.int64),  # obstacle with which its pins move, or -1
        # applied wrench per mass, in world axes and in body axes: force, m/s², and torque, m²/s²
        ('has_wrench', np.bool_),
        ('wrench', np.float64, (2, 2, 3)),
        ('is_plastic', np.bool_),  # whether it has permanent deformation
        # by which the volume of the fit is to be less than at rest, of that; halves as of `x`
        ('flattened', np.float64, (2,)),
        ('flowed', np.bool_),  # whether some is new in the tick being computed
        # results of the tick
        ('reach', np.float64),  # within which of it there may be contacts, m
        ('displaced', np.float64),  # by contacts with bodies, 0 if not beyond that, m
        ('pushed', np.float64),  # as far as it may be displaced, if another search was needed, m
        ('degeneracy', np.float64),  # 0 … 1, see shape_matching/matching.py
        # of mass; of its pins, if it has some: then all this is of motion that they allow
        ('centre', np.float64, (3,)),  # m
        ('velocity', np.float64, (3,)),  # of the centre, m/s
        ('angular_momentum', np.float64, (3,)),  # about the centre, per mass, m²/s
        ('inverse_inertia', np.float64, (3, 3)),  # per mass, 1/m²
        ('carried', np.float64, (3,)),  # angular velocity that pins prescribe, rad/s
        ('allowed', np.float64, (3, 3)),  # projector on axes about which they let it turn
        # integral over time of the wrench of contacts, N s and N m s
        ('total', np.float64, (2, 3)),
        ('holding_total', np.float64, (2, 3)),  # the same of its pins
        # per mass, of gravity and of the wrench on it: m/s², m²/s²; of bodies with pins only
        ('applied', np.float64, (2, 3)),
        # results of the flight, see shape_matching/modal_flight.py and goal_flight.py
        ('origin', np.float64, (3,)),  # of start positions in `map`, m
        ('start_centre', np.float64, (3,)),  # m
        ('turn', np.float64, (3, 3)),  # E, the rotation in the tick
        ('start_inverse_inertia', np.float64, (3, 3)),  # of the start shape, turned; 1/m²
        ('shape_moment', np.float64, (QUADRATIC_FEATURES, 3)),  # Σ w f x̂ᵀ of it, m
        # the same of the direction in which the volume changes, of size 1
        ('volume_moment', np.float64, (QUADRATIC_FEATURES, 3)),
        ('response', np.float64, (3, 2)),  # Γ₁, s², and Γ₂, s, of each kind of modes
        # after the flight, of offsets p from the centre and velocities of deformation s
        ('angular_velocity', np.float64, (3,)),  # rad/s
        ('second_moments', np.float64, (3, 3)),  # Σ w p pᵀ, m²
        ('inner_momentum', np.float64, (3,)),  # Σ w p × s, m²/s
        ('offset_moment', np.float64, (QUADRATIC_FEATURES, 3)),  # Σ w f pᵀ, m
        ('velocity_moment', np.float64, (QUADRATIC_FEATURES, 3)),  # Σ w f sᵀ, m/s
        # of positions and of velocities: shift; matrices on position and velocity at the start;
        # columns of the features, or matrices on the goals
        ('map', np.float64, (2, 7 + QUADRATIC_FEATURES, 3)),
        # of contacts: impulse, m/s, and its moment about the centre, m²/s, per mass
        ('received', np.float64, (2, 3)),
        ('touches', np.int64, (2,)),  # 1 if a contact has acted on it, see contact/exchange.py
    ],
    align=True,
)
"""One body."""
