# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Stepping along a clock, and the history of snapshots and actions for replay; no ROS."""
