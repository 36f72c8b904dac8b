/* Derivatives of a part of a step, with the contacts that are closed staying so, column by column along seeds.

   With z_free = z* + z_gain S^-1 (B f + w - Omega^2 z* - D v*) the multipliers are A lambda = C z_free + H f - c, and
   so along a seed

       A d lambda = C d z_free + H df + sum over paths of ds (C_s z_free + H_s f - A_s lambda)
       S d z'' = B df + dw - Omega^2 dz* - D dv* - C^T d lambda - sum ds C_s^T lambda

   with C_s, H_s and A_s derivatives of the same polynomials that C, H and A are.  Forces w of terms follow from z and
   z' at the end of the step, friction from multipliers and paths, with pads that stick or slide going on so and what
   they remember of the step before staying as it is; both are found by the same iteration as in the step. */

/* Room of what changes with one path. */
typedef struct {
    double *C, *H, *A; /* (rows, r'), (rows, ip), (rows, mp): the lower half */
} path_slopes;

static size_t slope_room(const pmr_system *y) { return (size_t)y->rows * (y->modes + y->ip + y->mp); }

static path_slopes slopes_of(const pmr_state *st, int path)
{
    const pmr_system *y = st->system;
    double *first = st->slopes + (size_t)path * slope_room(y);
    const path_slopes of_path = {first, first + (size_t)y->rows * y->modes,
                                 first + (size_t)y->rows * (y->modes + y->ip)};
    return of_path;
}

/* How C, H and A change with each path where the rows stand; beyond the ends of a path nothing changes. */
static void find_slopes(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int p;
    memset(st->slopes, 0, (size_t)y->paths * slope_room(y) * sizeof(double));
    memset(st->moved_paths, 0, y->paths * sizeof(moved));
    for (p = 0; p < y->paths; p++) {
        const double *ends = y->path_ends + 2 * p;
        const path_slopes by = slopes_of(st, p);
        const moved_tables to = {.C = {NULL, by.C}, .H = {NULL, by.H}, .A = {NULL, by.A}};
        if (st->s[p] < ends[0] || st->s[p] > ends[1]) continue;
        st->moved_paths[p].rate = 1.0;
        move_rows(st, c, st->moved_paths, &to);
        st->moved_paths[p].rate = 0.0;
    }
}

/* What one seed makes of the end of a step. */
typedef struct {
    double *z_next, *v_next, *a_next; /* (r'): the seed, and afterwards what it makes of the next prediction */
    double *z, *v, *acceleration, *forces, *w, *free; /* (r') */
    double *lambda, *sums, *y;                        /* (mp), (joints): friction on cylinders, (op) */
    const double *u;                                          /* (N): the seed's drivers, or NULL */
} seed;

/* forces -= C^T d lambda + sum ds C_s^T lambda. */
static void subtract_seed_rows(const pmr_state *st, const seed *d, double *forces)
{
    const pmr_system *y = st->system;
    int k, n, p;
    for (k = 0; k < y->rows; k++) {
        for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL)
            V(forces + n) -= CV(st->C + (size_t)k * y->modes + n) * d->lambda[k];
        for (p = 0; d->u && p < y->paths; p++)
            if (d->u[p] != 0.0 && st->lambda[k] != 0.0)
                for (n = 0; n < y->modes; n++)
                    forces[n] -= d->u[p] * st->lambda[k] * slopes_of(st, p).C[(size_t)k * y->modes + n];
    }
}

/* How far a seed moves contact k, with what it makes of z_free. */
static double seed_motion(const pmr_state *st, const seed *d, int k)
{
    const pmr_system *y = st->system;
    double sum = dot(st->C + (size_t)k * y->modes, d->free, y->row_modes[2 * k], y->row_modes[2 * k + 1]);
    int n, p;
    for (n = y->contacts; n < y->rows; n++) sum -= st->A[n * y->mp + k] * d->lambda[n];
    for (n = 0; n < y->joints; n++)
        if (y->joint_cylinders[n] == k) sum -= y->joint_gives[n] * d->sums[n];
    if (!d->u) return sum;
    for (n = 0; n < y->inputs; n++) sum += st->H[k * y->ip + n] * d->u[y->paths + n];
    for (p = 0; p < y->paths; p++) {
        const path_slopes by = slopes_of(st, p);
        double of_path = 0.0;
        if (d->u[p] == 0.0) continue;
        for (n = 0; n < y->modes; n++) of_path += by.C[(size_t)k * y->modes + n] * st->z_free[n];
        for (n = 0; n < y->inputs; n++) of_path += by.H[k * y->ip + n] * st->loads[n];
        for (n = 0; n < y->rows; n++) of_path -= *lower(by.A, y->mp, k, n) * st->lambda[n];
        sum += d->u[p] * of_path;
    }
    return sum;
}

static void add_seed_loads(const pmr_system *y, const seed *d, double *forces)
{
    int l, n;
    for (l = 0; d->u && l < y->inputs; l++)
        for (n = 0; n < y->modes; n++) forces[n] += y->B[(size_t)l * y->modes + n] * d->u[y->paths + l];
}

/* Forces of terms and friction along a seed, by what it makes of z, z' and multipliers, and of terms by a change of
   amplitudes: 1 if they were so, else the next iterate. */
static int follow_forces(pmr_state *st, double h, seed *d, const double *of_amplitudes)
{
    const pmr_system *y = st->system;
    double change, size, gap = 0.0, gaps = 0.0;
    int n;
    if (y->registers) {
        find_terms(st, d->z, d->v, st->w_new);
        for (n = 0; n < y->modes; n++) st->w_new[n] += of_amplitudes[n];
    }
    if (y->pads) follow_friction(st, h, d->lambda, d->u, d->sums);
    set_iterate(st, d->w, d->lambda + y->contacts, d->sums);
    change = residual_square(st, &size);
    for (n = 0; n < y->joints; n++) {
        gap = larger(gap, y->joint_gives[n] * fabs(st->new_sums[n] - d->sums[n]));
        gaps = larger(gaps, y->joint_gives[n] * fabs(st->new_sums[n]));
    }
    if (change <= PMR_CONVERGED * PMR_CONVERGED * size && gap <= PMR_CONVERGED * gaps) return 1;
    extrapolate(&st->iteration);
    split_iterate(st, d->w, d->lambda + y->contacts, d->sums);
    return 0;
}

/* w of the step's end by a change of amplitudes. */
static void amplitude_forces(pmr_state *st, const double *amplitudes, double *w)
{
    combine_terms(st, amplitudes);
    find_terms(st, st->z, st->v, w);
}

/* The end of a step along a seed; 1 where forces of terms and friction do not converge. */
static int follow_seed(pmr_state *st, const pmr_scheme *c, seed *d, const double *of_amplitudes)
{
    const pmr_system *y = st->system;
    const int r = y->modes;
    double *bent = st->w_divided;
    int k, n, times;
    pmr_restart(&st->iteration);
    memset(d->w, 0, r * sizeof(double));
    for (k = 0; k < y->mp; k++) d->lambda[k] = 0.0;
    for (k = 0; k < y->joints; k++) d->sums[k] = 0.0;
    if (y->registers) copy(d->w, of_amplitudes, r);
    if (y->coupled)
        couple(st, c, d->z_next, d->v_next, bent);
    else
        for (n = 0; n < r; n += VL)
            V(bent + n) = -CV(c->stiffness + n) * CV(d->z_next + n) - CV(c->damping + n) * CV(d->v_next + n);
    for (times = 0; times < MOST_TIMES; times++) {
        copy(d->forces, d->w, r);
        add_seed_loads(y, d, d->forces);
        over_S(y, c, d->forces, 0, r, d->acceleration);
        for (n = 0; n < r; n += VL)
            V(d->free + n) = CV(d->z_next + n) + (CV(bent + n) + CV(d->acceleration + n)) * c->z_gain;
        for (k = 0; k < y->contacts; k++) d->lambda[k] = 0.0;
        if (y->pushing) {
            for (n = 0; n < st->factored; n++) st->entries[n] = seed_motion(st, d, st->numbers[n]);
            solve(st->factor, st->factored, y->mp, st->entries);
            for (n = 0; n < st->factored; n++) d->lambda[st->numbers[n]] = st->entries[n];
        } else {
            for (k = 0; k < y->contacts; k++) d->lambda[k] = seed_motion(st, d, k);
            solve(st->factor, y->contacts, y->mp, d->lambda);
        }
        subtract_seed_rows(st, d, d->forces);
        over_S(y, c, d->forces, 0, r, d->acceleration);
        for (n = 0; n < r; n += VL) {
            const vec acceleration = CV(d->acceleration + n) + CV(bent + n);
            V(d->acceleration + n) = acceleration;
            V(d->z + n) = CV(d->z_next + n) + acceleration * c->z_gain;
            V(d->v + n) = CV(d->v_next + n) + acceleration * c->v_gain;
        }
        if ((!y->registers && !y->pads) || follow_forces(st, c->h, d, of_amplitudes)) return 0;
    }
    return 1;
}

/* What a seed makes of the next prediction, in place of it. */
static void predict_seed(const pmr_state *st, const pmr_scheme *c, seed *d)
{
    const pmr_system *y = st->system;
    int n, k;
    for (n = 0; n < y->modes; n++) {
        const double a = d->acceleration[n], z = d->z_next[n], v = d->v_next[n], before = d->a_next[n];
        d->z_next[n] = z + v * c->z_from_v + before * c->z_from_a + a * c->z_from_acceleration;
        d->v_next[n] = v + before * c->v_from_a + a * c->v_from_acceleration;
        d->a_next[n] = before * c->a_from_a + a * c->a_from_acceleration;
    }
    for (k = 0; k < y->quasi_static; k++) {
        n = y->of_modes[k];
        d->z_next[n] = d->z[n] * lasting_share(y, c, n);
        d->v_next[n] = d->a_next[n] = 0.0;
    }
}

/* Where a part to drivers u ends, with how rows change by paths, and room for seeds of it in `d`. */
static int open_seeds(pmr_state *st, const pmr_scheme *c, const double *u, seed *d)
{
    const pmr_system *y = st->system;
    const size_t r = y->modes;
    double *room = st->seeds;
    int failed = place(st, c, u);
    if (failed) return failed;
    copy(st->z_before, st->z, y->modes);
    load_bodies(st, u + y->paths);
    push_free(st, c);
    if (y->registers || y->pads) expect_terms(st, c, u + y->paths + y->inputs);
    failed = find_multipliers(st, c);
    if (failed) return failed;
    find_slopes(st, c);
    *d = (seed){.z_next = room,
                .v_next = room + r,
                .a_next = room + 2 * r,
                .z = room + 3 * r,
                .v = room + 4 * r,
                .acceleration = room + 5 * r,
                .forces = room + 6 * r,
                .w = room + 7 * r,
                .free = room + 8 * r,
                .lambda = st->motion,
                .sums = room + 10 * r + y->drivers,
                .y = st->values};
    return PMR_DONE;
}

/* The part's end along the seed of this number, among numbers z*, v*, a* (3 r') and drivers behind them. */
static int follow_column(pmr_state *st, const pmr_scheme *c, const double *u, size_t column, seed *d)
{
    const pmr_system *y = st->system;
    const size_t r = y->modes;
    double *of_amplitudes = st->seeds + 9 * r, *unit = st->seeds + 10 * r;
    memset(d->z_next, 0, 3 * r * sizeof(double));
    memset(of_amplitudes, 0, r * sizeof(double));
    d->u = NULL;
    if (column < 3 * r) {
        d->z_next[column] = 1.0;
    } else {
        memset(unit, 0, y->drivers * sizeof(double));
        unit[column - 3 * r] = 1.0;
        d->u = unit;
        if (column >= 3 * r + y->paths + y->inputs) {
            amplitude_forces(st, unit + y->paths + y->inputs, of_amplitudes);
            combine_terms(st, u + y->paths + y->inputs);
        }
    }
    return follow_seed(st, c, d, of_amplitudes);
}

static void seed_outputs(pmr_state *st, const seed *d)
{
    const pmr_system *y = st->system;
    find_outputs(st, y->observed, 0, y->op, d->z, d->u ? d->u + y->paths : NULL, d->lambda, d->u, d->y);
}

/* The scheme of the next step. */
static const pmr_scheme *next_scheme(const pmr_state *st)
{
    return st->scheme + (st->progress.active < 0 ? 0 : st->progress.active);
}
