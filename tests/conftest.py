# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""A ROS graph of its own for each test, kernels compiled before it, and how hypothesis draws."""

from __future__ import annotations

from collections.abc import Iterator
import fcntl
import os
from typing import Any

from hypothesis import HealthCheck, settings
import pytest
from ros_graph import Graph

# the same examples each time, however long they take
settings.register_profile(
    'same',
    derandomize=True,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
settings.load_profile('same')

MARKS = {'graph': pytest.mark.dds, 'browser': pytest.mark.browser}
"""By the fixture that a test needs."""


def pytest_configure(config: pytest.Config) -> None:
    # modules of few tests may take longest: in their order, no worker has all of these at the end
    config.option.loadscopereorder = False


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        for fixture in MARKS.keys() & getattr(item, 'fixturenames', ()):
            item.add_marker(MARKS[fixture])


@pytest.fixture(scope='session')
def compiled_ahead(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Compile everything, so that no process of a test has to, which would take long."""
    from softbody_ros.core.warm_up import compile_ahead

    folder = tmp_path_factory.getbasetemp()
    if 'PYTEST_XDIST_WORKER' in os.environ:  # one of them compiles, for all
        folder = folder.parent
    with open(folder / 'compiling', 'w') as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        compile_ahead(print, print)


@pytest.fixture(scope='session', autouse=True)
def compiled_once(request: pytest.FixtureRequest) -> None:
    """Let several workers find what each of them would compile otherwise."""
    if 'PYTEST_XDIST_WORKER' in os.environ:
        request.getfixturevalue('compiled_ahead')


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
