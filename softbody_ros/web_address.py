# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where the page of the viewer is served: arguments of `viewer`, and of `sim_node --viewer`."""

from __future__ import annotations

import argparse
import ipaddress


def add_address(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that say where the page is served."""
    parser.add_argument(
        '--host', default='127.0.0.1', type=_address, metavar='ADDRESS',
        help='the address to serve at; 127.0.0.1 is this machine only [%(default)s]',
    )  # fmt: skip
    parser.add_argument(
        '--port', default=8080, type=_port,
        help='its port; if it is taken, the next free one [%(default)s]',
    )  # fmt: skip


def _address(text: str) -> str:
    try:
        return str(ipaddress.ip_address('127.0.0.1' if text == 'localhost' else text))
    except ValueError:
        raise argparse.ArgumentTypeError(
            f'{text!r} is no IP address: give one such as 127.0.0.1, or 0.0.0.0 for all'
        ) from None


def _port(text: str) -> int:
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f'{text!r} is no port: it must be from 1 to 65535')
    return int(text)
