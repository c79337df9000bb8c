# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""The README and the pages of `docs`, with the programs and links in them."""

import pathlib
import re

ROOT = pathlib.Path(__file__).parent.parent
PAGES = {
    path: path.read_text() for path in (ROOT / 'README.md', *sorted(ROOT.glob('docs/**/*.md')))
}
PROGRAM = re.compile(r'^```python\n# (\w+): (.*?)^```', re.M | re.S)
"""Each program begins with a comment: its name, and what it does."""
EXAMPLE = re.compile(r'^```python\n(# example: .*?)^```\s*```text\n(.*?)^```', re.M | re.S)
"""A program with what it prints."""


def everything() -> str:
    return '\n'.join(PAGES.values())


def programs() -> dict[str, str]:
    """Return all programs by name, but for examples."""
    found = [match for match in PROGRAM.finditer(everything()) if match[1] != 'example']
    result = {match[1]: match[0][len('```python\n') : -len('```')] for match in found}
    assert len(result) == len(found), 'two programs of one name'
    return result


def anchors(text: str) -> set[str]:
    """Return the anchors of headings, as code hosts make them."""
    headings = re.findall(r'^#+ (.*)$', re.sub(r'^```.*?^```', '', text, flags=re.M | re.S), re.M)
    plain = [re.sub(r'[^\w\s-]', '', heading.lower()).strip() for heading in headings]
    return {heading.replace(' ', '-') for heading in plain}


def links(text: str) -> list[str]:
    """Return targets of links and pictures outside code."""
    prose = re.sub(r'`[^`\n]*`', '', re.sub(r'^```.*?^```', '', text, flags=re.M | re.S))
    return re.findall(r'\]\(([^)\s]+)\)', prose)
