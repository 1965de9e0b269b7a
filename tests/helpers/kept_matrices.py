"""Matrix cache in memory instead of on disk."""

from __future__ import annotations

import numpy as np


class KeptMatrices(dict[str, np.ndarray]):
    """Matrices by key; `len` is their number."""

    put = dict.__setitem__
