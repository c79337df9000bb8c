# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Meshless shape matching: the unconstrained motion of a body towards its goal positions."""
