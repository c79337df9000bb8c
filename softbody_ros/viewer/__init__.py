# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
The command `viewer`: a web page that shows what a node publishes, and steers it.

`app` is the ROS node that wires the rest together: what comes (`frames`) is drawn (`stage`), the
observed node's parameters (`remote`) are described (`fields`) and become the panel (`panel`).
"""
