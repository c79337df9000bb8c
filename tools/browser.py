# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Chromium without a screen, a GPU, or calls to anybody."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import re
import shutil
import socket

from playwright.sync_api import Browser, Locator, Page, expect, sync_playwright

NAMES = ('chromium', 'chromium-browser', 'google-chrome', 'google-chrome-stable')
ARGUMENTS = [
    '--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
    '--disable-background-networking', '--disable-component-update', '--disable-sync',
]  # fmt: skip


def path() -> str | None:
    """Return where a browser is installed."""
    return next(filter(None, map(shutil.which, NAMES)), None)


@contextmanager
def chromium() -> Iterator[Browser]:
    expect.set_options(timeout=120_000)  # a page without a GPU on a busy machine
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path(), args=ARGUMENTS)
        yield browser
        browser.close()


def slow_down(page: Page) -> None:
    """Let a page draw ten times a second: without a GPU each picture takes a processor's time."""
    page.add_init_script(
        'window.requestAnimationFrame = call => setTimeout(() => call(performance.now()), 100);'
        'window.cancelAnimationFrame = clearTimeout;'
    )


def draw_nothing(page: Page) -> None:
    """Let a page leave its view empty, where nobody looks at it: most of its time goes there."""
    page.add_init_script(
        "for (const name of ['drawArrays', 'drawArraysInstanced', 'drawElements',"
        " 'drawElementsInstanced']) WebGL2RenderingContext.prototype[name] = () => {};"
    )


def row(page: Page, label: str) -> Locator:
    """Return the row of the viewer's panel with a label."""
    words = page.locator('label', has_text=re.compile(f'^{re.escape(label)}$'))
    return words.locator('xpath=ancestor::p/../..')


def choose(page: Page, label: str, option: str) -> None:
    """Choose an option of a dropdown of the panel."""
    row(page, label).locator('input').first.click()
    page.get_by_role('option', name=option, exact=True).click()


def open_folder(page: Page, title: str, inside: Locator) -> None:
    """Open a folder of the panel that contains an element."""
    for _ in range(10):
        page.get_by_text(title, exact=True).click()
        # a click is lost where the folder moves under it, as one above it opens or closes
        with suppress(AssertionError):
            expect(inside).to_be_visible(timeout=5_000)
            return
    raise AssertionError(f'{title} does not open')


def close_notices(page: Page) -> None:
    """Close the notices that lie over the view."""
    closers = page.locator('.mantine-Notification-closeButton')
    closers.evaluate_all('buttons => buttons.forEach(button => button.click())')


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(('127.0.0.1', 0))
        return probe.getsockname()[1]
