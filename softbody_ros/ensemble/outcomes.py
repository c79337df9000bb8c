# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What came of a run, in a few numbers, all taken from its frames."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from softbody_ros.ensemble.running import BodyRecord, Recording

OF_RUN = ('came_to_rest', 'time_of_rest')
LAST = tuple(f'last_{part}' for part in ('x', 'y', 'z', 'qx', 'qy', 'qz', 'qw'))
OF_BODY = ('largest_dent', 'highest_rebound', *LAST)


def names_of(bodies: Sequence[str]) -> list[str]:
    """Return the names of all outcomes: of a run, then of each body, as `ball.largest_dent`."""
    return [*OF_RUN, *(f'{body}.{name}' for body in bodies for name in OF_BODY)]


def outcomes(recording: Recording) -> dict[str, Any]:
    """
    Return all outcomes of a run, None where there is none.

    `came_to_rest` is whether all bodies sleep in the last frame, `time_of_rest` (s) the first
    frame from which on they do. Of a body: `largest_dent` (m) is the largest RMS displacement
    from its best rigid fit, `highest_rebound` (m) see `rebound`, `last_…` its last pose.
    """
    bodies = recording.bodies
    asleep = np.all([body.asleep for body in bodies.values()], axis=0)
    asleep = np.broadcast_to(asleep, recording.times.shape)
    awake = np.flatnonzero(~asleep)
    first = int(awake[-1]) + 1 if len(awake) else 0
    at_rest = first < len(asleep)
    values: list[Any] = [at_rest, float(recording.times[first]) if at_rest else None]
    for body in bodies.values():
        values += [float(body.dents.max()), rebound(body), *body.poses[-1].tolist()]
    return dict(zip(names_of(list(bodies)), values, strict=True))


def rebound(body: BodyRecord) -> float | None:
    """
    Return how high, m, a body rises again after its first contact; None without one.

    It is the height of its lowest point (z) above the lowest that this has been since.
    """
    touched = np.flatnonzero(body.wrenches.any(axis=1))
    if not len(touched):
        return None
    lowest = body.positions[touched[0] :, :, 2].min(axis=1)
    return float((lowest - np.minimum.accumulate(lowest)).max())
