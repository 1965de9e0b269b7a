"""Quality factors of modes from where their strain energy sits.

(K + i H) u = mu M u, with H the stiffness of each material times its loss factor; to first order the loss factor of a mode
is u'Hu / u'Ku (ungar1962).
"""

from __future__ import annotations

import numpy as np

from geometry.elements import FloatArray


def loss_factors(eigenvalue: FloatArray, loss: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Compute the loss factors 1/Q of modes, and what the loss between the modes adds to them.

    Parameters
    ----------
    eigenvalue : ndarray, shape (k,)
        Eigenvalues of K and M above 0, scaled.
    loss : ndarray, shape (k, k)
        H between the M-orthonormal modes, scaled.

    Returns
    -------
    factor : ndarray, shape (k,)
        Im mu / Re mu of the modes by themselves.
    change : ndarray, shape (k,)
        What changes where H couples them: small unless they overlap within their loss.

    References
    ----------
    .. [1] ungar1962 (docs/references.bib)
    """
    own = np.diag(loss) / eigenvalue
    if not len(eigenvalue):
        return own, own
    values, vectors = np.linalg.eig(np.diag(eigenvalue) + 1j * loss)
    nearest = np.abs(vectors).argmax(axis=1)  # the coupled mode in which each has most
    return own, np.asarray(values[nearest].imag / values[nearest].real - own)
