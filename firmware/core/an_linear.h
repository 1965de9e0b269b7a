/* Small dense complex systems. */
#ifndef AN_LINEAR_H
#define AN_LINEAR_H

#include "an_types.h"

/* Solves A X = B in place by Gauss-Jordan elimination with row pivoting. rows is n lines of n + columns numbers, A
 * then B; X stands where B stood. False when a pivot falls below 1e-6 of A's largest entry. */
bool an_solve(an_complex *rows, uint32_t n, uint32_t columns);

#endif
