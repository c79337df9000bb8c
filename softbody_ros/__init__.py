# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A soft-body simulator for ROS 2.

Layout, from the physics up to the commands:

* `core`: the simulator, as a library: `World(config).step()`. Knows nothing of ROS.
* `timeline`: which tick is due at which time of a clock, and replay from snapshots when that clock
  goes back.
* `scene`: the table of parameters, made of the settings of the core and of the node, and the YAML
  files that set them.
* `ros`: the node, with its topics, services and messages.
* `viewer`: the command that shows a running node in a web page; `bake`: the one that writes films,
  without ROS.

Imports go in this order only: the core knows none of the others.
"""
