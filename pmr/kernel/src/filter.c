/* A Kalman filter on a linear model of each step, for payload, loads and outputs of a boom that measured paths move.

   The state X (N,) holds, in this order, the prediction of a step z*, v*, a* (n = 3 r), unknown loads, a payload, parameters, biases and
   gains of sensors, and errors of the model in measured outputs.  With rows R = (C, D of loads, ...) outputs are

       y = reference + shift + R X,    measured = y + bias + gain y + error + noise

   A payload m beside that of the reference motion is the load -m (g + a); in R the acceleration a of its place is that of
   the reference motion, and `shift` is what the rest of the estimated acceleration does.  The acceleration of the step is
   F X with F = (R, 0, G of loads), and each mode goes on by its prediction and acceleration alone: so what takes time is a
   product with r rows, not with n.  All others decay.  pmr.observe.observer derives the numbers of a filter.  Rows of matrices with N columns are padded to whole
   registers, L numbers. */

/* Where each part of a state begins, and the parts of a filter's memory. */
typedef struct {
    size_t loads, payload, parameters, biases, gains, errors, all, padded; /* loads = n */
    double *x, *P, *square, *level, *rows, *shift, *lift, *work;
} filter_parts;

static filter_parts parts_of(const pmr_filter *f, double *memory)
{
    filter_parts p;
    const size_t q = f->outputs;
    p.loads = f->states;
    p.payload = p.loads + f->loads;
    p.parameters = p.payload + (f->payload >= 0);
    p.biases = p.parameters + f->parameters;
    p.gains = p.biases + f->biased;
    p.errors = p.gains + f->scaled;
    p.all = p.errors + f->off;
    p.padded = PMR_UP(p.all);
    p.x = memory;
    p.P = p.x + p.padded;
    p.square = p.P + p.all * p.padded;
    p.level = p.square + q;
    p.rows = p.level + f->sensors;
    p.shift = p.rows + q * p.padded;
    p.lift = p.shift + q;
    p.work = p.lift + 1;
    return p;
}

static void filter_sizes(const pmr_filter *f, pmr_filter_counts *counts)
{
    const filter_parts p = parts_of(f, NULL);
    const size_t L = p.padded, m = f->sensors, r = f->states / 3, W = PMR_UP(r);
    const size_t update = m * (3 * L + (L > m ? L : m) + m + 6), predict = 4 * L + 2 * r * L + 4 * r * W + 4 * W;
    counts->states = p.all;
    counts->stride = L;
    counts->kept = L + p.all * L + f->outputs + m;
    counts->memory = counts->kept + f->outputs * (L + 1) + 1 + (update > predict ? update : predict);
}

/* Columns of unknown loads and of the payload from derivatives (rows, i) by the model's loads, into (., columns). */
static void set_load_columns(const pmr_filter *f, const filter_parts *p, const double *of_loads, size_t rows, double *to,
                             size_t columns)
{
    size_t k;
    int l;
    for (k = 0; k < rows; k++) {
        const double *from = of_loads + k * f->inputs;
        for (l = 0; l < f->loads; l++) to[k * columns + p->loads + l] = from[f->load_inputs[l]];
        if (f->payload >= 0) to[k * columns + p->payload] = *p->lift * from[f->payload];
    }
}

/* Load by the payload's inertia beside the reference's acceleration, N. */
static double payload_inertia(const pmr_filter *f, const filter_parts *p)
{
    if (f->payload < 0) return 0.0;
    return -p->x[p->payload] * dot_loose(p->rows + f->acceleration * p->padded, p->x, (int)p->padded);
}

static void set_rows(const pmr_filter *f, const filter_parts *p, const pmr_filter_step *step)
{
    const size_t L = p->padded, n = 2 * (size_t)f->states / 3;
    const double payload = f->payload >= 0 ? p->x[p->payload] : 0.0;
    double inertia;
    int k, j;
    if (f->payload >= 0) *p->lift = -(f->gravity + step->reference[f->acceleration]);
    memset(p->rows, 0, f->outputs * L * sizeof(double));
    for (k = 0; k < f->outputs; k++) {
        double *row = p->rows + k * L;
        memcpy(row, step->C + k * n, n * sizeof(double));
        for (j = 0; j < f->parameters; j++)
            row[p->parameters + j] = step->sensitivity[k * f->parameters + j] +
                                     payload * step->per_kilogram[k * f->parameters + j];
    }
    set_load_columns(f, p, step->D, f->outputs, p->rows, L);
    inertia = payload_inertia(f, p);
    for (k = 0; k < f->outputs; k++) p->shift[k] = f->payload < 0 ? 0.0 : step->D[k * f->inputs + f->payload] * inertia;
}

/* Rows H (p, N) of the sensors, and what they should measure. */
static void set_sensor_rows(const pmr_filter *f, const filter_parts *p, const double *reference, double *H, double *expected)
{
    const size_t L = p->padded;
    int k, b = 0, g = 0, e = 0;
    for (k = 0; k < f->sensors; k++) {
        const int output = f->sensor_outputs[k];
        double *row = H + k * L;
        const double base = reference[output] + p->shift[output];
        const double sum = base + dot_loose(p->rows + output * L, p->x, (int)L);
        memcpy(row, p->rows + output * L, L * sizeof(double));
        if (b < f->biased && f->biased_sensors[b] == k) row[p->biases + b++] = 1.0;
        if (g < f->scaled && f->scaled_sensors[g] == k) row[p->gains + g++] = sum;
        if (e < f->off && f->off_sensors[e] == k) row[p->errors + e++] = f->errors[output] * sqrt(p->square[output]);
        expected[k] = base + dot_loose(row, p->x, (int)L);
    }
}

/* K (m, N) of S K = PH for a symmetric positive definite S (m, m), whose lower half becomes its factor; K is PH.  0, or
   PMR_NOT_FINITE where S is not positive definite. */
static int solve_gains(double *S, size_t m, double *K, size_t N)
{
    size_t a, b, c, j;
    for (a = 0; a < m; a++) {
        for (b = 0; b <= a; b++) {
            double sum = S[a * m + b];
            for (c = 0; c < b; c++) sum -= S[a * m + c] * S[b * m + c];
            if (a == b && !(sum > 0.0 && sum < INFINITY)) return PMR_NOT_FINITE;
            S[a * m + b] = a == b ? sqrt(sum) : sum / S[b * m + b];
        }
        for (c = 0; c < a; c++)
            for (j = 0; j < N; j++) K[a * N + j] -= S[a * m + c] * K[c * N + j];
        for (j = 0; j < N; j++) K[a * N + j] /= S[a * m + a];
    }
    for (a = m; a-- > 0;) {
        for (c = a + 1; c < m; c++)
            for (j = 0; j < N; j++) K[a * N + j] -= S[c * m + a] * K[c * N + j];
        for (j = 0; j < N; j++) K[a * N + j] /= S[a * m + a];
    }
    return 0;
}

static void filter_start(const pmr_filter *f, double *memory, const double *x, const double *P, const double *square)
{
    const filter_parts p = parts_of(f, memory);
    pmr_filter_counts counts;
    size_t i;
    filter_sizes(f, &counts);
    memset(memory, 0, counts.memory * sizeof(double));
    memcpy(p.x, x, p.all * sizeof(double));
    for (i = 0; i < p.all; i++) memcpy(p.P + i * p.padded, P + i * p.all, p.all * sizeof(double));
    memcpy(p.square, square, f->outputs * sizeof(double));
    for (i = 0; i < (size_t)f->sensors; i++) p.level[i] = 1.0;
}

static int filter_update(const pmr_filter *f, double *memory, const pmr_filter_step *step, const double *measured,
                         const int32_t *use, double *innovations)
{
    const filter_parts p = parts_of(f, memory);
    const size_t N = p.all, L = p.padded, most = f->sensors;
    double *H = p.work, *PH = H + most * L, *S = PH + most * L, *K, *U;
    double *expected = S + most * most, *variance = expected + most, *gap = variance + most, *noise = gap + most;
    double *shares = noise + most;
    size_t m = 0, a, b, j;
    int k;
    set_rows(f, &p, step);
    set_sensor_rows(f, &p, step->reference, H, expected);
    memset(PH, 0, most * L * sizeof(double));
    for (k = 0; k < f->sensors; k++) {
        const int known = isfinite(measured[k]), doubted = use[k] == PMR_IF_NEAR && p.level[k] > f->alarm;
        const double difference = known ? measured[k] - expected[k] : 0.0;
        double size;
        if (m != (size_t)k) memcpy(H + m * L, H + k * L, L * sizeof(double));
        memset(PH + m * L, 0, L * sizeof(double));
        add_columns(p.P, (int)L, H + m * L, (int)N, PH + m * L, (int)L);
        variance[k] = f->noise[k] * f->noise[k] + dot_loose(H + m * L, PH + m * L, (int)L);
        if (!(variance[k] > 0.0 && variance[k] < INFINITY)) return PMR_NOT_FINITE;
        innovations[k] = known || use[k] == PMR_AS_EXPECTED ? difference / sqrt(variance[k]) : NAN;
        size = fabs(innovations[k]);
        if (size <= (doubted ? f->gate : f->refused) && use[k] != PMR_NOT_USED) {
            const double beyond = larger(size * size / (f->gate * f->gate) - 1.0, 0.0);
            noise[m] = f->noise[k] * f->noise[k] + beyond * variance[k];
            gap[m++] = difference;
        }
        if (known) p.level[k] += f->share * (fmin(size * size, PMR_MOST_SQUARE) - p.level[k]);
    }
    if (!m) return 0;
    for (a = 0; a < m; a++)
        for (b = 0; b < m; b++)
            S[a * m + b] = dot_loose(H + a * L, PH + b * L, (int)L) + (a == b ? noise[a] : 0.0);
    K = shares + 2 * most;
    U = K + m * L;
    memcpy(K, PH, m * L * sizeof(double));
    memcpy(U, S, m * m * sizeof(double));
    if (solve_gains(U, m, K, L)) return PMR_NOT_FINITE;
    for (k = 0; k < f->parameters; k++)
        for (a = 0; a < m && f->considered[k]; a++) K[a * L + p.parameters + k] = 0.0;
    memcpy(U, PH, m * L * sizeof(double)); /* P -= K U^T + U K^T with U = PH - K S / 2 */
    for (a = 0; a < m; a++) {
        for (j = 0; j < L; j++) p.x[j] += K[a * L + j] * gap[a];
        for (b = 0; b < m; b++)
            for (j = 0; j < L; j++) U[a * L + j] -= 0.5 * S[a * m + b] * K[b * L + j];
    }
    for (j = 0; j < N; j++) {
        for (a = 0; a < m; a++) {
            shares[a] = -U[a * L + j];
            shares[m + a] = -K[a * L + j];
        }
        add_columns(K, (int)L, shares, 2 * (int)m, p.P + j * L, (int)L);
    }
    return 0;
}

static void filter_outputs(const pmr_filter *f, double *memory, const pmr_filter_step *step, double *mean,
                           double *variance)
{
    const filter_parts p = parts_of(f, memory);
    double *of_row = p.work;
    int k;
    for (k = 0; k < f->outputs; k++) {
        const double *row = p.rows + k * p.padded;
        mean[k] = step->reference[k] + p.shift[k] + dot_loose(row, p.x, (int)p.padded);
        p.square[k] += (mean[k] * mean[k] - p.square[k]) * f->following;
        memset(of_row, 0, p.padded * sizeof(double));
        add_columns(p.P, (int)p.padded, row, (int)p.all, of_row, (int)p.padded);
        variance[k] = larger(dot_loose(row, of_row, (int)p.padded), 0.0) + f->errors[k] * f->errors[k] * p.square[k];
    }
}

/* to (rows, stride) = A B for A (rows, stride) and B (., stride), of which the rows within two spans count, in tiles of four
   rows and two registers. */
static void multiply(const double *A, const double *B, int rows, const int spans[4], int stride, double *to)
{
    int i, n, q, s;
    for (i = 0; i < rows; i += 4) {
        const int last = rows - 1;
        const int at[4] = {i, i + 1 < last ? i + 1 : last, i + 2 < last ? i + 2 : last, i + 3 < last ? i + 3 : last};
        const double *a = A + at[0] * stride, *b = A + at[1] * stride, *c = A + at[2] * stride, *d = A + at[3] * stride;
        for (n = 0; n < stride; n += 2 * VL) {
            const int second = n + VL < stride ? n + VL : n;
            vec sums[8];
            for (q = 0; q < 8; q++) sums[q] = (vec){0.0};
            for (s = 0; s < 4; s += 2)
                for (q = spans[s]; q < spans[s + 1]; q++) {
                    const vec x = CONST_LOOSE(B + q * stride + n), y = CONST_LOOSE(B + q * stride + second);
                    sums[0] += a[q] * x, sums[1] += a[q] * y, sums[2] += b[q] * x, sums[3] += b[q] * y;
                    sums[4] += c[q] * x, sums[5] += c[q] * y, sums[6] += d[q] * x, sums[7] += d[q] * y;
                }
            for (q = 0; q < 4; q++) {
                LOOSE(to + at[q] * stride + n) = sums[2 * q];
                LOOSE(to + at[q] * stride + second) = sums[2 * q + 1];
            }
        }
    }
}

/* to = the sum of four factors times four columns, number by number; columns and factors are `columns` and `factors`
   apart but for the last column. */
INLINE void mix(const double *factors, int apart, const double *columns, int columns_apart, const double *last, int count,
                double *to)
{
    int n;
    for (n = 0; n + VL <= count; n += VL)
        LOOSE(to + n) = CONST_LOOSE(factors + n) * CONST_LOOSE(columns + n) +
                        CONST_LOOSE(factors + apart + n) * CONST_LOOSE(columns + columns_apart + n) +
                        CONST_LOOSE(factors + 2 * apart + n) * CONST_LOOSE(columns + 2 * columns_apart + n) +
                        CONST_LOOSE(factors + 3 * apart + n) * CONST_LOOSE(last + n);
    for (; n < count; n++)
        to[n] = factors[n] * columns[n] + factors[apart + n] * columns[columns_apart + n] +
                factors[2 * apart + n] * columns[2 * columns_apart + n] + factors[3 * apart + n] * last[n];
}

static void filter_predict(const pmr_filter *f, double *memory, const pmr_filter_step *step)
{
    const filter_parts p = parts_of(f, memory);
    const size_t N = p.all, L = p.padded, n = f->states, r = n / 3, W = PMR_UP(r);
    const int spans[4] = {0, (int)(2 * r), (int)n, (int)p.parameters};
    const double inertia = payload_inertia(f, &p);
    /* F; Y (r, L), covariances of the acceleration with X; among accelerations Z (r, W); with predictions, by mode */
    double *next = p.work, *F = next + L, *Y = F + r * L, *Z = Y + r * L, *turned = Z + r * W, *T = turned + n * W;
    double *of_acceleration = T + 3 * L, *acceleration = of_acceleration + 3 * W;
    size_t i, j, part, from;
    int l;
    memset(F, 0, r * L * sizeof(double));
    for (j = 0; j < r; j++) memcpy(F + j * L, step->R + j * 2 * r, 2 * r * sizeof(double));
    set_load_columns(f, &p, step->G, r, F, L);
    multiply(F, p.P, (int)r, spans, (int)L, Y);
    for (j = 0; j < r; j++) {
        acceleration[j] = dot_loose(F + j * L, p.x, (int)L);
        if (f->payload >= 0) acceleration[j] += step->G[j * f->inputs + f->payload] * inertia;
        for (i = 0; i <= j; i++) {
            double sum = dot_loose(Y + j * L, F + i * L, (int)L);
            for (l = 0; l < f->loads; l++) {
                const double *by_load = step->G + f->load_inputs[l];
                sum += f->rough[l] * f->rough[l] * by_load[j * f->inputs] * by_load[i * f->inputs];
            }
            Z[j * W + i] = Z[i * W + j] = sum;
        }
        for (i = 0; i < n; i++) turned[i * W + j] = Y[j * L + i];
    }
    for (i = n; i < N; i++) {
        next[i] = f->decay[i] * p.x[i];
        for (j = n; j < N; j++) p.P[i * L + j] *= f->decay[i] * f->decay[j];
    }
    for (j = 0; j < r; j++) { /* rows of mode j, of which no other mode has need */
        memset(T, 0, (3 * L + 3 * W) * sizeof(double));
        for (part = 0; part < 3; part++) {
            const double *course = f->courses + part * 4 * r + j, factors[4] = {course[0], course[r], course[2 * r],
                                                                                course[3 * r]};
            add_columns(p.P + j * L, (int)(r * L), factors, 3, T + part * L, (int)L);
            add_columns(Y + j * L, 0, factors + 3, 1, T + part * L, (int)L);
            add_columns(turned + j * W, (int)(r * W), factors, 3, of_acceleration + part * W, (int)W);
            add_columns(Z + j * W, 0, factors + 3, 1, of_acceleration + part * W, (int)W);
            next[part * r + j] = factors[0] * p.x[j] + factors[1] * p.x[r + j] + factors[2] * p.x[2 * r + j] +
                                 factors[3] * acceleration[j];
        }
        for (part = 0; part < 3; part++) {
            double *row = p.P + (part * r + j) * L;
            for (from = 0; from <= part; from++) /* half of the symmetric part */
                mix(f->courses + from * 4 * r, (int)r, T + part * L, (int)r, of_acceleration + part * W,
                    (int)(from < part ? r : j + 1), row + from * r);
            for (i = n; i < N; i++) row[i] = T[part * L + i] * f->decay[i];
        }
    }
    for (i = 0; i < n; i++) {
        for (j = 0; j < i; j++) p.P[j * L + i] = p.P[i * L + j];
        for (j = n; j < N; j++) p.P[j * L + i] = p.P[i * L + j];
    }
    memcpy(p.x, next, N * sizeof(double));
    for (i = 0; i < N; i++) p.P[i * L + i] += f->added[i];
}
