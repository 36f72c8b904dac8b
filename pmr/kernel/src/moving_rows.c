/* C, H and F (or A) of rows with their first and second rates as the paths move: the polynomials of rows.c for numbers
   that carry their rates with them. */

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

/* The same of `width` polynomials side by side, as many as registers have at most; how many these are. */
INLINE int polynomials(const double *c, int powers, int stride, int width, moved x, moved *values)
{
    int n, p;
    if (width < PMR_LANES) {
        for (n = 0; n < width; n++) values[n] = polynomial(c + n, powers, stride, x);
        return width;
    }
    for (n = 0; n < PMR_LANES; n += VL) {
        vec value = {0.0}, rate = {0.0}, second = {0.0};
        for (p = 0; p < powers; p++) {
            second = second * x.at + rate * (2.0 * x.rate) + value * x.second;
            rate = rate * x.at + value * x.rate;
            value = value * x.at + CONST_LOOSE(c + (size_t)p * stride + n);
        }
        for (p = 0; p < VL; p++)
            values[n + p] = (moved){((double *)&value)[p], ((double *)&rate)[p], ((double *)&second)[p]};
    }
    return PMR_LANES;
}

/* Tables of rows by order, NULL where an order is not asked for. */
typedef struct {
    double *C[3], *H[3], *A[3]; /* (rows, r'), (rows, ip), (rows, mp) */
} moved_tables;

INLINE void add_moved(double *const table[3], size_t at, double factor, moved value)
{
    if (table[0]) table[0][at] += factor * value.at;
    if (table[1]) table[1][at] += factor * value.rate;
    if (table[2]) table[2][at] += factor * value.second;
}

/* Add `width` polynomials side by side at x to tables from `at` on. */
static void add_polynomials(double *const table[3], size_t at, const double *c, int powers, int stride, int width, moved x)
{
    int n, p;
    for (n = 0; n + VL <= width; n += VL) {
        vec value = {0.0}, rate = {0.0}, second = {0.0};
        for (p = 0; p < powers; p++) {
            if (table[2]) second = second * x.at + rate * (2.0 * x.rate) + value * x.second;
            rate = rate * x.at + value * x.rate;
            value = value * x.at + CONST_LOOSE(c + (size_t)p * stride + n);
        }
        if (table[0]) LOOSE(table[0] + at + n) += value;
        if (table[1]) LOOSE(table[1] + at + n) += rate;
        if (table[2]) LOOSE(table[2] + at + n) += second;
    }
    for (; n < width; n++) add_moved(table, at + n, 1.0, polynomial(c + n, powers, stride, x));
}

/* Entries k, l and l, k of A; `twice` where k is l and both are that one. */
INLINE void add_both(const moved_tables *to, int mp, int k, int l, int twice, moved value)
{
    add_moved(to->A, (size_t)k * mp + l, twice ? 2.0 : 1.0, value);
    if (k != l) add_moved(to->A, (size_t)l * mp + k, 1.0, value);
}

static void move_block(const pmr_state *st, int number, const double *of_A, moved x, const moved_tables *to)
{
    const pmr_system *y = st->system;
    const pmr_block *b = y->block_list + number;
    const int32_t *on = y->block_rows + b->at_rows, *staying = on + b->rows;
    const int m = b->rows, w = b->modes, g = PMR_UP(m), t = PMR_UP(b->stays), i = PMR_UP(b->inputs);
    const double *C = in_interval(st, number, y->table_C, b->at_C, b->powers_C, m * w),
                 *H = in_interval(st, number, y->table_H, b->at_H, b->powers_H, m * i), *S = of_A + b->powers_G * m * g;
    moved values[PMR_LANES];
    int k, n, j, some;
    for (k = 0; k < m; k++) {
        add_polynomials(to->C, (size_t)on[k] * y->modes + b->first_mode, C + k * w, b->powers_C, m * w, w, x);
        add_polynomials(to->H, (size_t)on[k] * y->ip + b->first_input, H + k * i, b->powers_H, m * i, b->inputs, x);
        for (n = 0; n <= k; n += some) {
            some = polynomials(of_A + k * g + n, b->powers_G, m * g, g - n, x, values);
            for (j = 0; j < some && n + j <= k; j++)
                add_both(to, y->mp, on[k], on[n + j], k != n + j && on[k] == on[n + j], values[j]);
        }
        for (n = 0; n < b->stays; n += some) {
            some = polynomials(S + k * t + n, b->powers_S, m * t, t - n, x, values);
            for (j = 0; j < some && n + j < b->stays; j++)
                add_both(to, y->mp, on[k], staying[n + j], on[k] == staying[n + j], values[j]);
        }
    }
}

static void move_pair(const pmr_state *st, int number, const double *tables, moved s, moved t, const moved_tables *to)
{
    const pmr_system *y = st->system;
    const pmr_block *one = y->block_list + y->pair_list[number].first,
                    *two = y->block_list + y->pair_list[number].second;
    const int p1 = one->powers_C, p2 = two->powers_C;
    moved values[PMR_LANES];
    int k, l, p, j, some;
    for (k = 0; k < one->rows; k++)
        for (l = 0; l < two->rows; l++) {
            const double *table = tables + (size_t)(k * two->rows + l) * p1 * p2;
            const int a = y->block_rows[one->at_rows + k], b = y->block_rows[two->at_rows + l];
            moved sum = {0.0, 0.0, 0.0};
            for (p = 0; p < p1; p += some) {
                some = polynomials(table + p, p2, p1, p1 - p, t, values);
                for (j = 0; j < some; j++) sum = plus_moved(times_moved(sum, s), values[j]);
            }
            add_both(to, y->mp, a, b, a == b, sum);
        }
}

/* Add what moves with the paths, where the rows stand with `c`, to tables; `paths` (P,) have the paths' rates. */
static void move_rows(const pmr_state *st, const pmr_scheme *c, const moved *paths, const moved_tables *to)
{
    const pmr_system *y = st->system;
    const double *of_A = c->of_blocks, *of_pair = c->of_pairs;
    int k, n;
    for (k = 0; k < y->blocks; k++) {
        const pmr_block *block = y->block_list + k;
        const moved s = paths[block->path];
        if (to->A[0] || s.rate != 0.0) move_block(st, k, of_A, (moved){st->x[k], s.rate, s.second}, to);
        of_A += block_room(block);
    }
    for (k = 0; k < y->pairs; k++) {
        const pmr_pair *pair = y->pair_list + k;
        const pmr_block *one = y->block_list + pair->first, *two = y->block_list + pair->second;
        const moved s = paths[one->path], t = paths[two->path];
        if (to->A[0] || s.rate != 0.0 || t.rate != 0.0)
            move_pair(st, k, of_pair, (moved){st->x[pair->first], s.rate, s.second},
                      (moved){st->x[pair->second], t.rate, t.second}, to);
        of_pair += pair_size(one, two);
    }
    for (k = 0; k < y->ropes; k++)
        for (n = 0; n < y->rows * y->mp; n++)
            add_moved(to->A, n, y->rope_slopes[(size_t)k * y->rows * y->mp + n], paths[y->rope_paths[k]]);
}
