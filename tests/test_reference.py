# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pages and files that follow from tables are current, and are written where they are not."""

import re
import shutil
import subprocess
import sys

import pytest
from scene_files import ROOT
import write_reference

from softbody_ros.ros.interfaces import PUBLISHED, RECEIVED, SERVICES, STANDARD_SERVICES
from softbody_ros.ros.messages import POINT_FIELDS, POINT_TYPE
from softbody_ros.scene.parameters import SceneLists, table

EVERY = (*PUBLISHED, *RECEIVED, *SERVICES, *STANDARD_SERVICES)


def test_the_command_finds_everything_current():
    run = subprocess.run(
        [sys.executable, ROOT / 'tools' / 'write_reference.py', '--check'],
        capture_output=True, text=True,
    )  # fmt: skip
    assert (run.returncode, run.stdout, run.stderr) == (0, '', '')


@pytest.fixture
def copy(tmp_path):
    """Return a copy of what the command writes."""
    for name in ('README.md', *write_reference.PAGES):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    return tmp_path


def test_what_is_changed_or_missing_is_not_current(copy):
    assert not write_reference.outdated(copy)
    page, missing = copy / 'docs/reference/topics.md', copy / 'config/default.yaml'
    current = page.read_text()
    page.write_text(current.replace('float32', 'float64'))
    missing.unlink()
    outdated = write_reference.outdated(copy)
    assert sorted(outdated) == ['config/default.yaml', 'docs/reference/topics.md']
    assert outdated['docs/reference/topics.md'] == current


def test_the_block_in_readme_is_written_between_its_marks_only(copy):
    before = 'A <!-- topics --> in a line.\n\n<!-- topics -->\n'
    after = '<!-- end -->\n\nMore.\n\n<!-- end -->\n'
    text = write_reference.with_topics(before + 'old\n' + after)
    assert text.startswith(before) and text.endswith('\n' + after)
    for each in EVERY:
        assert f'`{each.name}`' in text
    assert write_reference.with_topics(text) == text
    assert write_reference.with_topics('no marks\n') == 'no marks\n'
    (copy / 'README.md').write_text(before + after)
    assert write_reference.outdated(copy) == {'README.md': text.replace('old\n', '')}


def test_pages_have_everything_and_fit_together():
    pages = {path.stem: path.read_text() for path in (ROOT / 'docs/reference').glob('*.md')}
    for name, facts in table(SceneLists()).items():
        (row,) = re.findall(rf'^\| `{re.escape(name)}`.*$', pages['parameters'], re.M)
        assert facts.description in row and row.count('|') == 7
    for each in EVERY:
        assert f'`{each.name}`' in pages['topics'] + pages['services']
    for name, _ in POINT_FIELDS:
        assert f'| `{name}` | ' in pages['topics']
        assert f'| {POINT_TYPE.fields[name][1]} |' in pages['topics']
    for stem, page in pages.items():
        for target in re.findall(r'\]\((?!https?:)([^)]*)\)', page):
            path, _, anchor = target.partition('#')
            other = (ROOT / 'docs/reference' / path).resolve() if path else None
            assert other is None or other.is_file(), target
            headings = re.findall(r'^#+ (.*)$', other.read_text() if other else page, re.M)
            slugs = {re.sub(r'[^\w\- ]', '', head.lower()).replace(' ', '-') for head in headings}
            assert not anchor or anchor in slugs, f'{stem}: {target}'


def test_the_node_has_the_same_parameters_with_the_written_file_as_without(graph):
    graph.sim_node()
    graph.process('--ros-args', '-r', '__ns:=/file', '--params-file', ROOT / 'config/default.yaml')
    names = sorted(graph.list_parameters('/softbody_sim'))
    assert set(table(SceneLists())) < set(names)
    assert sorted(graph.list_parameters('/file/softbody_sim')) == names
    values = [graph.get_parameters(f'{space}/softbody_sim', names) for space in ('', '/file')]
    assert values[0] == values[1]
