#include "rows.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

typedef struct {
    int path, intervals;
    int rows, stays; /* contacts that travel, and that stay */
    int first_mode, modes, first_input, inputs, first_output, outputs; /* those of the body */
    int powers_C, powers_G, powers_H, powers_X; /* table_S has those of H */
    int at_breaks, at_contacts, at_C, at_G, at_S, at_H, at_X; /* where it begins in the arrays of rows.h */
    int carriers, width, at_touched, at_weights; /* of a block of a pair: all carriers, and those of a contact */
} Block;

typedef struct {
    int first, second; /* blocks */
    int at_between;
} Pair;

static const Block blocks[BLOCKS] = {BLOCK_LIST};

/* Number of the interval of a block that holds s, sought from `near` on. */
static int interval_of(const Block *block, double s, int near)
{
    const double *ends = breaks + block->at_breaks;
    while (near > 0 && s < ends[near]) near--;
    while (near < block->intervals - 1 && s >= ends[near + 1]) near++;
    return near;
}

/* Values (width,) of polynomials at x, or `scale` times their derivatives of some order. */
static void evaluate(const double *coefficients, int powers, int width, double x, int order, double scale, double *values)
{
    int n, p, d;
    if (order == 0) {
        for (n = 0; n < width; n++) values[n] = coefficients[n];
        for (p = 1; p < powers; p++)
            for (n = 0; n < width; n++) values[n] = values[n] * x + coefficients[p * width + n];
        return;
    }
    for (n = 0; n < width; n++) values[n] = 0.0;
    for (p = 0; p < powers - order; p++) {
        double factor = scale;
        for (d = 0; d < order; d++) factor *= powers - 1 - p - d;
        for (n = 0; n < width; n++) values[n] = values[n] * x + factor * coefficients[p * width + n];
    }
}

/* What a table of a block has in the present interval. */
static const double *present(const Body *body, int b, const double *table, int first, int powers, int width)
{
    return table + first + body->place.interval[b] * powers * width;
}

/* The order of a derivative along directions, and what it has to be multiplied by. */
static int order_of(const Block *block, const double *along, const double *and_along, double *factor)
{
    *factor = (along ? along[block->path] : 1.0) * (and_along ? and_along[block->path] : 1.0);
    return (along != NULL) + (and_along != NULL);
}

#if WHOLE
static void add_blocks(const Body *body, const double *along, const double *and_along, Rows *rows)
{
    const Block *block = blocks;
    double factor, x = body->place.x[0];
    int order = order_of(block, along, and_along, &factor), n;
    evaluate(present(body, 0, table_C, 0, block->powers_C, ROWS * MODES), block->powers_C, ROWS * MODES, x, order, factor,
             rows->C[0]);
    evaluate(present(body, 0, table_G, 0, block->powers_G, ROWS * ROWS), block->powers_G, ROWS * ROWS, x, order, factor,
             rows->F[0]);
    evaluate(present(body, 0, table_H, 0, block->powers_H, ROWS * INPUTS), block->powers_H, ROWS * INPUTS, x, order, factor,
             rows->H[0]);
    for (n = 0; n < ROWS && order == 0; n++) rows->F[n][n] += constant_F[n][n];
}
#else
static const Pair pairs[] = {PAIR_LIST}; /* one that is none where there is none */

/* Weights of a contact of a block on its carriers, or their derivatives of some order. */
static void weigh(const Body *body, int b, int k, int order, double *values)
{
    const Block *block = blocks + b;
    int size = block->powers_C * block->width;
    evaluate(weights + block->at_weights + (body->place.interval[b] * block->rows + k) * size, block->powers_C, block->width,
             body->place.x[b], order, 1.0, values);
}

/* G between a contact of each of a pair's blocks, or its derivative of orders in either path coordinate. */
static double couple(const Body *body, const Pair *pair, int k, int l, int order, int other_order)
{
    const Block *first = blocks + pair->first, *second = blocks + pair->second;
    const int *of_k = touched + first->at_touched + (body->place.interval[pair->first] * first->rows + k) * first->width;
    const int *of_l = touched + second->at_touched + (body->place.interval[pair->second] * second->rows + l) * second->width;
    double w[WIDTH], v[WIDTH], sum = 0.0;
    int m, n;
    weigh(body, pair->first, k, order, w);
    weigh(body, pair->second, l, other_order, v);
    for (m = 0; m < first->width; m++)
        for (n = 0; n < second->width; n++) sum += w[m] * between[pair->at_between + of_k[m] * second->carriers + of_l[n]] * v[n];
    return sum;
}

static void add_pair(const Body *body, const Pair *pair, const double *along, const double *and_along, Rows *rows)
{
    const Block *first = blocks + pair->first, *second = blocks + pair->second;
    int k, l, p = first->path, q = second->path;
    for (k = 0; k < first->rows; k++)
        for (l = 0; l < second->rows; l++) {
            int a = contacts[first->at_contacts + k], b = contacts[second->at_contacts + l];
            double value;
            if (!along)
                value = couple(body, pair, k, l, 0, 0);
            else if (!and_along)
                value = along[p] * couple(body, pair, k, l, 1, 0) + along[q] * couple(body, pair, k, l, 0, 1);
            else
                value = along[p] * and_along[p] * couple(body, pair, k, l, 2, 0) +
                        (along[p] * and_along[q] + along[q] * and_along[p]) * couple(body, pair, k, l, 1, 1) +
                        along[q] * and_along[q] * couple(body, pair, k, l, 0, 2);
            rows->F[a][b] += value;
            rows->F[b][a] += value;
        }
}

static void add_block(const Body *body, int b, const double *along, const double *and_along, Rows *rows)
{
    const Block *block = blocks + b;
    const int *on = contacts + block->at_contacts, *staying = on + block->rows;
    double factor, x = body->place.x[b], values[LARGEST];
    int order = order_of(block, along, and_along, &factor), k, n;
    int r = block->modes, m = block->rows, s = block->stays, i = block->inputs;
    if (factor == 0.0) return;
    evaluate(present(body, b, table_C, block->at_C, block->powers_C, m * r), block->powers_C, m * r, x, order, factor, values);
    for (k = 0; k < m; k++)
        for (n = 0; n < r; n++) rows->C[on[k]][block->first_mode + n] += values[k * r + n];
    evaluate(present(body, b, table_G, block->at_G, block->powers_G, m * m), block->powers_G, m * m, x, order, factor, values);
    for (k = 0; k < m; k++)
        for (n = 0; n < m; n++) rows->F[on[k]][on[n]] += values[k * m + n];
    evaluate(present(body, b, table_S, block->at_S, block->powers_H, m * s), block->powers_H, m * s, x, order, factor, values);
    for (k = 0; k < m; k++)
        for (n = 0; n < s; n++) {
            rows->F[on[k]][staying[n]] += values[k * s + n];
            rows->F[staying[n]][on[k]] += values[k * s + n];
        }
    evaluate(present(body, b, table_H, block->at_H, block->powers_H, m * i), block->powers_H, m * i, x, order, factor, values);
    for (k = 0; k < m; k++)
        for (n = 0; n < i; n++) rows->H[on[k]][block->first_input + n] += values[k * i + n];
}

static void add_blocks(const Body *body, const double *along, const double *and_along, Rows *rows)
{
    int b;
    memset(rows, 0, sizeof *rows);
    if (!along) {
        memcpy(rows->C, constant_C, sizeof rows->C);
        memcpy(rows->F, constant_F, sizeof rows->F);
        memcpy(rows->H, constant_H, sizeof rows->H);
    }
    for (b = 0; b < BLOCKS; b++) add_block(body, b, along, and_along, rows);
    for (b = 0; b < PAIRS; b++) add_pair(body, pairs + b, along, and_along, rows);
}
#endif

int place(Body *body)
{
    Place *place = &body->place;
    const double *s = body->memory.variables + PATH;
    int p, b, same = place->known;
    for (p = 0; p < PATHS; p++) same = same && place->s[p] == s[p];
    if (same) return 0;
    place->known = 0;
    for (p = 0; p < PATHS; p++) {
        double low = path_ends[p][0], high = path_ends[p][1], slack = BEYOND_ENDS * (high - low);
        if (!(s[p] >= low - slack && s[p] <= high + slack)) {
            snprintf(body->message, sizeof body->message, "%s = %.9g m lies off the path: %.9g to %.9g m is allowed",
                     path_names[p], s[p], low, high);
            return 1;
        }
        place->s[p] = s[p];
    }
    for (b = 0; b < BLOCKS; b++) {
        const Block *block = blocks + b;
        double at = fmin(fmax(s[block->path], path_ends[block->path][0]), path_ends[block->path][1]);
        place->interval[b] = interval_of(block, at, place->interval[b]);
        place->x[b] = at - breaks[block->at_breaks + place->interval[b]];
    }
    add_blocks(body, NULL, NULL, &place->rows);
    place->known = 1;
    return 0;
}

void change(const Body *body, const double *along, const double *and_along, Rows *rows)
{
    add_blocks(body, along, and_along, rows);
}

void add_local(const Body *body, const double *along, const double *and_along, const double *multipliers, double factor,
               double *y)
{
    int b, p, d, k, n;
#if !WHOLE
    if (!along)
        for (k = 0; k < ROWS; k++)
            for (n = 0; n < OUTPUTS; n++) y[n] += factor * multipliers[k] * constant_X[k][n];
#endif
    for (b = 0; b < BLOCKS; b++) {
        const Block *block = blocks + b;
        const double *table = present(body, b, table_X, block->at_X, block->powers_X, block->rows * block->outputs);
        double power, x = body->place.x[b], *of_body = y + block->first_output;
        int order = order_of(block, along, and_along, &power);
        power *= factor;
        for (p = block->powers_X - 1 - order; p >= 0; p--) {
            double share = power;
            for (d = 0; d < order; d++) share *= block->powers_X - 1 - p - d;
            for (k = 0; k < block->rows; k++) {
                const double *column = table + (p * block->rows + k) * block->outputs;
                double scale = share * multipliers[WHOLE ? k : contacts[block->at_contacts + k]];
                if (scale == 0.0) continue;
                for (n = 0; n < block->outputs; n++) of_body[n] += scale * column[n];
            }
            power *= x;
        }
    }
}

void say_where(const Body *body, char *text, size_t size)
{
    size_t used = 0;
    int p;
    text[0] = 0;
    for (p = 0; p < PATHS && used < size; p++)
        used += snprintf(text + used, size - used, "%s%s = %g m", p ? ", " : "", path_names[p],
                         body->memory.variables[PATH + p]);
}
