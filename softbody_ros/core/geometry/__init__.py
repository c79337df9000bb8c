# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Meshes, signed distances, bounding boxes, and linear algebra for kernels."""
