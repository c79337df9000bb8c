# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is written more than once agrees: versions, dependencies, the README's example."""

import ast
import pathlib
import re
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import pytest

from softbody_ros.ros.interfaces import PUBLISHED, RECEIVED, SERVICES

ROOT = pathlib.Path(__file__).parent.parent
PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()
README = (ROOT / 'README.md').read_text()


def test_versions_agree():
    version = PACKAGE.findtext('version')
    setup = (ROOT / 'setup.py').read_text()
    changelog = (ROOT / 'CHANGELOG.rst').read_text()
    assert re.search(r"version='([^']+)'", setup)[1] == version
    assert re.search(r'^(\d+\.\d+\.\d+) \(\d{4}-\d\d-\d\d\)\n-+$', changelog, re.M)[1] == version


def test_every_ros_package_that_is_imported_is_a_dependency():
    declared = {element.text for element in PACKAGE.iter('exec_depend')}
    imported = set()
    for path in (ROOT / 'softbody_ros').rglob('*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name.split('.')[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module:
                imported.add(node.module.split('.')[0])
    for each in (*PUBLISHED, *RECEIVED, *SERVICES):
        if each.requires in ('', 'robot.links'):
            imported.add(each.type.split('/')[0])
    ros = {
        name
        for name in imported
        if name in ('rclpy', 'ament_index_python')
        or name.endswith(('_msgs', '_srvs', 'interfaces'))
    }
    assert ros == {name for name in declared if not name.startswith('python3-')}


def test_package_format_and_build_type():
    assert PACKAGE.get('format') == '3'
    assert PACKAGE.findtext('export/build_type') == 'ament_python'
    assert PACKAGE.findtext('license') == 'Apache-2.0'


EXAMPLES = re.findall(r'```python\n(# example.*?)```\s*```text\n(.*?)```', README, re.S)


@pytest.mark.parametrize(('code', 'expected'), EXAMPLES)
def test_readme_library_example_prints_what_it_says(code, expected):
    run = subprocess.run(
        [sys.executable, '-c', code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    assert run.stdout == expected


def test_every_file_carries_the_licence():
    for path in [*ROOT.glob('*.py'), *ROOT.glob('softbody_ros/**/*.py'), *ROOT.glob('tests/*.py')]:
        assert 'SPDX-License-Identifier: Apache-2.0' in path.read_text()[:200], path
