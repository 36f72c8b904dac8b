/* The rows of all contacts where the paths stand: C, H and the matrix of a step, A = F + z_gain C S^-1 C^T.

   C and H are tables of the system.  A has tables of its own: those of F, to which products of the polynomials of C
   are added on the way into an interval, for each length of step.  So a step evaluates polynomials and never
   multiplies C S^-1 C^T. */

static const double *in_interval(const pmr_state *st, int block, const double *table, int first, int powers, int width)
{
    return table + first + (size_t)st->interval[block] * powers * width;
}

INLINE double clipped(double s, const double *ends) { return s < ends[0] ? ends[0] : (s > ends[1] ? ends[1] : s); }

/* Room of a block in `pmr_scheme.of_blocks`. */
INLINE size_t block_room(const pmr_block *block)
{
    return (size_t)block->rows * (block->powers_G * PMR_UP(block->rows) + block->powers_S * PMR_UP(block->stays));
}

/* Tables of a block in the interval where it stands: those of F, and what modes add. */
APART void enter_block(const pmr_state *st, const pmr_scheme *c, int number, double *tables)
{
    const pmr_system *y = st->system;
    const pmr_block *b = y->block_list + number;
    const int m = b->rows, w = b->modes, g = PMR_UP(m), t = PMR_UP(b->stays), pG = b->powers_G, pC = b->powers_C,
              pS = b->powers_S;
    const double *C = in_interval(st, number, y->table_C, b->at_C, pC, m * w);
    const int32_t *staying = y->block_rows + b->at_rows + m;
    double *G = tables, *S = tables + pG * m * g, *weighted = st->scratch;
    int k, l, p, q, n;
    memcpy(G, in_interval(st, number, y->table_G, b->at_G, pG, m * g), (size_t)pG * m * g * sizeof(double));
    memcpy(S, in_interval(st, number, y->table_S, b->at_S, pS, m * t), (size_t)pS * m * t * sizeof(double));
    for (p = 0; p < pC; p++)
        for (k = 0; k < m; k++) {
            over_S(y, c, C + (p * m + k) * w, b->first_mode, b->first_mode + w, weighted);
            for (n = 0; n < w; n++) weighted[n] *= c->z_gain;
            for (q = 0; q < pC; q++) /* powers are the highest first */
                for (l = 0; l <= k; l++)
                    G[(pG + 1 - 2 * pC + p + q) * m * g + k * g + l] += dot(weighted, C + (q * m + l) * w, 0, w);
            for (l = 0; l < b->stays; l++)
                S[(pS - pC + p) * m * t + k * t + l] +=
                    dot(weighted, y->C0 + staying[l] * y->modes + b->first_mode, 0, w);
        }
    if (y->whole)
        for (k = 0; k < m; k++)
            for (l = 0; l <= k; l++) G[(pG - 1) * m * g + k * g + l] += y->F0[k * y->mp + l];
}

INLINE double *lower(double *A, int stride, int k, int l) { return A + (k > l ? k * stride + l : l * stride + k); }

static void add_block(pmr_state *st, int number, const double *of_A, double x)
{
    const pmr_system *y = st->system;
    const pmr_block *b = y->block_list + number;
    const int32_t *on = y->block_rows + b->at_rows, *staying = on + b->rows;
    const int m = b->rows, w = b->modes, g = PMR_UP(m), t = PMR_UP(b->stays), i = PMR_UP(b->inputs), mp = y->mp;
    const double *C = in_interval(st, number, y->table_C, b->at_C, b->powers_C, m * w);
    double *values = st->scratch;
    int k, n;
    evaluate(C, b->powers_C, m * w, m * w, x, values);
    for (k = 0; k < m; k++)
        for (n = 0; n < w; n += VL) V(st->C + on[k] * y->modes + b->first_mode + n) += CV(values + k * w + n);
    evaluate(of_A, b->powers_G, m * g, m * g, x, values);
    for (k = 0; k < m; k++)
        for (n = 0; n <= k; n++)
            *lower(st->A, mp, on[k], on[n]) += values[k * g + n] * (k != n && on[k] == on[n] ? 2.0 : 1.0);
    if (t) {
        evaluate(of_A + b->powers_G * m * g, b->powers_S, m * t, m * t, x, values);
        for (k = 0; k < m; k++)
            for (n = 0; n < b->stays; n++)
                *lower(st->A, mp, on[k], staying[n]) += values[k * t + n] * (on[k] == staying[n] ? 2.0 : 1.0);
    }
    if (i) {
        evaluate(in_interval(st, number, y->table_H, b->at_H, b->powers_H, m * i), b->powers_H, m * i, m * i, x,
                 values);
        for (k = 0; k < m; k++)
            for (n = 0; n < b->inputs; n++) st->H[on[k] * y->ip + b->first_input + n] += values[k * i + n];
    }
}

INLINE size_t pair_size(const pmr_block *one, const pmr_block *two)
{
    return (size_t)one->rows * two->rows * one->powers_C * two->powers_C;
}

/* Polynomials (rows, rows, q, p) of a pair in the intervals where it stands: w R v^T, and what modes add. */
APART void enter_pair(pmr_state *st, const pmr_scheme *c, int number, double *tables)
{
    const pmr_system *y = st->system;
    const pmr_pair *pair = y->pair_list + number;
    const pmr_block *one = y->block_list + pair->first, *two = y->block_list + pair->second;
    const int i = st->interval[pair->first], j = st->interval[pair->second], p1 = one->powers_C, p2 = two->powers_C,
              modes = one->modes;
    const double *C = in_interval(st, pair->first, y->table_C, one->at_C, p1, one->rows * modes);
    const double *D = in_interval(st, pair->second, y->table_C, two->at_C, p2, two->rows * modes);
    double *sums = st->pair_sums, *weighted = st->scratch;
    int k, l, p, q, a, b;
    for (k = 0; k < one->rows; k++) {
        const int32_t *of_k = y->touched + one->at_touched + (i * one->rows + k) * one->width;
        const double *w = y->weights + one->at_weights + (size_t)(i * one->rows + k) * p1 * one->width;
        const int32_t *summed = NULL; /* carriers that `sums` are of: often those of the next row too */
        for (l = 0; l < two->rows; l++) {
            const int32_t *of_l = y->touched + two->at_touched + (j * two->rows + l) * two->width;
            const double *v = y->weights + two->at_weights + (size_t)(j * two->rows + l) * p2 * two->width;
            double *table = tables + (size_t)(k * two->rows + l) * p1 * p2;
            if (!summed || memcmp(summed, of_l, (size_t)two->width * sizeof *of_l))
                for (b = 0; b < two->width; b++)
                    for (p = 0; p < p1; p++) {
                        double sum = 0.0;
                        for (a = 0; a < one->width; a++)
                            sum += w[p * one->width + a] *
                                   y->between[pair->at_between + (size_t)of_k[a] * two->carriers + of_l[b]];
                        sums[p * two->width + b] = sum;
                    }
            summed = of_l;
            for (q = 0; q < p2; q++)
                for (p = 0; p < p1; p++) {
                    double sum = 0.0;
                    for (b = 0; b < two->width; b++) sum += sums[p * two->width + b] * v[q * two->width + b];
                    table[q * p1 + p] = sum;
                }
        }
        for (p = 0; p < p1; p++) { /* what modes add */
            over_S(y, c, C + (p * one->rows + k) * modes, one->first_mode, one->first_mode + modes, weighted);
            for (l = 0; l < two->rows; l++)
                for (q = 0; q < p2; q++)
                    tables[((size_t)(k * two->rows + l) * p2 + q) * p1 + p] +=
                        c->z_gain * dot(weighted, D + (q * two->rows + l) * modes, 0, modes);
        }
    }
}

static void add_pair(pmr_state *st, int number, const double *tables)
{
    const pmr_system *y = st->system;
    const pmr_pair *pair = y->pair_list + number;
    const pmr_block *one = y->block_list + pair->first, *two = y->block_list + pair->second;
    const double s = st->x[pair->first], t = st->x[pair->second];
    const int p1 = one->powers_C, p2 = two->powers_C;
    int k, l, p, q;
    for (k = 0; k < one->rows; k++) {
        const int a = y->block_rows[one->at_rows + k];
        for (l = 0; l < two->rows; l++) {
            const int b = y->block_rows[two->at_rows + l];
            const double *table = tables + (size_t)(k * two->rows + l) * p1 * p2;
            double sum = 0.0;
            if (p1 == 4 && p2 == 4) {
                const double w[4] = {s * s * s, s * s, s, 1.0};
                for (p = 0; p < 4; p++)
                    sum += (((table[p] * t + table[4 + p]) * t + table[8 + p]) * t + table[12 + p]) * w[p];
            } else {
                for (p = 0; p < p1; p++) {
                    double value = table[p];
                    for (q = 1; q < p2; q++) value = value * t + table[q * p1 + p];
                    sum = sum * s + value;
                }
            }
            *lower(st->A, y->mp, a, b) += a == b ? 2.0 * sum : sum;
        }
    }
}

/* Ropes that get longer with a path. */
static void add_ropes(const pmr_system *y, const double *s, double *A)
{
    int k, n;
    for (k = 0; k < y->ropes; k++) {
        const double *slopes = y->rope_slopes + (size_t)k * y->rows * y->mp, at = s[y->rope_paths[k]];
        for (n = 0; n < y->rows * y->mp; n += VL) V(A + n) += CV(slopes + n) * at;
    }
}

/* Intervals of all blocks with the paths at s. */
static void find_intervals(pmr_state *st, const double *s)
{
    const pmr_system *y = st->system;
    int k;
    for (k = 0; k < y->blocks; k++) {
        const pmr_block *b = y->block_list + k;
        const double *breaks = y->breaks + b->at_breaks, at = clipped(s[b->path], y->path_ends + 2 * b->path);
        int j = st->interval[k];
        while (j > 0 && at < breaks[j]) j--;
        while (j < b->intervals - 1 && at >= breaks[j + 1]) j++;
        st->interval[k] = j;
        st->x[k] = at - breaks[j];
    }
}

/* Tables of a scheme where all blocks stand. */
static void enter_intervals(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    double *of_A = c->of_blocks, *of_pair = c->of_pairs;
    int k;
    for (k = 0; k < y->blocks; k++) {
        if (c->in_blocks[k] != st->interval[k]) enter_block(st, c, k, of_A);
        c->in_blocks[k] = st->interval[k];
        of_A += block_room(y->block_list + k);
    }
    for (k = 0; k < y->pairs; k++) {
        const int one = y->pair_list[k].first, two = y->pair_list[k].second;
        int32_t *in = c->in_pairs + 2 * k;
        if (in[0] != st->interval[one] || in[1] != st->interval[two]) enter_pair(st, c, k, of_pair);
        in[0] = st->interval[one], in[1] = st->interval[two];
        of_pair += pair_size(y->block_list + one, y->block_list + two);
    }
}

static void place_whole(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    const pmr_block *b = y->block_list;
    const int mp = y->mp;
    int k;
    evaluate(in_interval(st, 0, y->table_C, b->at_C, b->powers_C, y->rows * y->modes), b->powers_C, y->rows * y->modes,
             y->rows * y->modes, st->x[0], st->C);
    evaluate(in_interval(st, 0, y->table_H, b->at_H, b->powers_H, y->rows * y->ip), b->powers_H, y->rows * y->ip,
             y->rows * y->ip, st->x[0], st->H);
    for (k = 0; k < y->rows; k++)
        evaluate(c->of_blocks + k * mp, b->powers_G, y->rows * mp, PMR_UP(k + 1), st->x[0], st->A + k * mp);
}

static void place_blocks(pmr_state *st, const pmr_scheme *c, const double *s)
{
    const pmr_system *y = st->system;
    const double *of_A = c->of_blocks, *of_pair = c->of_pairs;
    int k;
    memcpy(st->C, y->C0, (size_t)y->rows * y->modes * sizeof(double));
    memcpy(st->A, c->F0, (size_t)y->rows * y->mp * sizeof(double));
    memcpy(st->H, y->H0, (size_t)y->rows * y->ip * sizeof(double));
    for (k = 0; k < y->blocks; k++) {
        add_block(st, k, of_A, st->x[k]);
        of_A += block_room(y->block_list + k);
    }
    for (k = 0; k < y->pairs; k++) {
        add_pair(st, k, of_pair);
        of_pair += pair_size(y->block_list + y->pair_list[k].first, y->block_list + y->pair_list[k].second);
    }
    if (y->ropes) add_ropes(y, s, st->A);
}

/* Take the rows to the paths s (P,); where all contacts hold both ways, A is factorised. */
static int place(pmr_state *st, const pmr_scheme *c, const double *s)
{
    const pmr_system *y = st->system;
    int same = st->placed, p, k;
    for (p = 0; p < y->paths; p++) {
        same = same && st->s[p] == s[p];
        st->s[p] = s[p];
    }
    if (same) return PMR_DONE;
    if (!st->moved) { /* those of the step before, for the balance of energy */
        double *C = st->C, *A = st->A, *H = st->H;
        st->C = st->old_C, st->A = st->old_A, st->H = st->old_H;
        st->old_C = C, st->old_A = A, st->old_H = H;
    }
    st->moved = 1;
    st->factored = -1;
    st->receptance_of = NULL;
    st->placed = 0;
    find_intervals(st, s);
    enter_intervals(st, c);
    if (y->whole)
        place_whole(st, c);
    else
        place_blocks(st, c, s);
    if (!y->pushing) {
        for (k = 0; k < y->contacts; k++)
            if (!factorise(st->A + k * y->mp, st->factor, k, y->mp)) {
                st->trouble = k;
                return PMR_DEPENDENT;
            }
        st->factored = y->contacts;
    }
    st->placed = 1;
    return PMR_DONE;
}
