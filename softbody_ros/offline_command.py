# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What the commands without ROS share: `bake`, `sweep`, `fit`."""

from __future__ import annotations

import os
from pathlib import Path


class Refusal(Exception):  # noqa: N818
    """A request that cannot be fulfilled; with the reason in one sentence."""


def path_argument(text: str) -> Path:
    """Return the path of an argument; shells do not expand the ~ of --output=~/film.usdc."""
    return Path(os.path.expanduser(text))
