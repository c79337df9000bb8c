# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Collision detection: obstacle shapes, broad phase, narrow phase, swept contact."""
