/* A boom's moments: mu_lj = int rho r_l u_j of its sections, what it has of momentum and inertia, and their rates. */

/* Rows of the contacts where the paths stand at step k, with their rates as the paths move; F of those that give way is
   factorised: `failed` where these depend on each other. */
static void place_moving(pmr_machine_run *ms, int64_t k)
{
    pmr_state *st = ms->state;
    const pmr_system *y = st->system;
    const pmr_machine *m = ms->machine;
    const pmr_scheme *still = st->still;
    const double *motions = m->motions + (size_t)k * 3 * y->motions, *rates = m->rates + (size_t)k * y->motions;
    const size_t r = y->modes, i = y->ip, mp = y->mp, rows = y->rows;
    moved *at = ms->paths;
    const int orders = m->luffs ? ms->orders : 3; /* nobody asks what holds a free luffing angle's frame */
    moved_tables tables = {{NULL}, {NULL}, {NULL}};
    int same = ms->rows_known >= orders, stands = st->placed, a, b, p;
    ms->moves = 0;
    for (p = 0; p < y->paths; p++) {
        const int32_t motion = y->frame_paths[p];
        const moved now = {motions[motion], rates[motion], motions[2 * y->motions + motion]};
        same = same && at[p].at == now.at && at[p].rate == now.rate && at[p].second == now.second;
        stands = stands && st->s[p] == now.at;
        at[p] = now;
        ms->moves = ms->moves || now.rate != 0.0 || now.second != 0.0;
        st->u_begun[p] = now.at;
    }
    if (!stands) {
        (void)place(st, still, st->u_begun); /* its tables; F of rigid contacts is singular */
        st->placed = 0; /* a step has another A */
    }
    ms->tables.C[0] = st->C, ms->tables.H[0] = st->H; /* which `place` exchanges */
    if (same || !y->contacts) return;
    ms->rows_known = orders;
    if (stands) enter_intervals(st, still);
    for (p = 0; p < orders; p++) {
        if (p) tables.C[p] = memset(ms->tables.C[p], 0, rows * r * sizeof(double));
        if (p) tables.H[p] = memset(ms->tables.H[p], 0, rows * i * sizeof(double));
        tables.A[p] = memset(ms->tables.A[p], 0, rows * mp * sizeof(double));
    }
    for (a = 0; a < y->rows && !y->whole; a++)
        for (b = 0; b <= a; b++) ms->tables.A[0][a * mp + b] = ms->tables.A[0][b * mp + a] = y->F0[a * mp + b];
    move_rows(st, still, at, &tables);
    ms->count = 0;
    for (a = 0; a < y->contacts; a++)
        if (!is_rigid_by(st, ms->tables.A[0], a)) ms->giving[ms->count++] = a;
    st->trouble = -1;
    ms->failed = PMR_DONE;
    for (a = 0; a < ms->count && !ms->failed; a++) {
        for (b = 0; b <= a; b++) ms->right[b] = ms->tables.A[0][ms->giving[a] * mp + ms->giving[b]];
        if (!factorise(ms->right, ms->factor, a, (int)mp)) {
            ms->failed = PMR_DEPENDENT;
            st->trouble = ms->giving[a];
        }
    }
}

/* Derivatives of a product: of an order, by how often the second factor is differentiated. */
static const double BINOMIAL[3][3] = {{1.0, 0.0, 0.0}, {1.0, 1.0, 0.0}, {1.0, 2.0, 1.0}};

/* Elastic forces of contacts that give way, F lambda_0 = C z, with their rates; of z with z' and z''. */
static void answer(pmr_machine_run *ms, const double *const z[3])
{
    const pmr_system *y = ms->state->system;
    int order, j, a, b;
    for (order = 0; order < ms->orders; order++) {
        double *lambda = ms->lambda + order * y->mp;
        for (a = 0; a < ms->count; a++) {
            const int row = ms->giving[a];
            double sum = 0.0;
            for (j = ms->moves ? 0 : order; j <= order; j++) { /* the derivative of C z - F lambda */
                sum += BINOMIAL[order][j] * dot(ms->tables.C[order - j] + (size_t)row * y->modes, z[j],
                                                y->row_modes[2 * row], y->row_modes[2 * row + 1]);
                for (b = 0; j < order && b < ms->count; b++)
                    sum -= BINOMIAL[order][j] * ms->tables.A[order - j][(size_t)row * y->mp + ms->giving[b]] *
                           ms->lambda[j * y->mp + b];
            }
            lambda[a] = sum;
        }
        solve(ms->factor, ms->count, y->mp, lambda);
    }
}

/* Displacements (i,) of all inputs' points by inertia alone, B^T z - H^T lambda_0, with their rates. */
static void find_inertial(pmr_machine_run *ms, const double *const z[3])
{
    const pmr_system *y = ms->state->system;
    int order, j, a, l;
    for (order = 0; order < ms->orders; order++) {
        double *values = ms->inertial[order];
        for (l = 0; l < y->inputs; l++)
            values[l] = dot(y->B + (size_t)l * y->modes, z[order], y->input_modes[2 * l], y->input_modes[2 * l + 1]);
        for (a = 0; a < ms->count; a++)
            for (j = ms->moves ? 0 : order; j <= order; j++)
                add_share(values, ms->tables.H[order - j] + (size_t)ms->giving[a] * y->ip,
                          -BINOMIAL[order][j] * ms->lambda[j * y->mp + a], y->ip);
    }
}

/* Matrices (r', r') of the boom: moments of momentum, second moments, and by how much sections are shorter. */
static const double *matrix_of(const pmr_machine_run *ms, int number)
{
    const pmr_machine *m = ms->machine;
    const size_t square = (size_t)ms->state->system->modes * ms->state->system->modes;
    return number < ROTATING ? m->rotating + number * square
           : number < ROTATING + SECOND ? m->second_moments + (number - ROTATING) * square
                                        : m->shortened + (number - ROTATING - SECOND) * square;
}

/* Ranges of modes that one of the matrices couples with each other alone, as those of a section: where each begins and
   ends, up to an empty one. */
static int32_t *ranges_of(const pmr_machine_run *ms, int number) { return ms->ranges + 2 * (MOST_SECTIONS + 1) * number; }

static void find_ranges(pmr_machine_run *ms)
{
    const int r = ms->state->system->modes, count = ROTATING + SECOND + ms->machine->shortened_count;
    int from, to, number, n, k;
    for (number = 0; number < count; number++) {
        const double *A = matrix_of(ms, number);
        int32_t *range = ranges_of(ms, number), *last = range + 2 * (MOST_SECTIONS - 1);
        for (from = 0; from < r; from = to) {
            int coupled = 0;
            for (n = from, to = from + PMR_LANES; n < to; n++)
                for (k = from; k < r; k++) {
                    if (A[n * r + k] == 0.0 && A[k * r + n] == 0.0) continue;
                    coupled = 1;
                    if (k >= to) to = PMR_UP(k + 1);
                }
            if (!coupled) continue;
            if (range == last) to = r;
            range[0] = from, range[1] = to;
            range += 2;
        }
    }
}

/* z A of one of the matrices. */
static void multiply_modes(pmr_machine_run *ms, int number, const double *z)
{
    const int r = ms->state->system->modes;
    const double *A = matrix_of(ms, number);
    const int32_t *range;
    int n, k;
    for (range = ranges_of(ms, number); range[1]; range += 2)
        for (n = range[0]; n < range[1]; n += VL) {
            vec even = {0.0}, odd = {0.0};
            for (k = range[0]; k < range[1]; k += 2) {
                even += CONST_LOOSE(A + (size_t)k * r + n) * z[k];
                odd += CONST_LOOSE(A + (size_t)(k + 1) * r + n) * z[k + 1];
            }
            V(ms->product + n) = even + odd;
        }
}

/* z A x of one of the matrices, after `multiply_modes` of z. */
static double product_with(const pmr_machine_run *ms, int number, const double *x)
{
    const int32_t *range;
    double sum = 0.0;
    for (range = ranges_of(ms, number); range[1]; range += 2) sum += dot(ms->product, x, range[0], range[1]);
    return sum;
}

/* Sum of r x u out of first moments A_lj = sum r_l u_j. */
static void turning_of(const double *A, double *sum)
{
    sum[0] = A[5] - A[7], sum[1] = A[6] - A[2], sum[2] = A[1] - A[3];
}

/* tr(A + A^T) 1 - A - A^T: an inertia from second moments. */
static void steiner(const double *A, double *inertia)
{
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++)
            inertia[3 * i + j] = (i == j ? 2.0 * (A[0] + A[4] + A[8]) : 0.0) - A[3 * i + j] - A[3 * j + i];
}

/* First moments of the sections (3, 3), where each moves along and its points by mu, at rates of an order. */
static void first_moments(const pmr_machine_run *ms, int order, double *A)
{
    const int S = ms->machine->sections;
    int k, l, j;
    for (l = 0; l < 9; l++) A[l] = 0.0;
    for (k = 0; k < S; k++) {
        const carried_section *c = ms->of + k;
        const double along = c->length[order];
        for (l = 0; l < 3; l++) {
            A[3 * l] += along * c->own[l];
            for (j = 0; j < 3; j++) A[3 * l + j] += c->d[l] * c->mu[order][0][j] + c->mu[order][1 + l][j];
        }
    }
}

/* What the boom has of momentum and inertia at step k, of z with z' and z'' (3, r'). */
static void find_boom(pmr_machine_run *ms, int64_t k, const double *const z[3])
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    const double *motions = m->motions + (size_t)k * 3 * y->motions, *rates = m->rates + (size_t)k * y->motions;
    boom_moments *boom = &ms->boom;
    double length[3] = {0.0, 0.0, 0.0}, A[9], second[9], rate[9];
    int n, i, j, l, o;
    place_moving(ms, k);
    answer(ms, z);
    find_inertial(ms, z);
    for (n = 0; n < m->sections; n++) {
        carried_section *c = ms->of + n;
        const int path = m->section_paths[n];
        for (o = 0; o < 3; o++) c->extension[o] = 0.0;
        if (path >= 0) {
            c->extension[0] = motions[path];
            c->extension[1] = rates[path];
            c->extension[2] = motions[2 * y->motions + path];
        }
        for (o = 0; o < 3; o++) c->length[o] = length[o] += c->extension[o];
        for (j = 0; j < 3; j++) c->d[j] = m->place[j];
        c->d[0] += length[0];
        for (l = 0; l < 4; l++)
            for (j = 0; j < 3; j++) {
                const int32_t input = m->fields[(n * 4 + l) * 3 + j];
                for (o = 0; o < 3; o++) c->mu[o][l][j] = input < 0 ? 0.0 : ms->inertial[o][input];
            }
    }
    for (n = 0; n < m->shortened_count; n++) { /* by how much sections are shorter as they bend: factor z^T G z / 2 */
        const int32_t *of = m->of_shortened + 3 * n;
        carried_section *c = ms->of + of[0];
        double f = 1.0, f1 = 0.0, f2 = 0.0, zz, zv, vv, za;
        if (of[2] >= 0) {
            const double *e = ms->of[of[2]].extension;
            f = -1.0 / e[0];
            f1 = e[1] / (e[0] * e[0]);
            f2 = e[2] / (e[0] * e[0]) - 2.0 * e[1] * e[1] / (e[0] * e[0] * e[0]);
        }
        multiply_modes(ms, ROTATING + SECOND + n, z[0]);
        zz = product_with(ms, ROTATING + SECOND + n, z[0]), zv = product_with(ms, ROTATING + SECOND + n, z[1]);
        c->mu[0][of[1]][0] += f * zz / 2.0;
        c->mu[1][of[1]][0] += f * zv + f1 * zz / 2.0;
        if (ms->orders < 3) continue;
        za = product_with(ms, ROTATING + SECOND + n, z[2]);
        multiply_modes(ms, ROTATING + SECOND + n, z[1]);
        vv = product_with(ms, ROTATING + SECOND + n, z[1]);
        c->mu[2][of[1]][0] += f * (za + vv) + 2.0 * f1 * zv + f2 * zz / 2.0;
    }
    for (o = 0; o < 3; o++)
        for (j = 0; j < 3; j++) boom->s[o][j] = 0.0;
    for (n = 0; n < m->sections; n++) {
        carried_section *c = ms->of + n;
        for (j = 0; j < 3; j++) {
            c->own[j] = m->masses[n] * c->d[j] + m->first_moments[3 * n + j] + c->mu[0][0][j];
            boom->s[0][j] += c->own[j];
            boom->s[1][j] += c->mu[1][0][j] + (j ? 0.0 : m->masses[n] * c->length[1]);
            boom->s[2][j] += c->mu[2][0][j] + (j ? 0.0 : m->masses[n] * c->length[2]);
        }
    }
    for (o = 1; o < ms->orders; o++) {
        double *h = o == 1 ? boom->h : boom->h_rate;
        first_moments(ms, o, A);
        turning_of(A, h);
        for (j = 0; j < 3; j++) {
            multiply_modes(ms, j, z[0]);
            h[j] += product_with(ms, j, z[o]);
        }
    }
    for (l = 0; l < 9; l++) second[l] = rate[l] = 0.0;
    for (n = 0; n < m->sections; n++) {
        const carried_section *c = ms->of + n;
        for (j = 0; j < 3; j++) {
            const double rigid = m->masses[n] * c->d[j], own = m->first_moments[3 * n + j] + c->mu[0][0][j];
            rate[j] += c->length[1] * (rigid + own);
            for (l = 0; l < 3; l++) {
                second[3 * l + j] += c->d[l] * (rigid / 2.0 + own) + c->mu[0][1 + l][j];
                rate[3 * l + j] += c->d[l] * c->mu[1][0][j] + c->mu[1][1 + l][j];
            }
        }
    }
    for (i = 0; i < 3; i++)
        for (j = i; j < 3; j++) {
            const int number = ROTATING + 3 * i + j;
            multiply_modes(ms, number, z[0]);
            const double zz = product_with(ms, number, z[0]) / 2.0, zv = ms->orders < 3 ? 0.0 : product_with(ms, number, z[1]);
            second[3 * i + j] += zz, rate[3 * i + j] += zv;
            if (i != j) second[3 * j + i] += zz, rate[3 * j + i] += zv;
        }
    steiner(second, boom->inertia);
    steiner(rate, boom->inertia_rate);
    for (l = 0; l < 9; l++) boom->inertia[l] += m->section_inertia[l];
}
