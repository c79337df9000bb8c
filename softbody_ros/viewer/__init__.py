# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command `viewer`: a web page that displays a node's output and controls it.

`app` is the ROS node that connects the rest: messages are decoded (`decoding`) and drawn
(`view3d`); the parameters of the observed node (`remote`) become fields (`widgets`) of the panel
(`panel`). Whole scenes and dropped meshes (`scene_menu`, `mesh_drop`) become requests to that
node (`scene_requests`); `recording` bakes films. `page` and `keyboard` are the look and
the keys.
"""
