# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Many runs of a scene, without ROS: the commands `sweep` and `fit`.

`run` (running.py) makes a film of a scene with other parameter values, `record` takes it as
arrays. Both are pure: the same arguments give the same bits in any process, on any worker of a
cluster (cluster.py). What these commands and `bake` have in common is in offline_command.py.
"""
