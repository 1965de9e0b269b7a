"""What a solver raises when it will not vouch for a number."""


class SolverError(Exception):
    """A computation that could not be trusted; the message says what, by how much, and what to try."""


class CountMismatch(SolverError):
    """Fewer or more eigenvalues were found than the inertia counts."""


class SingularShift(SolverError):
    """The shift fell on an eigenvalue and moving it did not help."""


class TooLarge(SolverError):
    """The factorisation would not fit into memory."""


class OutOfMemory(TooLarge):
    """Memory ran out in the middle of a computation."""
