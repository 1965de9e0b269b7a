"""One plate cell reduced (Craig-Bampton) and assembled, and the errors of both."""
