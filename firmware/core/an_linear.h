/* Small dense complex systems. */
#ifndef AN_LINEAR_H
#define AN_LINEAR_H

#include "an_types.h"

/* Solve A X = B in place by Gauss-Jordan elimination with row pivoting. Each of the n rows holds a row of A and then
 * one of B, n + columns numbers; X replaces B. Returns false if a pivot is below 1e-6 of the largest entry of A. */
bool an_solve(an_complex *rows, uint32_t n, uint32_t columns);

#endif
