# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""
Write what follows from the tables of parameters, topics, services and commands.

These are the pages in docs/reference but messages.md, config/default.yaml, and in README.md what
is between `<!-- topics -->` and `<!-- end -->`. With --check nothing is written: the files that
are not current are named, and the exit code is 1 if there are any.
"""

import argparse
from pathlib import Path
import re
import sys

sys.path.insert(0, str(Path(__file__).parents[1]))

from reference.command_line_page import command_line_page
from reference.default_yaml import default_yaml
from reference.interface_pages import services_page, short_table, topics_page
from reference.parameters_page import parameters_page

ROOT = Path(__file__).parents[1]
PAGES = {
    'config/default.yaml': default_yaml,
    'docs/reference/command_line.md': command_line_page,
    'docs/reference/parameters.md': parameters_page,
    'docs/reference/services.md': services_page,
    'docs/reference/topics.md': topics_page,
}
BLOCK = re.compile(r'(?<=^<!-- topics -->\n).*?(?=^<!-- end -->$)', re.M | re.S)


def with_topics(readme: str) -> str:
    """Return the text of README with its table of topics and services, if it has a place."""
    return BLOCK.sub(lambda _: f'{short_table()}\n', readme, count=1)


def outdated(root: Path = ROOT) -> dict[str, str]:
    """Return what is to be in the files, below `root`, that are not current."""
    wanted = {name: write() for name, write in PAGES.items()}
    wanted['README.md'] = with_topics((root / 'README.md').read_text())
    return {
        name: text
        for name, text in wanted.items()
        if not (root / name).is_file() or (root / name).read_text() != text
    }


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument('--check', action='store_true', help='write nothing')
    only_check = parser.parse_args().check
    files = outdated()
    for name, text in files.items():
        print(f'{name} is not current' if only_check else f'{name} is written')
        if not only_check:
            (ROOT / name).write_text(text)
    if only_check and files:
        print('run python3 tools/write_reference.py', file=sys.stderr)
    return int(only_check and bool(files))


if __name__ == '__main__':
    sys.exit(main())
