# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS graph of its own for each test, and kernels that are compiled before it."""

from __future__ import annotations

from collections.abc import Iterator
import os
from typing import Any

import pytest
from ros_graph import Graph


@pytest.fixture(scope='session')
def compiled_ahead() -> None:
    """Compile everything, so that no process of a test has to, which would take long."""
    from softbody_ros.core.warm_up import compile_ahead

    compile_ahead(print, print)


@pytest.fixture
def graph(compiled_ahead: None) -> Iterator[Graph]:
    result = Graph()
    yield result
    result.close()


@pytest.fixture(scope='module')
def browser() -> Iterator[Any]:
    import browser as browser_of_tests

    if browser_of_tests.path() is None and 'CI' not in os.environ:
        pytest.skip('needs Chromium: apt-get install chromium')
    with browser_of_tests.chromium() as result:
        yield result
