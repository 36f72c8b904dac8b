#include "dense.h"

#include <math.h>

/* A pivot below this share of its entry: the row depends on those before it. */
#define SINGULAR 1e-12

int solve_dense(int n, double *A, double *x)
{
    int i, j, k;
    for (i = 0; i < n; i++) { /* rows of one size, so that pivots can be compared */
        double largest = 0.0;
        for (j = 0; j < n; j++) largest = fmax(largest, fabs(A[i * n + j]));
        if (!(largest > 0.0)) return 1;
        for (j = 0; j < n; j++) A[i * n + j] /= largest;
        x[i] /= largest;
    }
    for (k = 0; k < n; k++) {
        int pivot = k;
        for (i = k + 1; i < n; i++)
            if (fabs(A[i * n + k]) > fabs(A[pivot * n + k])) pivot = i;
        if (!(fabs(A[pivot * n + k]) > 1e-15)) return 1;
        for (j = 0; j < n; j++) {
            double exchanged = A[k * n + j];
            A[k * n + j] = A[pivot * n + j];
            A[pivot * n + j] = exchanged;
        }
        {
            double exchanged = x[k];
            x[k] = x[pivot];
            x[pivot] = exchanged;
        }
        for (i = k + 1; i < n; i++) {
            double factor = A[i * n + k] / A[k * n + k];
            for (j = k + 1; j < n; j++) A[i * n + j] -= factor * A[k * n + j];
            x[i] -= factor * x[k];
        }
    }
    for (k = n - 1; k >= 0; k--) {
        for (j = k + 1; j < n; j++) x[k] -= A[k * n + j] * x[j];
        x[k] /= A[k * n + k];
    }
    return 0;
}

int factorise_row(int k, int stride, const double *entries, double *factor)
{
    int l, n;
    double *row = factor + k * stride, pivot = entries[k];
    for (l = 0; l < k; l++) {
        double entry = entries[l];
        for (n = 0; n < l; n++) entry -= row[n] * factor[l * stride + n];
        row[l] = entry; /* so far L d */
    }
    for (l = 0; l < k; l++) {
        double entry = row[l] * factor[l * stride + l];
        pivot -= entry * row[l];
        row[l] = entry;
    }
    row[k] = 1.0 / pivot;
    return !(pivot > SINGULAR * entries[k]);
}

void substitute(int n, int stride, const double *factor, double *x)
{
    int k, l;
    for (k = 0; k < n; k++)
        for (l = 0; l < k; l++) x[k] -= factor[k * stride + l] * x[l];
    for (k = n - 1; k >= 0; k--) {
        x[k] *= factor[k * stride + k];
        for (l = k + 1; l < n; l++) x[k] -= factor[l * stride + k] * x[l];
    }
}
