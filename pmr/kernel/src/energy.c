/* Energy and work, added up in the loop.

       2 E = |z'|^2 + z Omega^2 z + f B^T R B f + lambda F lambda - 2 lambda H f
       W += mean(f B^T) dz + 1/2 d(f B^T R B f) - mean(H f) d lambda + mean(lambda) dC mean(z) - 1/2 mean(lambda) dF
       mean(lambda)

   with means over the step and changes d.  F comes back out of A: x F x = x A x - z_gain p S^-1 p with p = C^T x. */

/* p S^-1 q. */
INLINE vec over_S_product(const pmr_scheme *c, const double *p, const double *q, int n)
{
    return CV(p + n) * CV(q + n) * CV(c->unit + n);
}

static double coupled_product(pmr_state *st, const pmr_scheme *c, const double *p)
{
    over_S(st->system, c, p, 0, st->system->modes, st->scratch);
    return dot(st->scratch, p, 0, st->system->modes);
}

static void find_load_energy(pmr_state *st)
{
    const pmr_system *y = st->system;
    double sum = 0.0;
    int k, l;
    for (l = 0; l < y->inputs; l++) {
        double of_load = 0.0;
        if (y->ip > MANY_INPUTS)
            of_load = dot(y->load_energy + l * y->ip, st->loads, 0, y->ip);
        else
            for (k = 0; k < y->inputs; k++) of_load += y->load_energy[l * y->ip + k] * st->loads[k];
        sum += st->loads[l] * of_load;
    }
    st->load_energy = sum;
}

/* What the balance of the next step asks for. */
static void keep_end(pmr_state *st)
{
    const pmr_system *y = st->system;
    double *push = st->push;
    int n;
    for (n = 0; n < y->modes; n += VL) V(st->old_z + n) = CV(st->z + n);
    st->push = st->old_push, st->old_push = push; /* the next step has loads of its own */
    for (n = 0; n < y->inputs; n++) st->old_loads[n] = st->loads[n];
    for (n = 0; n < y->contacts; n++) st->old_lambda[n] = st->lambda[n];
    st->old_load_energy = st->load_energy;
    st->moved = 0;
}

/* C^T x of the rows as they are and as they were, with means x of the multipliers. */
static void mean_pulls(pmr_state *st, double *now, double *old)
{
    const pmr_system *y = st->system;
    int k, n;
    for (n = 0; n < y->modes; n += VL) V(now + n) = V(old + n) = (vec){0.0};
    for (k = 0; k < y->contacts; k++) {
        const double mean = 0.5 * (st->lambda[k] + st->old_lambda[k]);
        if (mean == 0.0) continue;
        for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL) {
            V(now + n) += CV(st->C + k * y->modes + n) * mean;
            V(old + n) += CV(st->old_C + k * y->modes + n) * mean;
        }
    }
}

/* Work of rows that have moved: what the modes contribute, twice. */
INLINE vec moved_rows(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    vec moved = {0.0};
    int k, n;
    if (y->whole && !y->coupled) {
        for (n = 0; n < y->modes; n += VL) {
            vec a = {0.0}, b = {0.0};
            for (k = 0; k < y->contacts; k++) {
                const double mean = 0.5 * (st->lambda[k] + st->old_lambda[k]);
                a += CV(st->C + k * y->modes + n) * mean;
                b += CV(st->old_C + k * y->modes + n) * mean;
            }
            moved += (a - b) * (CV(st->z + n) + CV(st->old_z + n)) + (a * a - b * b) * CV(c->unit + n) * c->z_gain;
        }
        return moved;
    }
    mean_pulls(st, st->turned, st->weighted);
    for (n = 0; n < y->modes; n += VL) {
        vec a = CV(st->turned + n), b = CV(st->weighted + n);
        moved += (a - b) * (CV(st->z + n) + CV(st->old_z + n));
        if (!y->coupled) moved += (a * a - b * b) * CV(c->unit + n) * c->z_gain;
    }
    if (y->coupled) {
        const double change = coupled_product(st, c, st->turned) - coupled_product(st, c, st->weighted);
        vec coupled = {0.0};
        double *first = (double *)&coupled;
        *first = change * c->z_gain;
        moved += coupled;
    }
    return moved;
}

/* (H + old H) (f + old f) of a contact: four times what loads move it by themselves, in the mean. */
INLINE double pushed_mean(const pmr_system *y, const double *H, const double *old_H, const double *f,
                          const double *old_f)
{
    double sum = 0.0;
    vec sums = {0.0};
    int l;
    if (y->ip > MANY_INPUTS) {
        for (l = 0; l < y->ip; l += VL) sums += (CV(H + l) + CV(old_H + l)) * (CV(f + l) + CV(old_f + l));
        return sum_of(sums);
    }
    for (l = 0; l < y->inputs; l++) sum += (H[l] + old_H[l]) * (f[l] + old_f[l]);
    return sum;
}

static void account(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    vec held = {0.0}, moved = {0.0};
    double stored, work, quadratic = 0.0;
    int k, n, l;
    find_load_energy(st);
    stored = st->load_energy;
    work = st->load_energy - st->old_load_energy;
    for (k = 0; k < y->contacts; k++) { /* A lambda = what the rows would come out by, where they hold */
        const double now = st->lambda[k], old = st->old_lambda[k], mean = 0.5 * (now + old), change = now - old;
        const double *H = st->H + k * y->ip, *old_H = (st->moved ? st->old_H : st->H) + k * y->ip;
        if (now == 0.0 && old == 0.0) continue;
        stored += now * (st->excess[k] - 2.0 * st->pushed[k]);
        work -= 0.5 * change * pushed_mean(y, H, old_H, st->loads, st->old_loads);
        if (!st->moved) continue;
        for (l = 0; l < k; l++)
            quadratic +=
                (st->A[k * y->mp + l] - st->old_A[k * y->mp + l]) * (mean * (st->lambda[l] + st->old_lambda[l]));
        quadratic += (st->A[k * y->mp + k] - st->old_A[k * y->mp + k]) * mean * mean;
    }
    for (n = 0; n < y->modes; n += VL) {
        vec z = CV(st->z + n), v = CV(st->v + n);
        held += v * v + CV(y->omega2 + n) * z * z;
        if (!y->coupled) held -= over_S_product(c, st->pulled, st->pulled, n) * c->z_gain;
        moved += (CV(st->push + n) + CV(st->old_push + n)) * (z - CV(st->old_z + n));
    }
    if (y->coupled) stored -= c->z_gain * coupled_product(st, c, st->pulled);
    if (st->moved) moved += moved_rows(st, c);
    st->energy[0] = 0.5 * (stored + sum_of(held));
    st->energy[1] += 0.5 * (work + sum_of(moved) - quadratic);
    keep_end(st);
}
