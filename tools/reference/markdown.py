# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Pieces of Markdown pages."""

from collections.abc import Iterable, Sequence

NOTE = (
    '<!-- Written by tools/write_reference.py: edit the tables that it reads, not this page. -->'
)


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table; cells are Markdown without line breaks."""
    lines = [head, ['---'] * len(head), *rows]
    return '\n'.join(
        f'| {" | ".join(cell.replace("|", "·") for cell in line)} |' for line in lines
    )


def page(title: str, *parts: str) -> str:
    """Return a page of paragraphs, tables and headings."""
    return '\n\n'.join([f'# {title}', NOTE, *parts]) + '\n'


def code(text: str) -> str:
    return f'`{text}`'
