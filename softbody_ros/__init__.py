# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
A soft-body simulator for ROS 2.

Where to find what, from the physics up to the command:

* `core`: the simulator, as a library: `World(config).step()`. Knows nothing of ROS.
* `stepping`, `history`: which tick is due at which time of a clock, and the way back when that
  clock goes back.
* `parameters`: the one table of parameters, made of the settings of the core and of the node.
* `messages`, `cdr`: arrays to messages: clouds, markers, odometry.
* `inputs`: messages to what the core wants, or one sentence that says why not.
* `sim_node`: the node, which wires all of these together; `input_topics`, `obstacle_markers`,
  `standard_services` and `standard_server` are parts of it.
* `viewer`: the command that shows a running node in a web page; `bake`: the one that writes films,
  without ROS.
* `guide`: what `sim_node --help` prints, and what the node says when it starts.

The core knows none of the others, and none of them but `__main__` knows the node.
"""
