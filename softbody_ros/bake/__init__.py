# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Export of simulations as films, without ROS: the command `bake`, a module per format."""
