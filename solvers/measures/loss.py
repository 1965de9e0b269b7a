"""Quality factors of modes from where their strain energy sits.

(K + i H) u = mu M u, with H the stiffness of each material times its loss factor; to first order the loss factor of a mode
is u'Hu / u'Ku (ungar1962).
"""

from __future__ import annotations

import numpy as np

from geometry.elements import FloatArray

SHARES = 2.0  # measured on coarse plates of three materials
ROUNDING = 1e-9  # relative


def quality_and_bar(
    factor: float, most: float, error: float | None, change: float = 0.0, radiated: float = 0.0
) -> tuple[float | None, float | None]:
    """Compute the quality factor of a mode or a wave and its error bar.

    A small share of the energy that loses most is less accurate than the whole: by up to SHARES (1 + (most/factor)^(1/2)) times
    the eigenvalue's own error. Of the loss into the air, twice the share is uncertain by which a motion of that error in energy
    may differ.

    Parameters
    ----------
    factor : float
        Loss factor by the materials.
    most : float
        Largest loss factor of a material.
    error : float or None
        Relative error of the frequency; None if unknown.
    change : float, optional
        What modes that overlap change of the loss factor.
    radiated : float, optional
        Loss factor by radiation.

    Returns
    -------
    quality : float or None
        Quality factor; None where nothing is lost.
    half : float or None
        Half-width of its error bar, in units of the quality factor: d/(eta (eta - d)) for a loss factor eta within d, which
        holds the longer side of 1/(eta +- d); None if unknown, or as wide as the quality factor itself.
    """
    total, shared = factor + radiated, most <= factor * (1.0 + ROUNDING)  # alike: nothing depends on the mesh
    if total <= 0.0:
        return None, None
    if error is None:
        return 1.0 / total, 0.0 if shared and not radiated else None
    own = 0.0 if shared else 2.0 * SHARES * error * (factor + np.sqrt(most * factor)) + abs(change)
    half = float(own + 2.0 * np.sqrt(2.0 * error) * radiated)
    return 1.0 / total, half / (total * (total - half)) if half < 0.5 * total else None


def of_discarded(most: float, least: float, softened: FloatArray, factor: FloatArray) -> FloatArray:
    """Bound what discarded fixed-interface modes change of a loss factor.

    They hold a share s of the energy, by which they soften a mode or a wave, and take part in it orthogonally. With
    H - least K semidefinite, its product of wave and discarded part is at most (s (factor - least)(most - least))^(1/2) of the
    energy by Cauchy and Schwarz, and at most s^(1/2)/2 (most - least); the loss changes by twice the lower, and s times what
    the materials' loss factors differ by.

    Parameters
    ----------
    most, least : float
        Largest and smallest loss factor of a material.
    softened : ndarray, shape (k,)
        Relative change s of the eigenvalues by the discarded modes.
    factor : ndarray, shape (k,)
        Loss factors without them.

    Returns
    -------
    ndarray, shape (k,)
        Largest change of the loss factors.
    """
    apart = most - least
    product = np.minimum(2.0 * np.sqrt(np.maximum(factor - least, 0.0) * apart), apart)
    return np.asarray(product * np.sqrt(softened) + apart * softened)


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
