"""Client for a board on the serial line; `python -m firmware.client --help` lists the commands."""
