/* Small dense systems. */
#ifndef DENSE_H
#define DENSE_H

/* Solve A x = b for n unknowns in place, A row after row; 1 if A is singular. */
int solve_dense(int n, double *A, double *x);

/* Row k of the factor L diag(d) L^T, 1 / d on its diagonal, from entries (k + 1,); 1 if it depends on those before. */
int factorise_row(int k, int stride, const double *entries, double *factor);

/* Forward and backward substitution in place. */
void substitute(int n, int stride, const double *factor, double *x);

#endif
