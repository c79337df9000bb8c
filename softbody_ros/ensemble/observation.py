# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What was seen of bodies: points at times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from softbody_ros.ensemble.offline_command import Refusal

ANY_BODY = ''
"""Key of clouds whose points may be of any body."""


class ObservationError(Refusal, ValueError):
    """An observation that cannot be used; with the reason in one sentence."""


@dataclass(frozen=True)
class Observation:
    """
    Points of bodies at times.

    Attributes
    ----------
    times : (frames,) float
        ascending, s
    clouds : dict of list of (k, 3) float
        m, for each frame, by the names of bodies or `ANY_BODY`; of unseen vertices nan

    """

    times: np.ndarray
    clouds: Mapping[str, Sequence[np.ndarray]]


def in_order(
    times: Sequence[float], clouds: Mapping[str, Sequence[np.ndarray]], path: Path
) -> Observation:
    """Return an observation with ascending times."""
    stamps = np.asarray(times, dtype=float)
    if not np.isfinite(stamps).all():
        raise ObservationError(f'the observation {path} has a time that is not finite')
    order = np.argsort(stamps, kind='stable')
    return Observation(
        stamps[order], {name: [each[k] for k in order] for name, each in clouds.items()}
    )
