/* A fixed point x = phi(x) of a step, by generalized conjugate residuals.

   With residuals f = phi(x) - x and pairs of directions p and the changes q of the residual along them, which are
   orthonormal, the next iterate is

       x + f - sum_j (q_j . f) (p_j + q_j)

   the plain step from the point of least residual among all iterates so far (Eisenstat, Elman, Schultz 1983; Walker,
   Ni 2011).  Of a linear phi it ends after as many times as phi' has distinct eigenvalues, however large these are. */

/* A pair beyond these begins anew; so does one whose change depends on those before but for round-off. */
#define MOST_PAIRS 32
#define DEPENDENT_SHARE 1e-10

static double inner(const pmr_iteration *it, const double *a, const double *b)
{
    double value = dot(a, b, 0, it->measured);
    if (it->sum) it->sum(&value, it->context);
    return value;
}

/* to += share from. */
INLINE void add_share(double *to, const double *from, double share, int count)
{
    int n;
    for (n = 0; n < count; n += VL) V(to + n) += CV(from + n) * share;
}

/* Store the last direction, with its change made orthogonal to the changes before (Gram and Schmidt, twice). */
static void store_direction(pmr_iteration *it)
{
    const int k = it->pairs == it->most ? 0 : it->pairs, count = it->count;
    double *p = it->directions + (size_t)k * count, *q = it->changes + (size_t)k * count, size, left;
    int n, j, time;
    for (n = 0; n < count; n += VL) {
        V(p + n) = CV(it->x + n) - CV(it->least_x + n);
        V(q + n) = CV(it->f + n) - CV(it->least_f + n);
    }
    size = inner(it, q, q);
    for (time = 0; time < 2; time++)
        for (j = 0; j < k; j++) {
            const double *of_j = it->changes + (size_t)j * count, share = -inner(it, of_j, q);
            add_share(p, it->directions + (size_t)j * count, share, count);
            add_share(q, of_j, share, count);
        }
    left = inner(it, q, q);
    it->pairs = 0;
    if (!(left > DEPENDENT_SHARE * DEPENDENT_SHARE * size)) return;
    left = 1.0 / sqrt(left);
    for (n = 0; n < count; n += VL) {
        V(p + n) *= left;
        V(q + n) *= left;
    }
    it->pairs = k + 1;
}

/* Replace x, whose residual is f, by the next iterate. */
static void extrapolate(pmr_iteration *it)
{
    int n, j;
    if (it->begun) store_direction(it);
    it->begun = 1;
    for (j = 0; j < it->pairs; j++) {
        const double *q = it->changes + (size_t)j * it->count, share = -inner(it, q, it->f);
        add_share(it->x, it->directions + (size_t)j * it->count, share, it->count);
        add_share(it->f, q, share, it->count);
    }
    for (n = 0; n < it->count; n += VL) {
        vec x = CV(it->x + n), f = CV(it->f + n);
        V(it->least_x + n) = x;
        V(it->least_f + n) = f;
        V(it->x + n) = x + f;
    }
}
