/* Contacts that only push: which of them hold is found together with their multipliers.

       w = A lambda - b,    lambda >= 0,  w >= 0,  lambda w = 0   for those that push,    w = 0 for all others

   A is symmetric and positive definite, so there is exactly one solution (Cottle, Pang, Stone 1992, section 3.3). 
   Closed rows are solved for, the others have lambda = 0; rows that come out wrong, with a pull or a negative gap,
   change sides.  All of them do so at once as long as that leaves fewer wrong ones, or has failed to three times at
   most; after that only the first of them, until there are fewer: block principal pivoting with Murty's least-index
   rule behind it, which ends from any state (docs/pads.md; Murty 1974; Kostreva 1978; Judice, Pires 1994). */

#define SINGULAR 1e-12
#define ROUND_OFF 1e-12
#define MOST_SOLVES 1000
#define CHANCES 3

/* Row k of the factor L diag(d) L^T from entries (k + 1), 1 / d on its diagonal; 0 if it depends on those before. */
static int factorise(const double *entries, double *factor, int k, int stride)
{
    double *row = factor + (size_t)k * stride, pivot = entries[k];
    int begin = 0, l, n;
    while (begin < k && entries[begin] == 0.0) row[begin++] = 0.0;
    for (l = begin; l < k; l++) {
        const double *other = factor + (size_t)l * stride;
        double entry = entries[l];
        for (n = begin; n < l; n++) entry -= row[n] * other[n];
        row[l] = entry;
    }
    for (l = begin; l < k; l++) {
        const double entry = row[l] * factor[(size_t)l * stride + l];
        pivot -= entry * row[l];
        row[l] = entry;
    }
    row[k] = 1.0 / pivot;
    return pivot > SINGULAR * entries[k];
}

static void solve(const double *factor, int m, int stride, double *x)
{
    int k, n;
    for (k = 0; k < m; k++) {
        double value = x[k];
        for (n = 0; n < k; n++) value -= factor[(size_t)k * stride + n] * x[n];
        x[k] = value;
    }
    for (k = 0; k < m; k++) x[k] *= factor[(size_t)k * stride + k];
    for (k = m - 1; k > 0; k--) {
        const double value = x[k];
        for (n = 0; n < k; n++) x[n] -= factor[(size_t)k * stride + n] * value;
    }
}

/* A complementarity problem, and what is known of its solution. */
typedef struct {
    int rows, stride;
    const double *A;       /* (rows, stride): its lower half */
    const int32_t *pushes; /* (rows) */
    const double *excess;  /* b */
    double *lambda, *closed;
    double *factor; /* of the closed rows */
    double *entries;
    int32_t *numbers, *wrong;
    int factored; /* closed rows in `factor`, less than 0: it is that of others */
    int trouble;  /* row that depends on those before it */
} problem;

static int solve_closed(problem *c)
{
    int count = 0, k, l;
    if (c->factored < 0) {
        for (k = 0; k < c->rows; k++) {
            if (c->closed[k] == 0.0) continue;
            c->numbers[count] = k;
            for (l = 0; l <= count; l++) c->entries[l] = c->A[(size_t)k * c->stride + c->numbers[l]];
            if (!factorise(c->entries, c->factor, count, c->stride)) {
                c->trouble = k;
                return PMR_DEPENDENT;
            }
            count++;
        }
        c->factored = count;
    }
    count = c->factored;
    for (l = 0; l < count; l++) c->entries[l] = c->excess[c->numbers[l]];
    solve(c->factor, count, c->stride, c->entries);
    for (k = 0; k < c->rows; k++) c->lambda[k] = 0.0;
    for (l = 0; l < count; l++) c->lambda[c->numbers[l]] = c->entries[l];
    return PMR_DONE;
}

static void mark_wrong(problem *c)
{
    double largest = 0.0;
    int k, n;
    for (k = 0; k < c->rows; k++) largest = larger(largest, fabs(c->lambda[k]));
    for (k = 0; k < c->rows; k++) {
        c->wrong[k] = 0;
        if (!c->pushes[k]) continue;
        if (c->closed[k] != 0.0) {
            c->wrong[k] = c->lambda[k] < -ROUND_OFF * largest;
        } else {
            double gap = -c->excess[k], size = fabs(gap);
            for (n = 0; n < c->factored; n++) {
                const int l = c->numbers[n];
                const double part = c->A[k > l ? (size_t)k * c->stride + l : (size_t)l * c->stride + k] * c->lambda[l];
                gap += part;
                size += fabs(part);
            }
            c->wrong[k] = gap < -ROUND_OFF * size;
        }
    }
}

/* Leave in `wrong` (m,) the contacts that change sides now, and return how many were wrong. */
static int choose_changes(int m, int32_t *wrong, pmr_search *search)
{
    int count = 0, first = 1, k;
    for (k = 0; k < m; k++) count += wrong[k] != 0;
    if (!count) return 0;
    if (!search->fewest || count < search->fewest) {
        search->fewest = count;
        search->chances = CHANCES;
    } else {
        search->chances--;
    }
    if (search->chances >= 0) return count;
    for (k = 0; k < m; k++)
        if (wrong[k]) {
            wrong[k] = first;
            first = 0;
        }
    return count;
}

static int settle(problem *c)
{
    pmr_search search = {0, 0};
    int tries, k;
    for (tries = 0; tries < MOST_SOLVES; tries++) {
        if (solve_closed(c)) return PMR_DEPENDENT;
        mark_wrong(c);
        if (!choose_changes(c->rows, c->wrong, &search)) return PMR_DONE;
        for (k = 0; k < c->rows; k++)
            if (c->wrong[k]) c->closed[k] = 1.0 - c->closed[k];
        c->factored = -1;
    }
    return PMR_UNSETTLED;
}

/* That of a state's contacts where they stand, without a factor. */
static problem problem_of(pmr_state *st, const double *excess, double *lambda, double *closed)
{
    const pmr_system *y = st->system;
    return (problem){.rows = y->contacts,
                     .stride = y->mp,
                     .A = st->A,
                     .pushes = y->pushes,
                     .excess = excess,
                     .lambda = lambda,
                     .closed = closed,
                     .factor = st->factor,
                     .entries = st->entries,
                     .numbers = st->numbers,
                     .wrong = st->wrong,
                     .factored = -1};
}

/* Multipliers of a state's contacts from their motion. */
static int settle_state(pmr_state *st)
{
    const pmr_system *y = st->system;
    problem c = problem_of(st, st->excess, st->lambda, st->closed);
    int failed, k;
    c.factored = st->factored;
    for (k = 0; k < y->contacts; k++) st->excess[k] = st->motion[k] - y->clearance[k];
    failed = settle(&c);
    st->factored = c.factored;
    if (failed) st->trouble = c.trouble;
    return failed;
}

/* Take back what contacts that have just opened would add to this step by their force in the one before; 0 if there
   are none. */
static int release(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    int released = 0, k, n;
    for (k = 0; k < y->contacts; k++) {
        const double force = st->force[k], share = st->share[k], *row = st->C + k * y->modes;
        double of_z, of_v, of_a;
        if (st->closed[k] != 0.0 || (force == 0.0 && share == 0.0)) continue;
        of_z = c->z_from_force * force + c->z_from_share * share;
        of_v = c->v_from_force * force + c->v_from_share * share;
        of_a = c->a_from_force * force + c->a_from_share * share;
        for (n = y->row_modes[2 * k]; n < y->row_modes[2 * k + 1]; n += VL) {
            vec r = CV(row + n), held = CV(c->stiffness + n) * of_z + CV(c->damping + n) * of_v;
            V(st->z_next + n) += r * of_z;
            V(st->v_next + n) += r * of_v;
            V(st->a_next + n) += r * of_a;
            V(st->z_free + n) += r * of_z - r * held * c->z_gain;
        }
        st->force[k] = st->share[k] = 0.0;
        released = 1;
    }
    return released;
}

/* What a step's forces leave for the next one, and the impulse that they gave. */
static void remember_forces(pmr_state *st, const pmr_scheme *c)
{
    int k;
    for (k = 0; k < st->system->contacts; k++) {
        const double ahead = c->v_from_force * st->force[k] + c->v_from_share * st->share[k];
        const double left = c->a_from_force * st->force[k] + c->a_from_share * st->share[k];
        st->impulse[k] += c->v_gain * st->lambda[k] + ahead;
        st->share[k] = c->gain * st->lambda[k] + left;
        st->force[k] = st->lambda[k];
    }
}

static int contact_alone(int m, const double *A, const double *b, const int32_t *pushes, double *lambda,
                         int32_t *closed, double *work, int *trouble)
{
    problem c = {.rows = m,
                 .stride = m,
                 .A = A,
                 .pushes = pushes,
                 .excess = b,
                 .lambda = lambda,
                 .closed = work,
                 .entries = work + m,
                 .factor = work + 2 * m,
                 .numbers = (int32_t *)(work + 2 * m + (size_t)m * m),
                 .factored = -1};
    int failed, k;
    if (m < 0) return PMR_REFUSED;
    c.wrong = c.numbers + m;
    for (k = 0; k < m; k++) c.closed[k] = !pushes[k] || closed[k] ? 1.0 : 0.0;
    failed = settle(&c);
    for (k = 0; k < m; k++) closed[k] = c.closed[k] != 0.0;
    if (trouble) *trouble = failed == PMR_DEPENDENT ? c.trouble : -1;
    return failed;
}
