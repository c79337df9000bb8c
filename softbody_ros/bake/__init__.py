# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Films of scenes in files, without ROS: the command `bake`, and a module for each format."""
