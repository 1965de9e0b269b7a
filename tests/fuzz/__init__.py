"""Damaged input for everything that a user, a file or a board hands in: `make fuzz COUNT=n SEED=n`.

A kind of input is a function that draws bytes and one that reads them. Bytes that end in anything but a result or one of the
project's own faults are written to `corpus/<kind>/`, whose content `make test` reads.
"""
