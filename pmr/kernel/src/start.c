/* Start of a simulation: coordinates, accelerations and multipliers at t = 0. */

#define STATIC_TRIES 1000
/* Share of the lowest omega^2 that holds what open contacts leave free for the moment, and what it may change. */
#define ALMOST_FREE 1e-8
#define UNCHANGED 1e-3
#define BALANCED 1e-9
/* Steps towards an equilibrium with terms, solves in each, and what the share of the lowest omega^2 is multiplied with
   after a step that has a solution and after one that has none. */
#define STATIC_STEPS 100
#define FEW_TRIES 50
#define SMALLER 0.5
#define LARGER 4.0
/* Where stability is asked for: flexibility of a rigid contact over that of the stiffest mode there, and the share by
   which others give way more, as their flexibility may be singular. */
#define SPRING_OF_RIGID 1e-3
#define SOFTER 1e-6
/* What is left of a row that depends on those before; violation of a rigid contact by rates that is round-off. */
#define DEPENDENT_ROW 1e-13
#define VIOLATED 1e-8

/* L U of a matrix (n, n) in its place, with partial pivoting: which row came to each; 1 if it is singular. */
static int factorise_dense(int n, double *A, int32_t *rows)
{
    int i, j, k;
    for (k = 0; k < n; k++) {
        int best = k;
        for (i = k + 1; i < n; i++)
            if (fabs(A[(size_t)i * n + k]) > fabs(A[(size_t)best * n + k])) best = i;
        if (!(fabs(A[(size_t)best * n + k]) > 0.0)) return 1;
        rows[k] = best;
        for (j = 0; best != k && j < n; j++) {
            const double entry = A[(size_t)k * n + j];
            A[(size_t)k * n + j] = A[(size_t)best * n + j];
            A[(size_t)best * n + j] = entry;
        }
        for (i = k + 1; i < n; i++) {
            const double factor = A[(size_t)i * n + k] / A[(size_t)k * n + k];
            A[(size_t)i * n + k] = factor;
            for (j = k + 1; factor != 0.0 && j < n; j++) A[(size_t)i * n + j] -= factor * A[(size_t)k * n + j];
        }
    }
    return 0;
}

/* x in place of b, with that factor. */
static void solve_factored(int n, const double *A, const int32_t *rows, double *x)
{
    int j, k;
    for (k = 0; k < n; k++) {
        const double value = x[rows[k]];
        x[rows[k]] = x[k];
        x[k] = value;
    }
    for (k = 0; k < n; k++)
        for (j = 0; j < k; j++) x[k] -= A[(size_t)k * n + j] * x[j];
    for (k = n - 1; k >= 0; k--) {
        for (j = k + 1; j < n; j++) x[k] -= A[(size_t)k * n + j] * x[j];
        x[k] /= A[(size_t)k * n + k];
    }
}

/* Solve A x = b (n), x in place of b, improved once by what is left; 1 if A is singular.  `room` has n (n + 2)
   doubles. */
static int solve_dense(int n, const double *A, double *x, double *room)
{
    double *factor = room, *b = factor + (size_t)n * n, *left = b;
    int32_t *rows = (int32_t *)(b + n);
    int k, j;
    memcpy(factor, A, (size_t)n * n * sizeof(double));
    copy(b, x, n);
    if (factorise_dense(n, factor, rows)) return 1;
    solve_factored(n, factor, rows, x);
    for (k = 0; k < n; k++)
        for (j = 0; j < n; j++) left[k] -= A[(size_t)k * n + j] * x[j];
    solve_factored(n, factor, rows, left);
    for (k = 0; k < n; k++) x[k] += left[k];
    return 0;
}

/* How far a unit force at contact k moves it by the system's elastic modes, those of rigid motions left out. */
static double modal_flexibility(const pmr_state *st, int k)
{
    const pmr_system *y = st->system;
    const double *row = st->C + (size_t)k * y->modes;
    vec sum = {0.0};
    int n;
    for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL)
        sum += CV(row + n) * CV(row + n) * CONST_LOOSE(y->give + n);
    return sum_of(sum);
}

/* Whether contact k is rigid: where the rows stand with a scheme without a step, whose A is F.  As F is semidefinite its
   diagonal decides.  So small a share of the largest, or of what modes give way by, is round-off: a model with all modes
   leaves nothing else. */
#define ROUND_OFF_OF_F 1e-14
static int is_rigid_by(const pmr_state *st, const double *F, int k)
{
    const pmr_system *y = st->system;
    double largest = modal_flexibility(st, k);
    int l;
    for (l = 0; l < y->contacts; l++) largest = larger(largest, F[l * y->mp + l]);
    return !(F[k * y->mp + k] > ROUND_OFF_OF_F * largest);
}

static int is_rigid(const pmr_state *st, int k) { return is_rigid_by(st, st->A, k); }

/* [K + floor, C^T; C, -F] in `scratch`, open contacts left out; without `loaded` no terms. */
static double *fill_held(pmr_state *st, double floor, int loaded)
{
    const pmr_system *y = st->system;
    const int r = y->modes, size = r + y->contacts;
    double *A = st->scratch;
    int k, l, n, u;
    memset(A, 0, (size_t)size * size * sizeof(double));
    for (n = 0; n < r; n++) A[(size_t)n * size + n] = y->omega2[n] + floor;
    if (y->registers && loaded)
        for (k = 0; k < r / PMR_LANES; k++)
            for (u = y->of_rows[3 * k]; u < y->of_rows[3 * k + 1]; u++)
                for (l = 0; l < PMR_LANES; l++)
                    A[(size_t)(PMR_LANES * k + l) * size + y->columns[u]] += st->now[PMR_LANES * u + l];
    for (n = 0; n < r; n++)
        if (is_fill(y, n)) A[(size_t)n * size + n] = 1.0; /* what fills a body up */
    for (k = 0; k < y->contacts; k++) {
        double *row = A + (size_t)(r + k) * size;
        if (st->closed[k] == 0.0) {
            row[r + k] = 1.0;
            continue;
        }
        for (n = 0; n < r; n++) row[n] = A[(size_t)n * size + r + k] = st->C[k * r + n];
        for (l = 0; l < y->contacts; l++) row[r + l] = -st->A[(k > l ? k : l) * y->mp + (k > l ? l : k)];
    }
    return A;
}

/* x of [K + floor, C^T; C, -F] (z, lambda) = (forces, clearance - H f), as `fill_held` has the matrix; without `loaded`
   no clearance and no H f. */
static int solve_held(pmr_state *st, double floor, const double *forces, int loaded, double *x)
{
    const pmr_system *y = st->system;
    const int r = y->modes, size = r + y->contacts;
    double *A = fill_held(st, floor, loaded);
    int k, n;
    for (n = 0; n < r; n++) x[n] = is_fill(y, n) ? 0.0 : forces[n];
    for (k = 0; k < y->contacts; k++)
        x[r + k] = loaded && st->closed[k] != 0.0 ? y->clearance[k] - st->pushed[k] : 0.0;
    return solve_dense(size, A, x, A + (size_t)size * size);
}

/* Whether K + floor with the terms is positive definite on what the closed contacts leave free, those that give way
   as springs.  Without pivots, contacts before coordinates, the factor of the symmetric part has a negative pivot for
   each closed contact and positive ones else.  A rigid contact is a spring much stiffer than the stiffest mode. */
static int is_stable(pmr_state *st, double floor)
{
    const pmr_system *y = st->system;
    const int r = y->modes, size = r + y->contacts;
    double *A = fill_held(st, floor, 1), stiffest = 0.0, longest = 0.0;
    int i, j, k;
    for (i = 0; i < r; i++) {
        stiffest = larger(stiffest, fabs(A[(size_t)i * size + i]));
        for (j = 0; j < i; j++) {
            const double mean = 0.5 * (A[(size_t)i * size + j] + A[(size_t)j * size + i]);
            A[(size_t)i * size + j] = A[(size_t)j * size + i] = mean;
        }
    }
    for (k = 0; k < y->contacts; k++) longest = larger(longest, dot(st->C + (size_t)k * r, st->C + (size_t)k * r, 0, r));
    for (k = size - 1; k >= 0; k--) {
        const double *row = A + (size_t)k * size;
        const int closed = k >= r && st->closed[k - r] != 0.0;
        double pivot = row[k];
        if (closed) pivot -= is_rigid(st, k - r) ? SPRING_OF_RIGID * longest / stiffest : SOFTER * fabs(pivot);
        if (!(closed ? pivot < 0.0 : pivot > 0.0)) return 0;
        for (i = 0; i < k; i++) {
            const double factor = A[(size_t)i * size + k] / pivot;
            for (j = 0; factor != 0.0 && j < k; j++) A[(size_t)i * size + j] -= factor * row[j];
        }
    }
    return 1;
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

/* Equilibrium x of a stiffness K + floor under forces, of which those that push are found from the closed ones on.
   After `limit` solves some may still be wrong: PMR_UNSETTLED. */
static int close_contacts(pmr_state *st, double floor, const double *forces, int limit, double *x)
{
    const int m = st->system->contacts;
    pmr_search search = {0, 0};
    int tries, k;
    for (tries = 0;; tries++) {
        if (solve_held(st, floor, forces, 1, x)) return PMR_DEPENDENT;
        if (!mark_unbalanced(st, x)) return PMR_DONE;
        if (tries == limit - 1) return PMR_UNSETTLED;
        choose_changes(m, st->wrong, &search);
        for (k = 0; k < m; k++)
            if (st->wrong[k]) st->closed[k] = 1.0 - st->closed[k];
    }
}

/* Whether terms that act meet contacts that only push: then an equilibrium may be unstable. */
static int may_tip(const pmr_state *st)
{
    const pmr_system *y = st->system;
    int u;
    for (u = 0; y->pushing && u < PMR_LANES * y->registers; u++)
        if (st->now[u] != 0.0) return 1;
    return 0;
}

/* Whether the bodies stand by K alone with the closed contacts, as `almost` with a little more than K, and with terms
   stably but for a `floor`: then z and multipliers. */
static int stands(pmr_state *st, const double *almost, double floor)
{
    const pmr_system *y = st->system;
    double *x = st->held, largest = 0.0, off = 0.0;
    int k, n;
    if (solve_held(st, 0.0, st->push, 1, x)) return 0;
    for (n = 0; n < y->modes; n++) {
        largest = larger(largest, fabs(x[n]));
        off = larger(off, fabs(x[n] - almost[n]));
    }
    if (!(off <= UNCHANGED * largest) || mark_unbalanced(st, x)) return 0;
    if (may_tip(st) && !is_stable(st, floor)) return 0;
    copy(st->z, x, y->modes);
    for (k = 0; k < y->contacts; k++) st->lambda[k] = st->closed[k] == 0.0 ? 0.0 : x[y->modes + k];
    return 1;
}

static void close_all(pmr_state *st)
{
    int k;
    for (k = 0; k < st->system->contacts; k++) st->closed[k] = 1.0;
}

/* Equilibrium under the loads: z and multipliers.  What open contacts leave free for the moment is held by a share of
   the lowest omega^2, of which the last solve has none.

   Terms may make K indefinite while contacts are open: then changing sides need not end, or ends where the bodies stand
   unstably.  So the energy is minimised in steps, each with a share of omega^2 added and its force at the last z taken
   away; where they come to rest the bodies stand by themselves (Rockafellar 1976).  A step has one solution where the
   share is large enough, and the smaller it is the longer is the step. */
static int find_equilibrium(pmr_state *st)
{
    const pmr_system *y = st->system;
    const int size = y->modes + y->contacts;
    double *x = st->held, *almost = x + size, *next = almost + size, *forces = st->others, *closed = st->before_closed,
           product = 0.0, square = 0.0, softest, neutral, share = 1.0;
    int n, step, settled;
    close_all(st);
    for (n = 0; n < y->modes; n++) forces[n] = !is_fill(y, n);
    if (solve_held(st, 0.0, forces, 0, x)) return PMR_DEPENDENT;
    for (n = 0; n < y->modes; n++) {
        product += x[n];
        square += x[n] * x[n];
    }
    softest = fabs(product / square);
    neutral = ALMOST_FREE * softest;
    settled = close_contacts(st, y->pushing ? neutral : 0.0, st->push, STATIC_TRIES, almost);
    if (!settled && stands(st, almost, neutral)) return PMR_DONE;
    if (!may_tip(st)) return settled ? settled : PMR_DEPENDENT;
    close_all(st);
    copy(closed, st->closed, y->contacts);
    for (n = 0; n < y->modes; n++) almost[n] = 0.0;
    for (step = 0; step < STATIC_STEPS; step++) {
        const double floor = share * softest;
        for (n = 0; n < y->modes; n++) forces[n] = st->push[n] + floor * almost[n];
        copy(st->closed, closed, y->contacts);
        settled = close_contacts(st, floor, forces, FEW_TRIES, next);
        if (settled == PMR_DEPENDENT) return PMR_DEPENDENT;
        if (settled || !is_stable(st, floor)) {
            share *= LARGER;
            continue;
        }
        copy(almost, next, size);
        copy(closed, st->closed, y->contacts);
        if (stands(st, almost, neutral)) return PMR_DONE;
        share *= SMALLER;
    }
    return PMR_UNSETTLED;
}

/* Forces of contacts x (m) that hold the accelerations `free`, by least squares of C^T x = free; 0 where contacts
   depend on each other.  Rows of C are made orthonormal (Gram and Schmidt, twice): C = R^T Q. */
static int find_resting(pmr_state *st, const double *free, double *x)
{
    const pmr_system *y = st->system;
    const int r = y->modes, m = y->contacts;
    double *Q = st->scratch, *left = Q + (size_t)m * r, *R = left + r; /* registers are read of the first two */
    int k, j, n, time;
    memset(R, 0, (size_t)m * m * sizeof(double));
    copy(left, free, r);
    for (k = 0; k < m; k++) {
        double *q = Q + (size_t)k * r, length;
        const double *row = st->C + (size_t)k * r, whole = sqrt(dot(row, row, 0, r));
        copy(q, row, r);
        for (time = 0; time < 2; time++)
            for (j = 0; j < k; j++) {
                const double share = dot(Q + (size_t)j * r, q, 0, r);
                R[j * m + k] += share;
                add_share(q, Q + (size_t)j * r, -share, r);
            }
        length = sqrt(dot(q, q, 0, r));
        if (!(length > DEPENDENT_ROW * whole)) return 0;
        R[k * m + k] = length;
        for (n = 0; n < r; n++) q[n] /= length;
        x[k] = dot(q, left, 0, r);
        add_share(left, q, -x[k], r);
    }
    for (k = m - 1; k >= 0; k--) {
        for (j = k + 1; j < m; j++) x[k] -= R[k * m + j] * x[j];
        x[k] /= R[k * m + k];
    }
    return 1;
}

/* Whether forces x that let nothing accelerate explain the motion of contacts that give way but for round-off. */
static int is_resting(pmr_state *st, const double *free, double *x)
{
    const pmr_system *y = st->system;
    int k, l, n;
    if (!find_resting(st, free, x)) return 0;
    for (k = 0; k < y->contacts; k++) {
        const double *row = st->C + (size_t)k * y->modes;
        double off = st->pushed[k], size = 0.0;
        if (is_rigid(st, k)) continue;
        for (n = 0; n < y->modes; n++) {
            off += row[n] * st->z[n];
            size += fabs(row[n] * st->z[n]);
        }
        for (n = 0; n < y->inputs; n++) size += fabs(st->H[k * y->ip + n] * st->loads[n]);
        for (l = 0; l < y->contacts; l++) off -= *lower(st->A, y->mp, k, l) * x[l];
        if (!(fabs(off) <= DBL_EPSILON * y->modes * size)) return 0;
    }
    return 1;
}

/* Multipliers of the contacts that give way from where the bodies stand, of those that push which are closed.  Where
   these hardly give way, round-off of the motion is much in their forces: of a body that rests under the accelerations
   `free` without contacts they are those that hold it. */
static int find_giving(pmr_state *st, const double *free)
{
    const pmr_system *y = st->system;
    double *motion = st->held, *lambda = motion + y->mp;
    problem c = problem_of(st, motion, lambda, st->before_closed);
    int k, failed = PMR_DONE;
    if (y->pushing || !is_resting(st, free, lambda)) {
        for (k = 0; k < y->contacts; k++) { /* rigid ones stay open, as nothing is as far from its end */
            const double *row = st->C + k * y->modes;
            const int rigid = is_rigid(st, k);
            c.closed[k] = !rigid && !y->pushes[k];
            motion[k] = rigid ? -INFINITY : dot(row, st->z, 0, y->modes) + st->pushed[k] - y->clearance[k];
        }
        failed = settle(&c);
    }
    for (k = 0; k < y->contacts; k++) {
        const int rigid = is_rigid(st, k);
        st->lambda[k] = rigid || failed ? 0.0 : lambda[k];
        st->closed[k] = rigid || failed || !y->pushing ? !y->pushes[k] : c.closed[k];
    }
    if (failed) st->trouble = failed == PMR_DEPENDENT ? c.trouble : -1;
    return failed;
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
    return solve_dense(m, A, right, A + (size_t)m * m);
}

/* Set the prediction of the first step from z, v, accelerations and multipliers, and the energy. */
static int begin(pmr_state *st)
{
    const pmr_system *y = st->system;
    const pmr_scheme *c = st->scheme;
    int n, k, failed;
    predict(st, c);
    if (y->quasi_static) predict_quasi_static(st, c, st->z);
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
    if (y->hoist) store_hoist_energy(st);
    st->energy[1] = st->energy[2] = 0.0;
    return PMR_DONE;
}

/* Correct rates that violate rigid contacts which move with their paths by `rates` (P,) m/s, by the change of least
   kinetic energy, as an impulse of these contacts does it:

       C v + sum s' C_s z = 0,    v += C^T mu */
static int correct_rates(pmr_state *st, const pmr_scheme *still, const double *rates)
{
    const pmr_system *y = st->system;
    double *off = st->entries, largest_z = 0.0, largest_v = 0.0;
    int violated = 0, k, n, p;
    find_slopes(st, still);
    for (n = 0; n < y->modes; n++) {
        largest_z = larger(largest_z, fabs(st->z[n]));
        largest_v = larger(largest_v, fabs(st->v[n]));
    }
    for (k = 0; k < y->contacts; k++) {
        double size = 0.0;
        off[k] = 0.0;
        if (!is_rigid(st, k)) continue;
        for (n = 0; n < y->modes; n++) {
            double slope = 0.0;
            for (p = 0; p < y->paths; p++) slope += rates[p] * slopes_of(st, p).C[(size_t)k * y->modes + n];
            off[k] += st->C[(size_t)k * y->modes + n] * st->v[n] + slope * st->z[n];
            size += fabs(st->C[(size_t)k * y->modes + n]) * largest_v + fabs(slope) * largest_z;
        }
        violated |= fabs(off[k]) > VIOLATED * size;
    }
    if (!violated) return PMR_DONE;
    if (solve_rigid(st, off)) return PMR_DEPENDENT;
    for (k = 0; k < y->contacts; k++) add_share(st->v, st->C + (size_t)k * y->modes, -off[k], y->modes);
    return PMR_DONE;
}

/* Forces of the rope at the start, in equilibrium with the bodies where these are. */
static int start_hoist(pmr_state *st, int kind, const double *u)
{
    const pmr_system *y = st->system;
    double off, largest, before = INFINITY;
    int times, failed, k;
    for (times = 0; times < HOIST_TIMES; times++) {
        failed = begin_hoist(st, u);
        if (failed) return failed;
        off = largest = 0.0;
        for (k = 0; k < y->hoist; k++) {
            off = larger(off, fabs(st->new_pulls[k] - st->pulls[k]));
            largest = larger(largest, fabs(st->new_pulls[k]));
            st->pulls[k] = st->new_pulls[k];
        }
        load_bodies(st, u + y->paths);
        if (kind != PMR_IN_EQUILIBRIUM || (times && off <= HOIST_STILL * largest) ||
            (off <= HOIST_CLOSE * largest && off >= before))
            return PMR_DONE;
        before = off;
        failed = find_equilibrium(st);
        if (failed) return failed;
    }
    return PMR_UNCONVERGED;
}

static int start(pmr_state *st, int kind, const double *u, const double *rates, const double *z, const double *v)
{
    const pmr_system *y = st->system;
    const pmr_scheme *still = st->still;
    int n, failed, rigid = 0, k;
    if (!all_finite(u, y->drivers) || (rates && !all_finite(rates, y->paths))) return PMR_REFUSED;
    if (kind == PMR_GIVEN && !(all_finite(z, y->modes) && all_finite(v, y->modes))) return PMR_REFUSED;
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
    if (!failed && y->hoist)
        failed = start_hoist(st, kind, u);
    else if (kind == PMR_IN_EQUILIBRIUM)
        failed = find_equilibrium(st);
    if (!failed && rates) failed = correct_rates(st, still, rates);
    if (failed) return failed;
    begin_terms(st, u + y->paths + y->inputs);
    accelerate(st, u + y->paths, st->accelerated);
    if (kind != PMR_IN_EQUILIBRIUM) {
        failed = find_giving(st, st->accelerated);
        if (failed) return failed;
        subtract_rows(st, 0, y->contacts, st->accelerated);
    }
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
    if (y->hoist) { /* by now all forces are known by which the head is displaced */
        failed = begin_hoist(st, u);
        if (failed) return failed;
        show_pulls(st);
    }
    return begin(st);
}
