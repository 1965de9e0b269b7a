"""One BLAS thread for a while: small dense algebra and independent solves run slower on several that wait for each other."""

from __future__ import annotations

from contextlib import AbstractContextManager
from functools import lru_cache
from typing import Any

import scipy.linalg  # noqa: F401  its thread pool must be loaded before the pools are looked up
from threadpoolctl import ThreadpoolController


def one_thread() -> AbstractContextManager[Any]:
    """Numpy's and scipy's linear algebra limited to one thread within the block."""
    return _pools().limit(limits=1)


@lru_cache(maxsize=1)
def _pools() -> ThreadpoolController:
    """Looked up once: that takes half as long as a wave's dense solve."""
    return ThreadpoolController()
