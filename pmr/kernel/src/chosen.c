/* Linear models of steps for outputs that are chosen, with rates of those that are velocities and accelerations. */

static size_t linear_work(const pmr_state *st)
{
    const pmr_system *y = st->system;
    const size_t n = 3 * (size_t)y->modes, N = y->drivers, o = y->outputs, m = y->contacts;
    return (2 * n + o + m) * (n + N) + o + y->forces + n + N + 1;
}

/* Columns of a matrix (., columns), those of a row, by their numbers. */
static void pick(const double *row, const int32_t *numbers, int count, double *to)
{
    int k;
    for (k = 0; k < count; k++) to[k] = row[numbers[k]];
}

/* A row (r' of z, v and a) of the modes that are used. */
static void pick_modes_of(const pmr_chosen *c, const double *row, int modes, double *to)
{
    int part;
    for (part = 0; part < 3; part++) pick(row + part * modes, c->at_modes, c->modes, to + part * c->modes);
}

static int linear_matrices(pmr_state *st, const pmr_chosen *c, const double *u, double *work, const pmr_linear_step *to)
{
    const pmr_system *y = st->system;
    const size_t n = 3 * (size_t)y->modes, N = y->drivers, o = y->outputs, m = y->contacts, count = 3 * (size_t)c->modes;
    double *A = work, *E = A + n * n, *C = E + n * n, *L = C + o * n, *B = L + m * n, *G = B + n * N, *D = G + n * N;
    double *K = D + o * N, *row = K + m * N;
    const pmr_jacobian jacobian = {.A = A, .B = B, .C = C, .D = D, .L = L, .K = K, .E = E, .G = G};
    const int failed = linearize(st, u, &jacobian);
    size_t k, j, i;
    if (failed) return failed;
    for (k = 0; k < count; k++) {
        const size_t at = k / c->modes * y->modes + c->at_modes[k % c->modes];
        pick_modes_of(c, A + at * n, y->modes, to->A + k * count);
        pick_modes_of(c, E + at * n, y->modes, to->E + k * count);
        pick(B + at * N, c->loads, c->inputs, to->B + k * c->inputs);
        pick(G + at * N, c->loads, c->inputs, to->G + k * c->inputs);
    }
    for (k = 0; k < (size_t)c->outputs; k++) {
        const size_t column = c->columns[k];
        const double *of_state = C + column * n, *of_drivers = D + column * N;
        if (column >= o) { /* a force: of all multipliers */
            const double *shares = y->shares + (column - o) * y->mp;
            memset(row, 0, (n + N) * sizeof(double));
            for (j = 0; j < m; j++) {
                for (i = 0; i < n; i++) row[i] += shares[j] * L[j * n + i];
                for (i = 0; i < N; i++) row[n + i] += shares[j] * K[j * N + i];
            }
            of_state = row;
            of_drivers = row + n;
        }
        pick_modes_of(c, of_state, y->modes, to->C + k * count);
        pick(of_drivers, c->loads, c->inputs, to->D + k * c->inputs);
    }
    return PMR_DONE;
}

/* Shapes Y (q, r) of outputs with rates, and accelerations (r'), where the state stands under drivers u; friction stays
   as it is. */
static int find_shapes(pmr_state *st, const pmr_chosen *c, const double *u, double *accelerations,
                       const pmr_linear_step *to)
{
    const pmr_system *y = st->system;
    const pmr_values of_motion = {.accelerations = accelerations};
    double *unit = st->seeds;
    seed d = {.free = unit, .lambda = st->motion, .sums = unit + y->modes};
    int failed = stand_under(st, u), j, k;
    if (!failed) failed = find_position_forces(st, 0, NULL);
    if (failed) return failed;
    accelerate(st, st->u + y->paths, st->acceleration);
    copy_values(st, &of_motion, st->values, st->acceleration);
    memset(unit, 0, (y->modes + y->joints) * sizeof(double));
    for (j = 0; j < c->modes && !failed; j++) {
        unit[c->at_modes[j]] = 1.0;
        for (k = 0; k < y->mp; k++) d.lambda[k] = 0.0;
        for (k = 0; k < y->contacts; k++) st->excess[k] = seed_motion(st, &d, k);
        copy(d.lambda, st->excess, y->contacts);
        failed = solve_giving(st, d.lambda);
        find_outputs(st, y->observed, 0, y->op, unit, NULL, d.lambda, NULL, st->changes);
        for (k = 0; k < c->outputs; k++)
            to->shapes[k * c->modes + j] = c->orders[k] ? st->changes[c->columns[k]] : 0.0;
        unit[c->at_modes[j]] = 0.0;
    }
    return failed;
}

static int linear_outputs(pmr_state *st, const pmr_chosen *c, const double *u, double *work, const pmr_linear_step *to)
{
    const pmr_system *y = st->system;
    const pmr_progress progress = st->progress;
    const int r = c->modes;
    double *values = work, *accelerations = work;
    int k, j, failed, rates = 0;
    outputs(st, values, values + y->outputs);
    pick(values, c->columns, c->outputs, to->reference);
    for (k = 0; k < c->outputs; k++) rates |= c->orders[k];
    if (!rates) return PMR_DONE;
    if (y->hoist || y->computed || y->motions) return PMR_REFUSED;
    pick(st->z, c->at_modes, r, to->motion);
    pick(st->v, c->at_modes, r, to->motion + r);
    memcpy(st->began, st->mark, st->saved * sizeof(double));
    failed = return_to(st, &progress, find_shapes(st, c, u, accelerations, to));
    if (failed) return failed;
    pick(accelerations, c->at_modes, r, to->motion + 2 * r);
    for (k = 0; k < c->outputs; k++) {
        to->loaded[k] = to->reference[k];
        for (j = 0; j < r; j++) to->loaded[k] -= to->shapes[k * r + j] * to->motion[j];
    }
    return PMR_DONE;
}

/* First and second rate of a number that was a, is b and becomes c, each h later; NULL where there is none. */
static void differentiate_course(const double *a, const double *b, const double *c, double h, double rates[2])
{
    rates[0] = a && c ? (*c - *a) / (2.0 * h) : c ? (*c - *b) / h : a ? (*b - *a) / h : 0.0;
    rates[1] = a && c ? (*c - 2.0 * *b + *a) / (h * h) : 0.0;
}

#define AT(array, k) ((array) ? (array) + (k) : NULL)

static void output_rates(const pmr_chosen *c, double step, const pmr_linear_step *before, const pmr_linear_step *now,
                         const pmr_linear_step *after)
{
    const int r = c->modes, n = 3 * r, inputs = c->inputs;
    int k, j, i, column;
    for (k = 0; k < c->outputs; k++) {
        double loaded[2], *C = now->C + k * n, *D = now->D + k * inputs;
        const int order = c->orders[k];
        if (!order) continue;
        memset(C, 0, n * sizeof(double));
        memset(D, 0, inputs * sizeof(double));
        differentiate_course(before ? before->loaded + k : NULL, now->loaded + k, after ? after->loaded + k : NULL, step,
                             loaded);
        now->reference[k] = loaded[order - 1];
        for (j = 0; j < r; j++) {
            const int at = k * r + j;
            double rates[2], by[3];
            differentiate_course(before ? before->shapes + at : NULL, now->shapes + at,
                                 after ? after->shapes + at : NULL, step, rates);
            by[0] = rates[order - 1];
            by[1] = order == 1 ? now->shapes[at] : 2.0 * rates[0];
            by[2] = order == 1 ? 0.0 : now->shapes[at];
            for (i = 0; i < 3; i++) {
                const double *E = now->E + (i * r + j) * n, *G = now->G + (i * r + j) * inputs;
                now->reference[k] += by[i] * now->motion[i * r + j];
                for (column = 0; column < n; column++) C[column] += by[i] * E[column];
                for (column = 0; column < inputs; column++) D[column] += by[i] * G[column];
            }
        }
    }
}
