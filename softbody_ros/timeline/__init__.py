# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Ticks along a clock, and the history that lets them be replayed; knows nothing of ROS."""
