# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The scenes of `contact_battery.py`: each says in its docstring what is measured."""

from contact_scenes import gripping, stacking, sliding, colliding, settling  # noqa: F401, I001
from contact_scenes.base import MODES, SCENES, STEPS

__all__ = ['MODES', 'SCENES', 'STEPS']
