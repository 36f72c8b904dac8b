/* A machine that carries the frame of a boom and moves by itself: its motion is found with the boom's, step by step.

   With P and L the linear and angular momentum of machine and boom about the ground's origin, along its axes,

       P_{n+1} = P_n + h F~,    L_{n+1} = L_n + h M~

   hold to round-off in the directions that are free.  F~ are forces from outside as generalized-alpha averages them,

       (1 - alpha_m) F~_{n+1} + alpha_m F~_n = (1 - alpha_f) F_{n+1} + alpha_f F_n,

   and the machine's rates follow from its accelerations in the same way.  The rates of the free directions are found by
   Newton's method with Broyden's secants; each trial takes the boom's step in the frame that moves so.

   The boom's momentum is that of all its points.  With the moments mu_{lj} = int rho r_l u_j of each section (r_0 = 1),

       mu = beta(s) z + delta_jx z^T G z / 2,    beta z = B^T z - H^T lambda_0,    F lambda_0 = C z,

   of which B^T z is what inputs of unit acceleration do to modes, H^T lambda_0 what contacts that give way answer.
   `pmr.simulation.free_base` has the equations. */

enum { MOST_SECTIONS = 16, MOST_TRIALS = 30, PATIENCE = 6 };
/* Of the fastest motion so far: to which rates are found; the same where a further trial comes no nearer; by which rates
   differ for a derivative. Cosine of pitch where roll and yaw turn about almost the same axis. */
#define MACHINE_ROUND_OFF 1e-12
#define MACHINE_NEAR 1e-9
#define MACHINE_DIFFERENCE 1e-4
#define MACHINE_UPRIGHT 0.02

typedef struct {
    double extension[3], length[3]; /* m with rates: how far it is out, and its tail from the base's along the boom */
    double d[3], own[3];            /* m, kg m: its tail and its first moment from the pivot */
    double mu[3][4][3];             /* moments with rates */
} carried_section;

typedef struct {
    double s[3][3], inertia[9], inertia_rate[9], h[3], h_rate[3]; /* first moment with rates, Theta, int rho rho x rho' */
} boom_moments;

/* How a machine carries its boom. */
typedef struct {
    double R[9], v[3], omega[3], turned[9], left[3], axes[9];
} carrier;

typedef struct {
    double momenta[6], forces[6], springs[6], axes[9];
} machine_whole;

/* What the next step depends on. */
typedef struct {
    double b[18], smooth[6], felt[6], forces[6], fastest[2], slope[36], rates[3][6], momenta[6], held[6];
    carrier carrier;
    machine_whole whole;
    int32_t rates_known, slope_known, rows_known;
} machine_past;

/* A number in time, with its first and second rate. */
typedef struct {
    double at, rate, second;
} moved;

/* A motion that a step may end with. */
typedef struct {
    double b[18], felt[6], left[6];
    carrier carrier;
    machine_whole whole;
} trial;

struct pmr_carried {
    const pmr_machine *machine;
    pmr_state *state;
    machine_past past;
    trial now, before;
    carried_section of[MOST_SECTIONS];
    boom_moments boom;
    pmr_progress progress;
    int32_t *giving, count, orders; /* contacts that give way; rates of moments that are asked for, and one */
    moved *paths;
    double *saved, *motions, *inertia, *inertia_smooth, *new_inertia, *new_smooth, *u, *u_old, *accelerations;
    double *C[3], *H[3], *F[3], *factor, *lambda, *right, *product;
};

static void cross(const double *a, const double *b, double *c)
{
    const double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    c[0] = x, c[1] = y, c[2] = z;
}

static void turn_out(const double *R, const double *a, double *b) /* R a */
{
    const double x = a[0], y = a[1], z = a[2];
    int i;
    for (i = 0; i < 3; i++) b[i] = R[3 * i] * x + R[3 * i + 1] * y + R[3 * i + 2] * z;
}

static void turn_in(const double *R, const double *a, double *b) /* R^T a */
{
    const double x = a[0], y = a[1], z = a[2];
    int i;
    for (i = 0; i < 3; i++) b[i] = R[i] * x + R[3 + i] * y + R[6 + i] * z;
}

static void add_cross(double factor, const double *a, const double *b, double *sum)
{
    double c[3];
    int i;
    cross(a, b, c);
    for (i = 0; i < 3; i++) sum[i] += factor * c[i];
}

/* x of A x = b (3, 3), or of A^T x = b. */
static void solve_three(const double *A, int transposed, const double *b, double *x)
{
    double matrix[9], room[3 * 5];
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) matrix[3 * i + j] = transposed ? A[3 * j + i] : A[3 * i + j];
    for (i = 0; i < 3; i++) x[i] = b[i];
    if (solve_dense(3, matrix, x, room)) x[0] = x[1] = x[2] = NAN;
}

/* ---- where the machine stands ---- */

/* Motions of step k with the machine's motion b (3, 6). */
static const double *motions_at(const pmr_carried *ms, int64_t k, const double *rows, const double *second)
{
    const pmr_system *y = ms->state->system;
    const int n = y->motions;
    int j;
    copy(ms->motions, ms->machine->motions + (size_t)k * 3 * n, 3 * n);
    for (j = 0; j < 3; j++) {
        ms->motions[y->frame_angles[2 + j]] = rows[3 + j];
        ms->motions[n + y->frame_angles[2 + j]] = rows[9 + j];
        ms->motions[2 * n + y->frame_angles[2 + j]] = second[3 + j];
        ms->motions[ms->machine->axes[j]] = second[j];
    }
    return ms->motions;
}

static void drivers_at(const pmr_carried *ms, int64_t k, const double *rows, const double *second, double *u)
{
    pmr_frame_drivers(ms->state->system, motions_at(ms, k, rows, second), u, ms->state->quantities);
}

/* Axes about which roll, pitch and yaw turn, as columns. */
static void axes_of(const pmr_turning *base, const double *b, double *axes)
{
    const double column[3][3] = {
        {base->R[0], base->R[3], base->R[6]}, {-sin(b[5]), cos(b[5]), 0.0}, {0.0, 0.0, 1.0}};
    int i, j;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) axes[3 * i + j] = column[j][i];
}

static void find_carrier(const pmr_carried *ms, int64_t k, const double *b, carrier *c)
{
    static const double none[6];
    pmr_turning boom, base;
    int i, j, l;
    pmr_frame_turning(ms->state->system, motions_at(ms, k, b, none), &boom, &base);
    axes_of(&base, b, c->axes);
    for (i = 0; i < 9; i++) c->R[i] = boom.R[i];
    for (i = 0; i < 3; i++) {
        c->v[i] = b[6 + i];
        c->omega[i] = boom.velocity[i];
        c->left[i] = boom.acceleration[i];
        for (j = 0; j < 3; j++) {
            c->turned[3 * i + j] = 0.0;
            for (l = 0; l < 3; l++) c->turned[3 * i + j] += boom.R[3 * l + i] * c->axes[3 * l + j];
        }
    }
}

/* Accelerations (6,) that the boom feels by second rates of the directions (6,), and the other way round. */
static void feel(const carrier *c, const double *second, double *felt)
{
    int i;
    turn_in(c->R, second, felt);
    turn_out(c->turned, second + 3, felt + 3);
    for (i = 0; i < 3; i++) felt[3 + i] += c->left[i];
}

static void seconds_of(const carrier *c, const double *felt, double *second)
{
    double turned[3];
    int i;
    turn_out(c->R, felt, second);
    for (i = 0; i < 3; i++) turned[i] = felt[3 + i] - c->left[i];
    solve_three(c->turned, 0, turned, second + 3);
}

/* ---- the boom's moments ---- */

static moved times_moved(moved a, moved b)
{
    return (moved){a.at * b.at, a.rate * b.at + a.at * b.rate, a.second * b.at + 2.0 * a.rate * b.rate + a.at * b.second};
}

static moved plus_moved(moved a, moved b) { return (moved){a.at + b.at, a.rate + b.rate, a.second + b.second}; }

static moved polynomial(const double *c, int powers, int stride, moved x)
{
    moved sum = {0.0, 0.0, 0.0};
    int p;
    for (p = 0; p < powers; p++) {
        sum = times_moved(sum, x);
        sum.at += c[(size_t)p * stride];
    }
    return sum;
}

static void add_moved(double *const table[3], size_t at, double factor, moved value)
{
    table[0][at] += factor * value.at;
    table[1][at] += factor * value.rate;
    table[2][at] += factor * value.second;
}

/* Entries k, l and l, k of F. */
static void add_both(const pmr_carried *ms, int k, int l, moved value)
{
    const int mp = ms->state->system->mp;
    add_moved(ms->F, (size_t)k * mp + l, k == l ? 2.0 : 1.0, value);
    if (k != l) add_moved(ms->F, (size_t)l * mp + k, 1.0, value);
}

static void move_block(const pmr_carried *ms, int number, const double *of_F, moved x)
{
    const pmr_state *st = ms->state;
    const pmr_system *y = st->system;
    const pmr_block *b = y->block_list + number;
    const int32_t *on = y->block_rows + b->at_rows, *staying = on + b->rows;
    const int m = b->rows, w = b->modes, g = PMR_UP(m), t = PMR_UP(b->stays), i = PMR_UP(b->inputs);
    const double *C = in_interval(st, number, y->table_C, b->at_C, b->powers_C, m * w),
                 *H = in_interval(st, number, y->table_H, b->at_H, b->powers_H, m * i), *S = of_F + b->powers_G * m * g;
    int k, n;
    for (k = 0; k < m; k++) {
        for (n = 0; n < w; n++)
            add_moved(ms->C, (size_t)on[k] * y->modes + b->first_mode + n, 1.0,
                      polynomial(C + k * w + n, b->powers_C, m * w, x));
        for (n = 0; n < b->inputs; n++)
            add_moved(ms->H, (size_t)on[k] * y->ip + b->first_input + n, 1.0,
                      polynomial(H + k * i + n, b->powers_H, m * i, x));
        for (n = 0; n <= k; n++) {
            moved value = polynomial(of_F + k * g + n, b->powers_G, m * g, x);
            if (n == k) value = times_moved(value, (moved){0.5, 0.0, 0.0});
            add_both(ms, on[k], on[n], value);
        }
        for (n = 0; n < b->stays; n++)
            add_both(ms, on[k], staying[n], polynomial(S + k * t + n, b->powers_S, m * t, x));
    }
}

static void move_pair(const pmr_carried *ms, int number, const double *tables, moved s, moved t)
{
    const pmr_system *y = ms->state->system;
    const pmr_block *one = y->block_list + y->pair_list[number].first,
                    *two = y->block_list + y->pair_list[number].second;
    const int p1 = one->powers_C, p2 = two->powers_C;
    int k, l, p;
    for (k = 0; k < one->rows; k++)
        for (l = 0; l < two->rows; l++) {
            const double *table = tables + (size_t)(k * two->rows + l) * p1 * p2;
            moved sum = {0.0, 0.0, 0.0};
            for (p = 0; p < p1; p++) sum = plus_moved(times_moved(sum, s), polynomial(table + p, p2, p1, t));
            add_both(ms, y->block_rows[one->at_rows + k], y->block_rows[two->at_rows + l], sum);
        }
}

/* Rows of the contacts where the paths stand at step k, with their rates as the paths move; F of those that give way is
   factorised. */
static void move_rows(pmr_carried *ms, int64_t k)
{
    pmr_state *st = ms->state;
    const pmr_system *y = st->system;
    const pmr_machine *m = ms->machine;
    const pmr_scheme *still = st->still;
    const double *motions = m->motions + (size_t)k * 3 * y->motions, *rates = m->rates + (size_t)k * y->motions,
                 *of_F = still->of_blocks, *of_pair = still->of_pairs;
    const size_t r = y->modes, i = y->ip, mp = y->mp, rows = y->rows;
    moved *at = ms->paths;
    int same = ms->past.rows_known, a, b, p;
    size_t n;
    for (p = 0; p < y->paths; p++) {
        const int32_t motion = y->frame_paths[p];
        const moved now = {motions[motion], rates[motion], motions[2 * y->motions + motion]};
        same = same && at[p].at == now.at && at[p].rate == now.rate && at[p].second == now.second;
        at[p] = now;
        st->u_begun[p] = now.at;
    }
    if (same || !y->contacts) return;
    ms->past.rows_known = 1;
    st->placed = 0;
    (void)place(st, still, st->u_begun); /* its tables; F of rigid contacts is singular */
    for (p = 0; p < 3; p++) {
        memset(ms->C[p], 0, rows * r * sizeof(double));
        memset(ms->H[p], 0, rows * i * sizeof(double));
        memset(ms->F[p], 0, rows * mp * sizeof(double));
    }
    for (n = 0; n < rows * r; n++) ms->C[0][n] = y->C0[n];
    for (n = 0; n < rows * i; n++) ms->H[0][n] = y->H0[n];
    for (a = 0; a < y->rows && !y->whole; a++)
        for (b = 0; b <= a; b++) ms->F[0][a * mp + b] = ms->F[0][b * mp + a] = y->F0[a * mp + b];
    for (p = 0; p < y->blocks; p++) {
        const pmr_block *block = y->block_list + p;
        move_block(ms, p, of_F, (moved){st->x[p], at[block->path].rate, at[block->path].second});
        of_F += block_room(block);
    }
    for (p = 0; p < y->pairs; p++) {
        const pmr_pair *pair = y->pair_list + p;
        const moved s = at[y->block_list[pair->first].path], t = at[y->block_list[pair->second].path];
        move_pair(ms, p, of_pair, (moved){st->x[pair->first], s.rate, s.second},
                  (moved){st->x[pair->second], t.rate, t.second});
        of_pair += pair_size(y->block_list + pair->first, y->block_list + pair->second);
    }
    for (p = 0; p < y->ropes; p++)
        for (n = 0; n < rows * mp; n++)
            add_moved(ms->F, n, y->rope_slopes[(size_t)p * rows * mp + n], at[y->rope_paths[p]]);
    ms->count = 0;
    for (a = 0; a < y->contacts; a++) {
        int gives = 0;
        for (b = 0; b < y->contacts; b++) gives |= ms->F[0][a * mp + b] != 0.0;
        if (gives) ms->giving[ms->count++] = a;
    }
    for (a = 0; a < ms->count; a++) {
        for (b = 0; b <= a; b++) ms->right[b] = ms->F[0][ms->giving[a] * mp + ms->giving[b]];
        factorise(ms->right, ms->factor, a, (int)mp);
    }
    st->placed = 0; /* a step has another A */
    st->trouble = -1;
}

/* Elastic forces of contacts that give way, F lambda_0 = C z, with their rates; of z with z' and z''. */
static void answer(pmr_carried *ms, const double *const z[3])
{
    static const double binomial[3][3] = {{1.0, 0.0, 0.0}, {1.0, 1.0, 0.0}, {1.0, 2.0, 1.0}};
    const pmr_system *y = ms->state->system;
    int order, j, a, b;
    for (order = 0; order < ms->orders; order++) {
        double *lambda = ms->lambda + order * y->mp;
        for (a = 0; a < ms->count; a++) {
            const int row = ms->giving[a];
            double sum = 0.0;
            for (j = 0; j <= order; j++) { /* the derivative of C z - F lambda */
                sum += binomial[order][j] * dot(ms->C[order - j] + (size_t)row * y->modes, z[j], 0, y->modes);
                for (b = 0; j < order && b < ms->count; b++)
                    sum -= binomial[order][j] * ms->F[order - j][(size_t)row * y->mp + ms->giving[b]] *
                           ms->lambda[j * y->mp + b];
            }
            lambda[a] = sum;
        }
        solve(ms->factor, ms->count, y->mp, lambda);
    }
}

/* Displacement of an input's points by inertia alone, B^T z - H^T lambda_0, with its rates. */
static moved moment_of(const pmr_carried *ms, int input, const double *const z[3])
{
    static const double binomial[3][3] = {{1.0, 0.0, 0.0}, {1.0, 1.0, 0.0}, {1.0, 2.0, 1.0}};
    const pmr_system *y = ms->state->system;
    double value[3] = {0.0, 0.0, 0.0};
    int order, j, a;
    for (order = 0; order < ms->orders; order++) {
        value[order] = dot(y->B + (size_t)input * y->modes, z[order], 0, y->modes);
        for (a = 0; a < ms->count; a++)
            for (j = 0; j <= order; j++)
                value[order] -= binomial[order][j] * ms->H[order - j][(size_t)ms->giving[a] * y->ip + input] *
                                ms->lambda[j * y->mp + a];
    }
    return (moved){value[0], value[1], value[2]};
}

/* A z of a square matrix. */
static void multiply_modes(const double *A, const double *z, int r, double *product)
{
    int k, n;
    for (k = 0; k < r; k++) {
        vec sum = {0.0};
        for (n = 0; n < r; n += VL) sum += LOOSE((double *)A + (size_t)k * r + n) * CV(z + n);
        product[k] = sum_of(sum);
    }
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

/* First moments of the sections (3, 3), where each moves by `along` and its points by mu_{., order}. */
static void first_moments(const pmr_carried *ms, int order, int with_length, double *A)
{
    const int S = ms->machine->sections;
    int k, l, j;
    for (l = 0; l < 9; l++) A[l] = 0.0;
    for (k = 0; k < S; k++) {
        const carried_section *c = ms->of + k;
        const double along = with_length ? c->length[order] : 0.0;
        for (l = 0; l < 3; l++) {
            A[3 * l] += along * c->own[l];
            for (j = 0; j < 3; j++) A[3 * l + j] += c->d[l] * c->mu[order][0][j] + c->mu[order][1 + l][j];
        }
    }
}

/* What the boom has of momentum and inertia at step k, of z with z' and z'' (3, r'). */
static void find_boom(pmr_carried *ms, int64_t k, const double *const z[3])
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    const double *motions = m->motions + (size_t)k * 3 * y->motions, *rates = m->rates + (size_t)k * y->motions;
    const int r = y->modes;
    boom_moments *boom = &ms->boom;
    double length[3] = {0.0, 0.0, 0.0}, A[9], second[9], rate[9];
    int n, i, j, l, o;
    move_rows(ms, k);
    answer(ms, z);
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
                const moved value = input < 0 ? (moved){0.0, 0.0, 0.0} : moment_of(ms, input, z);
                c->mu[0][l][j] = value.at, c->mu[1][l][j] = value.rate, c->mu[2][l][j] = value.second;
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
        multiply_modes(m->shortened + (size_t)n * r * r, z[0], r, ms->product);
        zz = dot(ms->product, z[0], 0, r), zv = dot(ms->product, z[1], 0, r), za = dot(ms->product, z[2], 0, r);
        c->mu[0][of[1]][0] += f * zz / 2.0;
        c->mu[1][of[1]][0] += f * zv + f1 * zz / 2.0;
        if (ms->orders < 3) continue;
        multiply_modes(m->shortened + (size_t)n * r * r, z[1], r, ms->product);
        vv = dot(ms->product, z[1], 0, r);
        c->mu[2][of[1]][0] += f * (za + vv) + 2.0 * f1 * zv + f2 * zz / 2.0;
    }
    for (o = 0; o < 3; o++)
        for (j = 0; j < 3; j++) boom->s[o][j] = 0.0;
    for (n = 0; n < m->sections; n++) {
        carried_section *c = ms->of + n;
        for (j = 0; j < 3; j++) {
            c->own[j] = m->masses[n] * c->d[j] + m->first[3 * n + j] + c->mu[0][0][j];
            boom->s[0][j] += c->own[j];
            boom->s[1][j] += c->mu[1][0][j] + (j ? 0.0 : m->masses[n] * c->length[1]);
            boom->s[2][j] += c->mu[2][0][j] + (j ? 0.0 : m->masses[n] * c->length[2]);
        }
    }
    first_moments(ms, 1, 1, A);
    turning_of(A, boom->h);
    first_moments(ms, 2, 1, A);
    turning_of(A, boom->h_rate);
    for (j = 0; j < 3; j++) {
        multiply_modes(m->rotating + (size_t)j * r * r, z[0], r, ms->product);
        boom->h[j] += dot(ms->product, z[1], 0, r);
        boom->h_rate[j] += dot(ms->product, z[2], 0, r);
    }
    for (l = 0; l < 9; l++) second[l] = rate[l] = 0.0;
    for (n = 0; n < m->sections; n++) {
        const carried_section *c = ms->of + n;
        for (j = 0; j < 3; j++) {
            const double rigid = m->masses[n] * c->d[j], own = m->first[3 * n + j] + c->mu[0][0][j];
            rate[j] += c->length[1] * (rigid + own);
            for (l = 0; l < 3; l++) {
                second[3 * l + j] += c->d[l] * (rigid / 2.0 + own) + c->mu[0][1 + l][j];
                rate[3 * l + j] += c->d[l] * c->mu[1][0][j] + c->mu[1][1 + l][j];
            }
        }
    }
    for (i = 0; i < 3; i++)
        for (j = i; j < 3; j++) {
            double zz, zv;
            multiply_modes(m->carried + (size_t)(3 * i + j) * r * r, z[0], r, ms->product);
            zz = dot(ms->product, z[0], 0, r) / 2.0, zv = dot(ms->product, z[1], 0, r);
            second[3 * i + j] += zz, rate[3 * i + j] += zv;
            if (i != j) second[3 * j + i] += zz, rate[3 * j + i] += zv;
        }
    steiner(second, boom->inertia);
    steiner(rate, boom->inertia_rate);
    for (l = 0; l < 9; l++) boom->inertia[l] += m->section_inertia[l];
}

/* ---- the whole ---- */

/* Force and moment about the pivot from outside, along the ground's axes, but for what holds the machine. */
static void push(const pmr_carried *ms, int64_t k, const double *R, const double *axes, const double *f,
                 const double *springs, const double *lever, double *F, double *M)
{
    const pmr_machine *m = ms->machine;
    const double *pushed = m->pushed + 6 * (size_t)k, weight[3] = {0.0, 0.0, -m->weight[k]};
    const int inputs = ms->state->system->inputs;
    double force[3] = {0.0, 0.0, 0.0}, moment[3] = {0.0, 0.0, 0.0}, first[3], by_springs[3];
    int n, j, l;
    for (n = 0; n < m->sections; n++) {
        double own[6];
        for (j = 0; j < 6; j++) {
            own[j] = 0.0;
            for (l = 0; l < inputs; l++) own[j] += m->loads[(size_t)(6 * n + j) * inputs + l] * f[l];
        }
        for (j = 0; j < 3; j++) force[j] += own[j], moment[j] += own[3 + j];
        add_cross(1.0, ms->of[n].d, own, moment);
    }
    turn_out(R, force, force);
    turn_out(R, moment, moment);
    turn_out(R, ms->boom.s[0], first);
    for (j = 0; j < 3; j++) {
        F[j] = (m->boom_mass + m->mass) * weight[j] + force[j] + pushed[j] + springs[j];
        M[j] = moment[j] + pushed[3 + j];
        first[j] += m->mass * lever[j];
    }
    add_cross(1.0, first, weight, M);
    if (springs[3] != 0.0 || springs[4] != 0.0 || springs[5] != 0.0) {
        solve_three(axes, 1, springs + 3, by_springs);
        for (j = 0; j < 3; j++) M[j] += by_springs[j];
    }
}

static void find_springs(const pmr_machine *m, int64_t k, const double *b, double *springs)
{
    const double *given = m->given + 18 * (size_t)k;
    int j;
    for (j = 0; j < 6; j++)
        springs[j] = -m->stiffness[j] * (b[j] - given[j]) - m->damping[j] * (b[6 + j] - given[6 + j]);
}

/* Momenta and forces at step k with the machine's motion b, under loads f. */
static void find_whole(pmr_carried *ms, int64_t k, const double *b, const double *f, const double *const z[3],
                       machine_whole *w)
{
    const pmr_machine *m = ms->machine;
    boom_moments *boom = &ms->boom;
    pmr_turning turned, base;
    double v[3], linear[3], angular[3], lever[3], spin[3], *P = w->momenta, *L = w->momenta + 3;
    int i, j;
    pmr_frame_turning(ms->state->system, motions_at(ms, k, b, b + 12), &turned, &base);
    axes_of(&base, b, w->axes);
    ms->orders = 2;
    find_boom(ms, k, z);
    turn_in(turned.R, b + 6, v);
    cross(turned.velocity, boom->s[0], linear);
    cross(boom->s[0], v, angular);
    for (i = 0; i < 3; i++) {
        linear[i] += m->boom_mass * v[i] + boom->s[1][i];
        angular[i] += boom->h[i];
        for (j = 0; j < 3; j++) angular[i] += boom->inertia[3 * i + j] * turned.velocity[j];
        spin[i] = m->inertia[i] * base.velocity[i];
    }
    turn_out(turned.R, linear, P);
    turn_out(turned.R, angular, L);
    turn_out(base.R, m->center, lever);
    turn_out(base.R, spin, spin);
    cross(base.velocity, m->center, linear);
    turn_out(base.R, linear, linear);
    for (i = 0; i < 3; i++) {
        linear[i] = m->mass * (b[6 + i] + linear[i]);
        P[i] += linear[i];
        L[i] += spin[i];
    }
    add_cross(1.0, lever, linear, L);
    add_cross(1.0, b, P, L);
    find_springs(m, k, b, w->springs);
    push(ms, k, turned.R, w->axes, f, w->springs, lever, w->forces, w->forces + 3);
    add_cross(1.0, b, w->forces, w->forces + 3);
}

/* What has to hold the machine (6,), by its directions, for all to be accelerated so. */
static void find_needed(pmr_carried *ms, int64_t k, const double *b, const double *f, const double *const z[3],
                        double *needed)
{
    const pmr_machine *m = ms->machine;
    boom_moments *boom = &ms->boom;
    pmr_turning turned, base;
    double a[3], linear[3], angular[3], spin[3], lever[3], own[3], rolled[3], axes[9], springs[6], F[3], M[3];
    const double *omega = turned.velocity, *alpha = turned.acceleration;
    int i, j;
    pmr_frame_turning(ms->state->system, motions_at(ms, k, b, b + 12), &turned, &base);
    axes_of(&base, b, axes);
    ms->orders = 3;
    find_boom(ms, k, z);
    turn_in(turned.R, b + 12, a);
    for (i = 0; i < 3; i++) {
        linear[i] = m->boom_mass * a[i] + boom->s[2][i];
        angular[i] = boom->h_rate[i];
        spin[i] = boom->h[i];
        for (j = 0; j < 3; j++) {
            spin[i] += boom->inertia[3 * i + j] * omega[j];
            angular[i] += boom->inertia_rate[3 * i + j] * omega[j] + boom->inertia[3 * i + j] * alpha[j];
        }
    }
    cross(omega, boom->s[0], own);
    add_cross(1.0, omega, own, linear);
    add_cross(2.0, omega, boom->s[1], linear);
    add_cross(1.0, alpha, boom->s[0], linear);
    add_cross(1.0, boom->s[0], a, angular);
    add_cross(1.0, omega, spin, angular);
    turn_out(turned.R, linear, linear);
    turn_out(turned.R, angular, angular);
    cross(base.velocity, m->center, own);
    cross(base.velocity, own, own);
    add_cross(1.0, base.acceleration, m->center, own);
    turn_out(base.R, own, own);
    turn_out(base.R, m->center, lever);
    for (i = 0; i < 3; i++) {
        own[i] = m->mass * (b[12 + i] + own[i]);
        spin[i] = m->inertia[i] * base.velocity[i];
        rolled[i] = m->inertia[i] * base.acceleration[i];
    }
    add_cross(1.0, base.velocity, spin, rolled);
    turn_out(base.R, rolled, rolled);
    add_cross(1.0, lever, own, rolled);
    find_springs(m, k, b, springs);
    push(ms, k, turned.R, axes, f, springs, lever, F, M);
    for (i = 0; i < 3; i++) {
        needed[i] = linear[i] + own[i] - F[i];
        angular[i] += rolled[i] - M[i];
    }
    turn_in(axes, angular, needed + 3);
}

/* ---- generalized-alpha where rates are known and accelerations follow ---- */

typedef struct {
    double h, am, af, gamma, beta;
} weights;

static weights weights_of(const pmr_state *st)
{
    const double rho = st->settings.rho_inf;
    weights w = {st->settings.step, (2.0 * rho - 1.0) / (rho + 1.0), rho / (rho + 1.0), 0.0, 0.0};
    w.gamma = 0.5 + w.af - w.am;
    w.beta = (w.gamma + 0.5) * (w.gamma + 0.5) / 4.0;
    return w;
}

static double smoothed(const weights *w, double now, double old, double before)
{
    return ((1.0 - w->af) * now + w->af * old - w->am * before) / (1.0 - w->am);
}

static double of_smoothed(const weights *w, double smooth, double before, double old)
{
    return ((1.0 - w->am) * smooth + w->am * before - w->af * old) / (1.0 - w->af);
}

static double by_impulse(const weights *w, double impulse, double before)
{
    return (impulse / w->h - (1.0 - w->gamma) * before) / w->gamma;
}

/* ---- a step ---- */

static void save_boom(pmr_carried *ms)
{
    memcpy(ms->saved, ms->state->mark, ms->state->saved * sizeof(double));
    ms->progress = ms->state->progress;
}

static void restore_boom(pmr_carried *ms)
{
    memcpy(ms->state->mark, ms->saved, ms->state->saved * sizeof(double));
    ms->state->progress = ms->progress;
}

/* Step k in which free directions end with such rates (6,), those of others left out. */
static int try_rates(pmr_carried *ms, int64_t k, const double *rates)
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    const machine_past *old = &ms->past;
    const weights w = weights_of(ms->state);
    trial *now = &ms->now;
    const double *z[3], *loads = ms->u + y->paths, *old_loads = ms->u_old + y->paths;
    double second[6], left[6], middle[3];
    int free = 0, failed, n, i, j;
    copy(now->b, m->given + 18 * (size_t)k, 18);
    for (n = 0; n < 6; n++) {
        double smooth;
        if (!m->free[n]) continue;
        free = 1;
        smooth = by_impulse(&w, rates[n] - old->b[6 + n], old->smooth[n]);
        now->b[n] = old->b[n] + w.h * old->b[6 + n] +
                    w.h * w.h * ((0.5 - w.beta) * old->smooth[n] + w.beta * smooth);
        now->b[6 + n] = rates[n];
    }
    find_carrier(ms, k, now->b, &now->carrier);
    copy(now->felt, old->felt, 6);
    if (free) {
        for (i = 0; i < 3; i++) {
            now->felt[i] = 0.0;
            for (j = 0; j < 3; j++)
                now->felt[i] += (now->carrier.R[3 * j + i] + old->carrier.R[3 * j + i]) *
                                (now->carrier.v[j] - old->carrier.v[j]) / 2.0 / w.h;
            now->felt[3 + i] = (now->carrier.omega[i] - old->carrier.omega[i]) / w.h;
        }
        seconds_of(&old->carrier, now->felt, second);
        drivers_at(ms, k - 1, old->b, second, ms->u_old);
        seconds_of(&now->carrier, now->felt, second);
        drivers_at(ms, k, now->b, second, ms->u);
        for (n = 0; n < m->inertial_count; n++) {
            const double mean = (loads[m->inertial[n]] + old_loads[m->inertial[n]]) / 2.0;
            ms->new_smooth[n] = by_impulse(&w, w.h * mean, ms->inertia_smooth[n]);
            ms->new_inertia[n] = of_smoothed(&w, ms->new_smooth[n], ms->inertia_smooth[n], ms->inertia[n]);
        }
        for (n = 0; n < 6; n++) second[n] = k > 1 ? (3.0 * now->felt[n] - old->felt[n]) / 2.0 : now->felt[n];
        seconds_of(&now->carrier, second, now->b + 12);
    }
    drivers_at(ms, k, now->b, now->b + 12, ms->u);
    for (n = 0; n < m->inertial_count; n++) {
        if (free)
            ms->u[y->paths + m->inertial[n]] = ms->new_inertia[n];
        else
            ms->new_smooth[n] = ms->new_inertia[n] = loads[m->inertial[n]];
    }
    restore_boom(ms);
    failed = step_to(ms->state, ms->u, NULL);
    if (failed) return failed;
    z[0] = ms->state->z, z[1] = z[2] = ms->state->v;
    find_whole(ms, k, now->b, loads, z, &now->whole);
    for (n = 0; n < 6; n++) {
        const double force = smoothed(&w, now->whole.forces[n], old->whole.forces[n], old->forces[n]);
        left[n] = now->whole.momenta[n] - old->whole.momenta[n] -
                  w.h * ((1.0 - w.gamma) * old->forces[n] + w.gamma * force);
    }
    for (n = 0; n < 3; n++) middle[n] = (now->b[n] + old->b[n]) / 2.0;
    add_cross(-1.0, middle, left, left + 3);
    copy(now->left, left, 3);
    for (i = 0; i < 3; i++) {
        now->left[3 + i] = 0.0;
        for (j = 0; j < 3; j++)
            now->left[3 + i] += (now->whole.axes[3 * j + i] + old->whole.axes[3 * j + i]) * left[3 + j] / 2.0;
    }
    return PMR_DONE;
}

/* The fastest so far, along and about axes, with that of a motion and its acceleration within a step. */
static void find_fastest(const pmr_carried *ms, const double *b, double *fastest)
{
    int n;
    copy(fastest, ms->past.fastest, 2);
    for (n = 0; n < 6; n++) {
        const double rate = fabs(b[6 + n]), change = fabs(b[12 + n]) * ms->state->settings.step;
        fastest[n / 3] = larger(fastest[n / 3], larger(rate, change));
    }
}

/* Derivative of the free directions' impulses by their rates, from what was tried last. */
static int find_machine_slope(pmr_carried *ms, int64_t k, const int *which, int count)
{
    const trial at = ms->now;
    double rates[6];
    int n, j;
    for (n = 0; n < count; n++) {
        int failed;
        copy(rates, at.b + 6, 6);
        rates[which[n]] += MACHINE_DIFFERENCE;
        failed = try_rates(ms, k, rates);
        if (failed) return failed;
        for (j = 0; j < count; j++)
            ms->past.slope[j * count + n] = (ms->now.left[which[j]] - at.left[which[j]]) / MACHINE_DIFFERENCE;
    }
    ms->past.slope_known = 1;
    return try_rates(ms, k, at.b + 6); /* what is taken is what was tried last */
}

/* Find the motion at the end of step k; PMR_LOST if it is not found. */
static int find_motion_at(pmr_carried *ms, int64_t k)
{
    const machine_past *old = &ms->past;
    const double h = ms->state->settings.step;
    double rates[6], change[6], matrix[36], room[6 * 8], fastest[2], smallest = INFINITY;
    int which[6], count = 0, since = 0, failed, tries, n, j;
    for (n = 0; n < 6; n++)
        if (ms->machine->free[n]) which[count++] = n;
    if (ms->past.rates_known < 3) {
        copy(ms->past.rates[ms->past.rates_known++], old->b + 6, 6);
    } else {
        copy(ms->past.rates[0], old->rates[1], 6);
        copy(ms->past.rates[1], old->rates[2], 6);
        copy(ms->past.rates[2], old->b + 6, 6);
    }
    for (n = 0; n < 6; n++)
        rates[n] = old->rates_known < 3 ? old->b[6 + n] + h * old->smooth[n]
                                        : 3.0 * (old->rates[2][n] - old->rates[1][n]) + old->rates[0][n];
    failed = try_rates(ms, k, rates);
    if (failed || !count) return failed;
    for (tries = 0; tries < MOST_TRIALS; tries++) {
        double error = 0.0, square = 0.0, left[6];
        if (!ms->past.slope_known || since == PATIENCE) {
            failed = find_machine_slope(ms, k, which, count);
            if (failed) return failed;
            since = 0;
        }
        copy(matrix, old->slope, count * count);
        for (n = 0; n < count; n++) change[n] = -ms->now.left[which[n]];
        if (solve_dense(count, matrix, change, room)) return PMR_LOST;
        find_fastest(ms, ms->now.b, fastest);
        for (n = 0; n < count; n++) {
            error = larger(error, fabs(change[n]) / fastest[which[n] / 3]);
            square += change[n] * change[n];
            left[n] = ms->now.left[which[n]];
        }
        if (error <= MACHINE_ROUND_OFF || (error <= MACHINE_NEAR && error > smallest / 2.0)) return PMR_DONE;
        smallest = error < smallest ? error : smallest;
        since++;
        copy(rates, ms->now.b + 6, 6);
        for (n = 0; n < count; n++) rates[which[n]] += change[n];
        failed = try_rates(ms, k, rates);
        if (failed) return failed;
        for (n = 0; n < count; n++) { /* as Broyden has it */
            double missed = ms->now.left[which[n]] - left[n];
            for (j = 0; j < count; j++) missed -= old->slope[n * count + j] * change[j];
            for (j = 0; j < count; j++) ms->past.slope[n * count + j] += missed * change[j] / square;
        }
    }
    return PMR_LOST;
}

/* z'' of the boom's modes where it stands, under what it was stepped to. */
static void accelerate_boom(pmr_carried *ms)
{
    accelerate(ms->state, ms->u + ms->state->system->paths, ms->accelerations);
}

/* End step k with what was tried last. */
static int end_machine_step(pmr_carried *ms, int64_t k)
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    machine_past *past = &ms->past;
    const trial *now = &ms->now;
    const weights w = weights_of(ms->state);
    const double *z[3] = {ms->state->z, ms->state->v, ms->accelerations};
    double axes[9], turned[3], left[6], middle[3], momenta[6], needed[6];
    int held = 0, n;
    if (!all_finite(now->b, 18)) return PMR_NOT_FINITE;
    if (cos(now->b[4]) < MACHINE_UPRIGHT) return PMR_UPRIGHT;
    for (n = 0; n < 6; n++) {
        left[n] = m->free[n] ? now->left[n] : 0.0;
        if (m->free[n])
            past->smooth[n] = by_impulse(&w, now->b[6 + n] - past->b[6 + n], past->smooth[n]);
        else
            held = 1;
    }
    for (n = 0; n < 6; n++)
        past->forces[n] = smoothed(&w, now->whole.forces[n], past->whole.forces[n], past->forces[n]);
    for (n = 0; n < 6; n++) past->held[n] = 0.0;
    if (held) {
        accelerate_boom(ms);
        find_needed(ms, k, now->b, ms->u + y->paths, z, needed);
        for (n = 0; n < 6; n++) past->held[n] = m->free[n] ? 0.0 : needed[n];
    }
    /* what round-off has left of a step is not carried on into the next one */
    copy(momenta, now->whole.momenta, 6);
    for (n = 0; n < 3; n++) momenta[n] -= left[n];
    if (m->free[3] && m->free[4] && m->free[5]) {
        for (n = 0; n < 9; n++) axes[n] = (now->whole.axes[n] + past->whole.axes[n]) / 2.0;
        solve_three(axes, 1, left + 3, turned);
        for (n = 0; n < 3; n++) {
            momenta[3 + n] -= turned[n];
            middle[n] = (now->b[n] + past->b[n]) / 2.0;
        }
        add_cross(-1.0, middle, left, momenta + 3);
    }
    past->carrier = now->carrier;
    past->whole = now->whole;
    copy(past->momenta, now->whole.momenta, 6);
    copy(past->whole.momenta, momenta, 6);
    copy(past->b, now->b, 18);
    copy(past->felt, now->felt, 6);
    copy(ms->inertia, ms->new_inertia, m->inertial_count);
    copy(ms->inertia_smooth, ms->new_smooth, m->inertial_count);
    find_fastest(ms, now->b, past->fastest);
    save_boom(ms);
    return PMR_DONE;
}

/* ---- the interface ---- */

static void lay_out_carried(pmr_carried *ms, const pmr_state *st, const pmr_machine *machine, room *r)
{
    const pmr_system *y = st->system;
    pmr_carried *taken = take_room(r, 1, sizeof *ms);
    int o;
    if (taken) ms = taken;
#define ROOM(field, count) ms->field = take_room(r, (size_t)(count), sizeof(double))
    ROOM(saved, st->saved);
    ROOM(motions, 3 * y->motions);
    ROOM(inertia, machine->inertial_count);
    ROOM(inertia_smooth, machine->inertial_count);
    ROOM(new_inertia, machine->inertial_count);
    ROOM(new_smooth, machine->inertial_count);
    ROOM(u, y->drivers);
    ROOM(u_old, y->drivers);
    ROOM(accelerations, y->modes);
    for (o = 0; o < 3; o++) {
        ROOM(C[o], (size_t)y->rows * y->modes);
        ROOM(H[o], (size_t)y->rows * y->ip);
        ROOM(F[o], (size_t)y->rows * y->mp);
    }
    ROOM(factor, (size_t)y->rows * y->mp);
    ROOM(lambda, 3 * y->mp);
    ROOM(right, y->mp);
    ROOM(product, y->modes);
    ms->paths = take_room(r, (size_t)y->paths, sizeof(moved));
    ms->giving = take_room(r, (size_t)y->mp, sizeof(int32_t));
#undef ROOM
}

static int carried_open(pmr_state *st, const pmr_machine *machine, pmr_carried **carried)
{
    const pmr_system *y = st->system;
    pmr_carried counted = {0};
    room r = {NULL, 0};
    int n;
    *carried = NULL;
    if (!y->motions || machine->sections < 1 || machine->sections > MOST_SECTIONS || y->pushing ||
        st->settings.levels != 1)
        return PMR_REFUSED;
    for (n = 0; n < 3; n++)
        if (y->frame_angles[2 + n] < 0) return PMR_REFUSED;
    lay_out_carried(&counted, st, machine, &r);
    r.memory = pmr_aligned(r.at);
    if (!r.memory) return PMR_NO_MEMORY;
    memset(r.memory, 0, r.at);
    r.at = 0;
    lay_out_carried(&counted, st, machine, &r);
    *carried = (pmr_carried *)r.memory;
    (*carried)->machine = machine;
    (*carried)->state = st;
    return PMR_DONE;
}

static int carried_needed(pmr_carried *ms, const double *b, const double *z, const double *v, const double *a,
                          double *needed)
{
    const pmr_system *y = ms->state->system;
    double *const of = ms->state->others, *const rates = ms->state->pulled;
    const double *modes[3] = {of, rates, ms->accelerations};
    copy(of, z, y->modes);
    copy(rates, v, y->modes);
    copy(ms->accelerations, a, y->modes);
    drivers_at(ms, 0, b, b + 12, ms->u);
    find_needed(ms, 0, b, ms->u + y->paths, modes, needed);
    return PMR_DONE;
}

/* What holds the machine where it is accelerated by b's second rates, which the boom's follow. */
static int begin_with(pmr_carried *ms, const double *b, const double *z, const double *v, double *needed)
{
    const pmr_system *y = ms->state->system;
    const double *modes[3] = {ms->state->z, ms->state->v, ms->accelerations};
    int failed;
    drivers_at(ms, 0, b, b + 12, ms->u);
    failed = start(ms->state, PMR_GIVEN, ms->u, NULL, z, v);
    if (failed) return failed;
    accelerate_boom(ms);
    find_needed(ms, 0, b, ms->u + y->paths, modes, needed);
    return PMR_DONE;
}

static void record_machine(const pmr_carried *ms, const pmr_carried_record *record, int64_t row)
{
    record_row(record->motion, row, 18, ms->past.b);
    record_row(record->held, row, 6, ms->past.held);
    record_row(record->springs, row, 6, ms->past.whole.springs);
    record_row(record->momenta, row, 6, ms->past.momenta);
    record_row(record->inertia, row, ms->machine->inertial_count, ms->inertia);
}

static int carried_start(pmr_carried *ms, const double *given, const double *z, const double *v,
                         const pmr_carried_record *record)
{
    const pmr_machine *m = ms->machine;
    const pmr_system *y = ms->state->system;
    machine_past *past = &ms->past;
    const double *modes[3] = {ms->state->z, ms->state->v, ms->state->v};
    double b[18], none[6], needed[6], matrix[36], room[6 * 8], second[6], balanced = 0.0;
    int which[6], count = 0, failed, n, j;
    copy(b, given, 18);
    memset(past, 0, sizeof *past);
    for (n = 0; n < 6; n++)
        if (m->free[n]) which[count++] = n;
    for (n = 0; n < count; n++) b[12 + which[n]] = 0.0;
    failed = begin_with(ms, b, z, v, none);
    for (n = 0; n < count && !failed; n++) {
        b[12 + which[n]] = 1.0;
        failed = begin_with(ms, b, z, v, needed);
        b[12 + which[n]] = 0.0;
        for (j = 0; j < count; j++) matrix[j * count + n] = needed[which[j]] - none[which[j]];
    }
    if (failed) return failed;
    for (n = 0; n < count; n++) second[n] = -none[which[n]];
    if (count && solve_dense(count, matrix, second, room)) return PMR_LOST;
    for (n = 0; n < count; n++) b[12 + which[n]] = second[n];
    failed = begin_with(ms, b, z, v, needed);
    if (failed) return failed;
    for (n = 0; n < 6; n++) past->held[n] = m->free[n] ? 0.0 : needed[n];
    copy(past->b, b, 18);
    copy(past->smooth, b + 12, 6);
    find_carrier(ms, 0, b, &past->carrier);
    feel(&past->carrier, b + 12, past->felt);
    for (n = 0; n < m->inertial_count; n++)
        ms->inertia[n] = ms->inertia_smooth[n] = ms->u[y->paths + m->inertial[n]];
    find_whole(ms, 0, b, ms->u + y->paths, modes, &past->whole);
    copy(past->forces, past->whole.forces, 6);
    copy(past->momenta, past->whole.momenta, 6);
    for (n = 0; n < 6; n++) balanced = larger(balanced, fabs(past->whole.springs[n]) / (m->boom_mass + m->mass));
    balanced = ms->state->settings.step * (balanced + m->largest_weight);
    past->fastest[0] = past->fastest[1] = larger(balanced, 1e-100); /* whose square is a number */
    find_fastest(ms, b, past->fastest);
    save_boom(ms);
    record_machine(ms, record, 0);
    return PMR_DONE;
}

static int carried_advance(pmr_carried *ms, int64_t first, int64_t count, const pmr_carried_record *record,
                           int64_t *taken)
{
    for (*taken = 0; *taken < count; ++*taken) {
        int failed = find_motion_at(ms, first + *taken);
        if (!failed) failed = end_machine_step(ms, first + *taken);
        if (failed) return failed;
        record_machine(ms, record, *taken);
    }
    return PMR_DONE;
}
