/* Start of a simulation: coordinates, accelerations and multipliers at t = 0. */

#define STATIC_TRIES 1000
/* Share of the lowest omega^2 that holds what open contacts leave free for the moment, and what it may change. */
#define ALMOST_FREE 1e-8
#define UNCHANGED 1e-3
#define BALANCED 1e-9

/* Solve A x = b (n) with partial pivoting, x in place of b; 1 if A is singular. */
static int solve_dense(int n, double *A, double *x)
{
    int i, j, k;
    for (k = 0; k < n; k++) {
        int best = k;
        for (i = k + 1; i < n; i++)
            if (fabs(A[(size_t)i * n + k]) > fabs(A[(size_t)best * n + k])) best = i;
        if (!(fabs(A[(size_t)best * n + k]) > 0.0)) return 1;
        if (best != k) {
            const double value = x[k];
            for (j = 0; j < n; j++) {
                const double entry = A[(size_t)k * n + j];
                A[(size_t)k * n + j] = A[(size_t)best * n + j];
                A[(size_t)best * n + j] = entry;
            }
            x[k] = x[best];
            x[best] = value;
        }
        for (i = k + 1; i < n; i++) {
            const double factor = A[(size_t)i * n + k] / A[(size_t)k * n + k];
            if (factor == 0.0) continue;
            for (j = k + 1; j < n; j++) A[(size_t)i * n + j] -= factor * A[(size_t)k * n + j];
            x[i] -= factor * x[k];
        }
    }
    for (k = n - 1; k >= 0; k--) {
        double value = x[k];
        for (j = k + 1; j < n; j++) value -= A[(size_t)k * n + j] * x[j];
        x[k] = value / A[(size_t)k * n + k];
    }
    return 0;
}

/* The same with a step of refinement, without which soft and stiff rows blur each other; A (2, n, n) and `work` (n). */
static int solve_refined(int n, double *A, double *x, double *work)
{
    double *whole = A + (size_t)n * n;
    int i, j;
    memcpy(whole, A, (size_t)n * n * sizeof(double));
    copy(work, x, n);
    if (solve_dense(n, A, x)) return 1;
    for (i = 0; i < n; i++)
        for (j = 0; j < n; j++) work[i] -= whole[(size_t)i * n + j] * x[j];
    if (solve_dense(n, whole, work)) return 1;
    for (i = 0; i < n; i++) x[i] += work[i];
    return 0;
}

/* Whether contact k is rigid: where the rows stand with a scheme without a step, whose A is F. */
static int is_rigid(const pmr_state *st, int k)
{
    const pmr_system *y = st->system;
    int l;
    for (l = 0; l < y->contacts; l++)
        if (st->A[(k > l ? k : l) * y->mp + (k > l ? l : k)] != 0.0) return 0;
    return 1;
}

/* [K + floor, C^T; C, -F] (z, lambda) = (forces, clearance - H f), open contacts left out; without `loaded` no
   clearance and no H f. */
static int solve_held(pmr_state *st, double floor, const double *forces, int loaded, double *x)
{
    const pmr_system *y = st->system;
    const int r = y->modes, size = r + y->contacts;
    double *A = st->scratch;
    int k, l, n, u;
    memset(A, 0, (size_t)size * size * sizeof(double));
    for (n = 0; n < r; n++) {
        A[(size_t)n * size + n] = y->omega2[n] + floor;
        x[n] = forces[n];
    }
    if (y->registers)
        for (k = 0; k < r / PMR_LANES; k++)
            for (u = y->of_rows[3 * k]; u < y->of_rows[3 * k + 1]; u++)
                for (l = 0; l < PMR_LANES; l++)
                    A[(size_t)(PMR_LANES * k + l) * size + y->columns[u]] += st->now[PMR_LANES * u + l];
    for (n = 0; n < r; n++)
        if (is_fill(y, n)) { /* what fills a body up */
            A[(size_t)n * size + n] = 1.0;
            x[n] = 0.0;
        }
    for (k = 0; k < y->contacts; k++) {
        double *row = A + (size_t)(r + k) * size;
        x[r + k] = 0.0;
        if (st->closed[k] == 0.0) {
            row[r + k] = 1.0;
            continue;
        }
        for (n = 0; n < r; n++) row[n] = A[(size_t)n * size + r + k] = st->C[k * r + n];
        for (l = 0; l < y->contacts; l++) row[r + l] = -st->A[(k > l ? k : l) * y->mp + (k > l ? l : k)];
        if (loaded) x[r + k] = y->clearance[k] - st->pushed[k];
    }
    return solve_refined(size, A, x, st->held + 2 * (r + y->mp));
}

/* Contacts that pull although they only push, or would have to push although they are open: their number, each
   marked. */
static int mark_unbalanced(pmr_state *st, const double *x)
{
    const pmr_system *y = st->system;
    const double *lambda = x + y->modes;
    double largest = 0.0;
    int count = 0, k, l, n;
    for (k = 0; k < y->contacts; k++) largest = larger(largest, fabs(lambda[k]));
    for (k = 0; k < y->contacts; k++) {
        double size = y->clearance[k], motion = st->pushed[k];
        st->wrong[k] = 0;
        if (!y->pushes[k]) continue;
        for (n = 0; n < y->modes; n++) {
            const double part = st->C[k * y->modes + n] * x[n];
            size += fabs(part);
            motion += part;
        }
        for (l = 0; l < y->contacts; l++) motion -= st->A[(k > l ? k : l) * y->mp + (k > l ? l : k)] * lambda[l];
        st->wrong[k] =
            st->closed[k] != 0.0 ? lambda[k] < -BALANCED * largest : motion - y->clearance[k] > BALANCED * size;
        count += st->wrong[k];
    }
    return count;
}

/* Equilibrium under the loads: z and multipliers.  What open contacts leave free for the moment is held by a share of
   the lowest omega^2, of which the last solve has none. */
static int find_equilibrium(pmr_state *st)
{
    const pmr_system *y = st->system;
    double *x = st->held, *held = st->held + y->modes + y->contacts, *forces = st->others, floor, product = 0.0,
           square = 0.0, largest = 0.0, off = 0.0;
    int fewest = y->contacts + 1, chances = CHANCES, tries, k, n;
    for (k = 0; k < y->contacts; k++) st->closed[k] = 1.0;
    for (n = 0; n < y->modes; n++) forces[n] = !is_fill(y, n);
    if (solve_held(st, 0.0, forces, 0, x)) return PMR_DEPENDENT;
    for (n = 0; n < y->modes; n++) {
        product += x[n];
        square += x[n] * x[n];
    }
    floor = y->pushing ? ALMOST_FREE * fabs(product / square) : 0.0;
    copy(forces, st->push, y->modes);
    for (tries = 0; tries < STATIC_TRIES; tries++) {
        int count, changes;
        if (solve_held(st, floor, forces, 1, held)) return PMR_DEPENDENT;
        count = mark_unbalanced(st, held);
        if (!count) break;
        if (count < fewest) {
            fewest = count;
            chances = CHANCES;
        } else {
            chances--;
        }
        changes = chances >= 0 ? count : 1;
        for (k = 0; k < y->contacts; k++)
            if (st->wrong[k] && changes-- > 0) st->closed[k] = 1.0 - st->closed[k];
    }
    if (tries == STATIC_TRIES) return PMR_UNSETTLED;
    if (solve_held(st, 0.0, forces, 1, x)) return PMR_DEPENDENT;
    for (n = 0; n < y->modes; n++) {
        largest = larger(largest, fabs(x[n]));
        off = larger(off, fabs(x[n] - held[n]));
    }
    if (!(off <= UNCHANGED * largest) || mark_unbalanced(st, x)) return PMR_DEPENDENT;
    copy(st->z, x, y->modes);
    copy(st->lambda, x + y->modes, y->contacts);
    for (k = 0; k < y->contacts; k++)
        if (st->closed[k] == 0.0) st->lambda[k] = 0.0;
    return PMR_DONE;
}

/* Multipliers of the contacts that give way from where the bodies stand, of those that push which are closed. */
static int find_giving(pmr_state *st)
{
    const pmr_system *y = st->system;
    int32_t *giving = st->numbers;
    double *F = st->scratch, *b = st->held, *lambda = b + y->mp, *factor;
    int count = 0, k, l, failed;
    problem c = {.pushes = st->wrong,
                 .excess = b,
                 .lambda = lambda,
                 .closed = st->before_closed,
                 .entries = st->entries,
                 .factored = -1};
    for (k = 0; k < y->contacts; k++)
        if (!is_rigid(st, k)) giving[count++] = k;
    factor = F + (size_t)count * count;
    for (k = 0; k < count; k++) {
        const double *row = st->C + giving[k] * y->modes;
        b[k] = dot(row, st->z, 0, y->modes) + st->pushed[giving[k]] - y->clearance[giving[k]];
        for (l = 0; l <= k; l++) F[(size_t)k * count + l] = st->A[giving[k] * y->mp + giving[l]];
        st->wrong[k] = y->pushes[giving[k]];
        st->before_closed[k] = !y->pushes[giving[k]];
    }
    c.rows = c.stride = count;
    c.A = F;
    c.factor = factor;
    c.numbers = (int32_t *)(factor + (size_t)count * count);
    c.wrong = c.numbers + count;
    failed = settle(&c);
    if (failed) {
        st->trouble = failed == PMR_DEPENDENT ? giving[c.trouble] : -1;
        return failed;
    }
    for (k = 0; k < y->contacts; k++) {
        st->lambda[k] = 0.0;
        st->closed[k] = !y->pushes[k];
    }
    for (k = 0; k < count; k++) {
        st->lambda[giving[k]] = lambda[k];
        st->closed[giving[k]] = st->before_closed[k];
    }
    return PMR_DONE;
}

/* Of rigid contacts x with C C^T x = right (rows), zero at the others. */
static int solve_rigid(pmr_state *st, double *right)
{
    const pmr_system *y = st->system;
    const int m = y->contacts;
    double *A = st->scratch;
    int k, l;
    for (k = 0; k < m; k++) {
        const int rigid = is_rigid(st, k);
        if (!rigid) right[k] = 0.0;
        for (l = 0; l < m; l++) {
            const int both = rigid && is_rigid(st, l);
            A[(size_t)k * m + l] = both ? dot(st->C + k * y->modes, st->C + l * y->modes, 0, y->modes) : k == l;
        }
    }
    return solve_dense(m, A, right);
}

/* Set the prediction of the first step from z, v, accelerations and multipliers, and the energy. */
static int begin(pmr_state *st)
{
    const pmr_system *y = st->system;
    const pmr_scheme *c = st->scheme;
    int n, k, failed;
    for (n = 0; n < y->modes; n++) {
        const double a = st->accelerated[n];
        st->z_next[n] = st->z[n] + st->v[n] * c->z_from_v + a * (c->z_from_force + c->z_from_share);
        st->v_next[n] = st->v[n] + a * (c->v_from_force + c->v_from_share);
        st->a_next[n] = a * (c->a_from_force + c->a_from_share);
    }
    free_motion(st, c);
    if (y->quasi_static) predict_quasi_static(st, c, st->z);
    for (k = 0; k < y->contacts; k++) st->force[k] = st->share[k] = y->pushing ? st->lambda[k] : 0.0;
    for (k = 0; k < y->joints; k++) {
        st->travelled[k] = st->u[y->joint_paths[k]];
        st->drives[k] = y->joint_cylinders[k] < 0 ? 0.0 : st->lambda[y->joint_cylinders[k]];
    }
    st->progress = (pmr_progress){.came = -1, .parts = st->settings.parts[0]};
    failed = stand(st);
    if (failed) return failed;
    for (k = 0; k < y->contacts; k++) {
        st->excess[k] = 0.0; /* A lambda */
        for (n = 0; n < y->contacts; n++)
            st->excess[k] += st->A[(k > n ? k : n) * y->mp + (k > n ? n : k)] * st->lambda[n];
    }
    for (n = 0; n < y->modes; n++) st->pulled[n] = 0.0;
    subtract_rows(st, 0, y->contacts, st->pulled);
    load_bodies(st, st->u + y->paths); /* those of `stand` are those of the step before by now */
    account(st, c);                    /* p enters by its square */
    st->energy[1] = st->energy[2] = 0.0;
    return PMR_DONE;
}

static int start_from(pmr_state *st, const double *u, const double *z, const double *v, const double *a,
                      const double *multipliers, const int32_t *closed)
{
    const pmr_system *y = st->system;
    int k;
    memset(st->mark, 0, st->saved * sizeof(double));
    copy(st->u, u, y->drivers);
    copy(st->z, z, y->modes);
    copy(st->v, v, y->modes);
    copy(st->accelerated, a, y->modes);
    for (k = 0; k < y->contacts; k++) {
        st->lambda[k] = multipliers[k];
        st->closed[k] = closed ? closed[k] != 0 : 1.0;
    }
    begin_terms(st, u + y->paths + y->inputs);
    return begin(st);
}

static int start(pmr_state *st, int kind, const double *u, const double *z, const double *v)
{
    const pmr_system *y = st->system;
    const pmr_scheme *still = st->still;
    int n, failed, rigid = 0, k;
    memset(st->mark, 0, st->saved * sizeof(double));
    copy(st->u, u, y->drivers);
    st->placed = 0;
    st->moved = 1;
    failed = place(st, still, u);
    /* without a step F may be singular, as of rigid contacts: it is solved for below */
    if (failed == PMR_DEPENDENT) failed = PMR_DONE;
    st->trouble = -1;
    load_bodies(st, u + y->paths);
    if (kind == PMR_GIVEN) {
        copy(st->z, z, y->modes);
        copy(st->v, v, y->modes);
    }
    if (y->registers) combine_terms(st, u + y->paths + y->inputs);
    failed = kind == PMR_IN_EQUILIBRIUM ? find_equilibrium(st) : find_giving(st);
    if (failed) return failed;
    begin_terms(st, u + y->paths + y->inputs);
    accelerate(st, u + y->paths, st->accelerated);
    for (k = 0; k < y->contacts; k++) {
        st->entries[k] = dot(st->C + k * y->modes, st->accelerated, 0, y->modes);
        rigid |= is_rigid(st, k);
    }
    if (rigid) { /* of equilibrium this adds nothing but round-off */
        if (solve_rigid(st, st->entries)) return PMR_DEPENDENT;
        for (k = 0; k < y->contacts; k++) {
            if (!is_rigid(st, k)) continue;
            st->lambda[k] += st->entries[k];
            for (n = 0; n < y->modes; n++) st->accelerated[n] -= st->C[k * y->modes + n] * st->entries[k];
        }
    }
    for (k = 0; k < y->quasi_static; k++) st->accelerated[y->of_modes[k]] = 0.0;
    return begin(st);
}
