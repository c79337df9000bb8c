# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A soft-body simulator for ROS 2: `core` simulates, `sim_node` publishes."""
