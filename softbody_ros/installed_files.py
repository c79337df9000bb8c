# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Paths of the data files of this package and of others; imports nothing else of the package."""

from __future__ import annotations

import pathlib
import sys


def share_directory(package: str) -> str:
    """
    Return the share directory of a package; of this one also as installed by pip, or the clone.

    Raises
    ------
    LookupError, ValueError, OSError, ImportError
        if there is none.

    """
    source = pathlib.Path(__file__).parents[1]
    if package == 'softbody_ros' and (source / 'package.xml').is_file():
        return str(source)
    try:
        # here, not above: what bakes a scene needs no ROS
        from ament_index_python.packages import get_package_share_directory

        return get_package_share_directory(package)
    except (LookupError, OSError, ImportError):
        installed = pathlib.Path(sys.prefix) / 'share' / package
        if package == 'softbody_ros' and installed.is_dir():
            return str(installed)
        raise
