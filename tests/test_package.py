# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""What is written more than once agrees: versions, dependencies, examples of the library."""

import ast
import json
import re
import shlex
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

from pages import EXAMPLE, ROOT, everything
import pytest

from softbody_ros.ros.interfaces import PUBLISHED, RECEIVED, SERVICES

PACKAGE = ElementTree.parse(ROOT / 'package.xml').getroot()


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


def test_packages_import_only_what_the_architecture_lets_them():
    page = (ROOT / 'docs' / 'explanation' / 'architecture.md').read_text()
    rows = re.findall(r'^\| \[(\w+)\]\([^)]*\) \|.*\| ([^|]*) \|$', page, re.M)
    source = ROOT / 'softbody_ros'
    packages = {path.parent.name for path in source.glob('*/__init__.py')}
    assert {name for name, _ in rows} == packages
    allowed = {name: packages & set(re.findall(r'\w+', cell)) for name, cell in rows}
    for path in source.rglob('*.py'):
        package = path.relative_to(source).parts[0]
        if package == '__main__.py':
            continue
        imported = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                imported |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                imported |= {f'{node.module}.{alias.name}' for alias in node.names}
        names = {name.split('.')[1] for name in imported if name.startswith('softbody_ros.')}
        # modules beside the packages know none of them
        assert names & packages <= {package, *allowed.get(package, ())}, path


def test_what_is_installed_beside_ros_has_the_bounds_of_setup():
    setup = (ROOT / 'setup.py').read_text()
    pip = re.search(r'^pip install --user .*', (ROOT / 'README.md').read_text(), re.M)[0]
    requirements = [each for each in shlex.split(pip, comments=True)[2:] if each[0] != '-']
    assert [re.match(r'\w+', each)[0] for each in requirements] == ['numba', 'trimesh', 'viser']
    for requirement in requirements:
        assert f"'{requirement}'" in setup


def test_package_format_and_build_type():
    assert PACKAGE.get('format') == '3'
    assert PACKAGE.findtext('export/build_type') == 'ament_python'
    assert PACKAGE.findtext('license') == 'Apache-2.0'


EXAMPLES = EXAMPLE.findall(everything())
RUN_EACH = """
import contextlib, io, json, sys, traceback
printed = []
for code in json.load(sys.stdin):
    with contextlib.redirect_stdout(io.StringIO()) as text:
        try:
            exec(code, {'__name__': '__main__'})
        except Exception:
            traceback.print_exc(file=text)
    printed.append(text.getvalue())
print(json.dumps(printed))
"""
"""Each is a program with names of its own; one process loads the kernels for all."""


@pytest.fixture(scope='module')
def printed_by_examples():
    run = subprocess.run(
        [sys.executable, '-c', RUN_EACH], input=json.dumps([code for code, _ in EXAMPLES]),
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    return json.loads(run.stdout)


@pytest.mark.parametrize('number', range(len(EXAMPLES)))
def test_library_example_prints_what_it_says(number, printed_by_examples):
    assert printed_by_examples[number] == EXAMPLES[number][1]


def test_every_file_carries_the_licence():
    for folder in ('', 'softbody_ros/**/', 'tests/', 'tools/**/', 'docs/'):
        for path in ROOT.glob(f'{folder}*.py'):
            assert 'SPDX-License-Identifier: Apache-2.0' in path.read_text()[:200], path
