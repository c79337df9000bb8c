# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Memory for contacts, kept from tick to tick.

In a heap it is tens of megabytes. Freed after each tick they go back to the operating system, and
to get them again, page by page, takes a fifth of the time of a tick. And what Python passes from
one kernel to the next is part of an array that Python made: a returned one has a dtype of its own,
which is compared field by field when it is passed on. That took 6 µs of each tick. The arrays
are passed as a plain tuple: the class of a named one would be looked up in each call, for another
2 µs.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from softbody_ros.core.compiled import helper
from softbody_ros.core.contact.members import MEMBER, PARTICLE
from softbody_ros.core.contact.rows import ROW
from softbody_ros.core.contact.working_set import OPEN, SPARE

MEMBERS, FOUND, OWN, PARTICLES, WAITING, JACOBIAN, CANDIDATES = range(7)
"""Places in `Workspace.needed`."""
AT_FIRST = 1, 64, 0, 0, 0, 0, 256
"""Lengths for a body at rest."""
CORNERS = 4
"""Particles at a contact, at most."""


class Workspace(NamedTuple):
    """
    Arrays of any content.

    There is room for all members. What needs more than another one gets a new one, this once.
    """

    needed: np.ndarray
    """(7,) int, written: lengths of the arrays that were needed so far, and the number of
    candidates of pairs, for which there is no array here"""
    members: np.ndarray
    """(m,) MEMBER, all bodies that may be in contact"""
    found: np.ndarray
    """(k,) ROW, all contacts"""
    own: np.ndarray
    """(r,) ROW, those of islands, each with room for more"""
    particles: np.ndarray
    """(p,) PARTICLE, of an island"""
    waiting: np.ndarray
    """(w,) OPEN, contacts that wait"""
    jacobian: np.ndarray
    """(j,) float, of an island"""


def new_workspace() -> Workspace:
    """Return a workspace for a body at rest."""
    kinds = MEMBER, ROW, ROW, PARTICLE, OPEN, np.dtype(float)
    return enlarged(Workspace(np.array(AT_FIRST), *(np.empty(0, kind) for kind in kinds)))


def enlarged(workspace: Workspace) -> Workspace:
    """Return a workspace as large as was needed so far."""
    needed, arrays = workspace.needed, workspace[1:]
    if all(len(array) >= length for array, length in zip(arrays, needed, strict=False)):
        return workspace
    return Workspace(needed, *map(_enlarged, arrays, needed))


def _enlarged(array: np.ndarray, length: int) -> np.ndarray:
    return array if len(array) >= length else np.empty(length, array.dtype)


@helper
def for_islands(workspace: Workspace, contacts: int) -> Workspace:
    """Return a workspace with room for so many contacts of all islands."""
    needed, own, particles = workspace.needed, workspace.own, workspace.particles
    waiting, rows = workspace.waiting, SPARE * contacts
    if contacts > len(waiting):
        needed[WAITING], waiting = contacts, np.empty(contacts, OPEN)
    if rows > len(own):
        needed[OWN], own = rows, np.empty(rows, ROW)
    if CORNERS * rows > len(particles):
        needed[PARTICLES], particles = CORNERS * rows, np.empty(CORNERS * rows, PARTICLE)
    return Workspace(
        needed, workspace.members, workspace.found, own, particles, waiting, workspace.jacobian
    )


@helper
def jacobian_of(workspace: Workspace, lines: int, width: int) -> np.ndarray:
    """Return an array (lines, width) for the Jacobian of an island."""
    jacobian, length = workspace.jacobian, lines * width
    if length > len(jacobian):
        workspace.needed[JACOBIAN] = max(workspace.needed[JACOBIAN], length)
        jacobian = np.empty(length)
    return jacobian[:length].reshape(lines, width)
