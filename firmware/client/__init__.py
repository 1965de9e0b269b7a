"""Talks to a board over its serial line; `python -m firmware.client --help` tells what it can be asked."""
