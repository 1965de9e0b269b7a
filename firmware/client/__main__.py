"""`python -m firmware.client`."""

from __future__ import annotations

import sys

from firmware.client.command_line import main

sys.exit(main())
