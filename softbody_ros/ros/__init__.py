# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rclpy node and its topics, services and messages: a thin layer over the simulator."""
