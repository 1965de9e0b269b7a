"""A cache of matrices in memory, as those between runs are on disk."""

from __future__ import annotations

import numpy as np


class KeptMatrices(dict[str, np.ndarray]):
    """Matrices by key; `len` says how many were kept."""

    put = dict.__setitem__
