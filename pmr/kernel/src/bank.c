/* A bank of Kalman filters with stationary gains, one for each place of a path and each speed along it, whose
   probabilities and states are mixed in each step (interacting multiple models: Blom and Bar-Shalom, IEEE Transactions
   on Automatic Control 33, 1988).

   With probabilities p_di of speed d at place i and states x_di, a step changes speeds by W = (1 - a) rest + a active,
   moves places by `up` and `down`, predicts F_i x_di, corrects by the innovation e = y - H_i x_di, and weights by
   exp(-temper / 2 (ln V_i + e^2 / (V_i level))) and by what else tells the speed, `of_speeds`.  The level, a running
   mean of e^2 / V, scales all covariances.

   Measurements behind a step tell more of its place: with predictions q of the next step from p, and probabilities g of
   that step which are known already, g_now = p M (g / q), where M is the chance to change from one speed and place to
   another (Kitagawa, Journal of the American Statistical Association 82, 1987). */
#include "pmr_kernel.h"

#include <math.h>
#include <string.h>

#define LEAST 1e-10 /* probability that no model falls below */

size_t pmr_bank_memory(const pmr_bank *b)
{
    const size_t models = (size_t)b->speeds * b->places;
    return models * (2 * (size_t)b->states + 3) + (size_t)b->speeds * b->speeds + (size_t)b->states + 1;
}

void pmr_bank_start(const pmr_bank *b, double *memory)
{
    const size_t models = (size_t)b->speeds * b->places;
    size_t k;
    memset(memory, 0, pmr_bank_memory(b) * sizeof(double));
    memory[0] = b->floor;
    for (k = 0; k < models; k++) memory[1 + k] = 1.0 / (double)models;
}

/* Chances (D, D) to change from one speed to another. */
static void mix_speeds(const pmr_bank *b, double activity, double *W)
{
    int j;
    for (j = 0; j < b->speeds * b->speeds; j++) W[j] = (1.0 - activity) * b->rest[j] + activity * b->active[j];
}

/* Speeds change at each place: probabilities p to q, states x to z. */
static void change_speeds(const pmr_bank *b, const double *W, const double *p, const double *x, double *q, double *z)
{
    const int D = b->speeds, S = b->places, n = b->states;
    int d, e, i, c;
    memset(z, 0, (size_t)D * S * n * sizeof(double));
    for (d = 0; d < D; d++)
        for (i = 0; i < S; i++) {
            double sum = 1e-300, *to = z + ((size_t)d * S + i) * n;
            for (e = 0; e < D; e++) {
                const double share = p[e * S + i] * W[e * D + d], *from = x + ((size_t)e * S + i) * n;
                sum += share;
                for (c = 0; c < n; c++) to[c] += share * from[c];
            }
            q[d * S + i] = sum;
            for (c = 0; c < n; c++) to[c] /= sum;
        }
}

/* State that arrives at place i with speed d, in `to`; its probability is returned. */
static double arrive(const pmr_bank *b, const double *q, const double *z, int d, int i, double *to)
{
    const int S = b->places, n = b->states;
    const double up = b->up[d], down = b->down[d];
    double share = q[d * S + i] * (1.0 - (i < S - 1 ? up : 0.0) - (i > 0 ? down : 0.0)), sum = share + 1e-300;
    const double *from = z + ((size_t)d * S + i) * n;
    int c;
    for (c = 0; c < n; c++) to[c] = share * from[c];
    if (i > 0) {
        sum += share = q[d * S + i - 1] * up;
        for (c = 0; c < n; c++) to[c] += share * from[c - n];
    }
    if (i < S - 1) {
        sum += share = q[d * S + i + 1] * down;
        for (c = 0; c < n; c++) to[c] += share * from[c + n];
    }
    for (c = 0; c < n; c++) to[c] /= sum;
    return sum;
}

void pmr_bank_advance(const pmr_bank *b, double *memory, int64_t steps, const double *y, const double *activity,
                      const double *least_level, const double *of_speeds, const pmr_bank_record *record)
{
    const int D = b->speeds, S = b->places, n = b->states;
    const size_t models = (size_t)D * S;
    double *level = memory, *p = memory + 1, *q = p + models, *e = q + models, *x = e + models;
    double *z = x + models * n, *W = z + models * n, *room = W + (size_t)D * D;
    int64_t k;
    for (k = 0; k < steps; k++) {
        const int missing = !isfinite(y[k]);
        double power = 0.0, top = -1e300, total = 0.0;
        size_t j;
        int d, i, c, a;
        mix_speeds(b, activity[k], W);
        change_speeds(b, W, p, x, q, z);
        for (d = 0; d < D; d++)
            for (i = 0; i < S; i++) {
                const double *F = b->F + (size_t)i * n * n, *H = b->H + (size_t)i * n;
                double expected = 0.0, *to = x + ((size_t)d * S + i) * n;
                j = (size_t)d * S + i;
                p[j] = arrive(b, q, z, d, i, room);
                for (a = 0; a < n; a++) {
                    double sum = 0.0;
                    for (c = 0; c < n; c++) sum += F[a * n + c] * room[c];
                    to[a] = sum;
                    expected += H[a] * sum;
                }
                e[j] = missing ? 0.0 : y[k] - expected;
                power += p[j] * e[j] * e[j] / b->variance[i];
            }
        if (!missing) *level += (power > *level ? b->attack : b->decay) * (power - *level);
        *level = fmax(*level, fmax(b->floor, least_level[k]));
        for (j = 0; j < models; j++) {
            const size_t at = j % S;
            const double V = b->variance[at], squares = log(V) + e[j] * e[j] / (V * *level);
            for (c = 0; c < n; c++) x[j * n + c] += b->gain[at * n + c] * e[j];
            e[j] = of_speeds[k * D + (int64_t)(j / S)] - (missing ? 0.0 : 0.5 * b->temper * squares);
            top = fmax(top, e[j]);
        }
        for (j = 0; j < models; j++) total += p[j] = p[j] * exp(e[j] - top) + (missing ? 0.0 : LEAST);
        memset(room, 0, n * sizeof(double));
        for (j = 0; j < models; j++) {
            p[j] /= total;
            record->probability[(size_t)k * models + j] = p[j];
            for (c = 0; c < n; c++) room[c] += p[j] * x[j * n + c];
        }
        memcpy(record->states + (size_t)k * n, room, n * sizeof(double));
        record->level[k] = *level;
    }
}

/* Probabilities `now` (D, S) of a step with those p that it had from measurements so far, as `now` has those of the next
   step; `work` is for (2, D, S). */
static void look_back(const pmr_bank *b, const double *W, const double *p, double *now, double *work)
{
    const int D = b->speeds, S = b->places;
    double *q = work, *back = work + D * S, total = 0.0;
    int d, e, i;
    memset(q, 0, (size_t)D * S * sizeof(double));
    for (d = 0; d < D; d++)
        for (e = 0; e < D; e++)
            for (i = 0; i < S; i++) q[d * S + i] += p[e * S + i] * W[e * D + d];
    for (d = 0; d < D; d++) {
        const double up = b->up[d], down = b->down[d], *of = q + d * S;
        double *share = now + d * S;
        for (i = 0; i < S; i++) {
            const double stays = 1.0 - (i < S - 1 ? up : 0.0) - (i > 0 ? down : 0.0);
            share[i] /= of[i] * stays + (i > 0 ? of[i - 1] * up : 0.0) + (i < S - 1 ? of[i + 1] * down : 0.0) + 1e-300;
        }
        for (i = 0; i < S; i++) {
            const double stays = 1.0 - (i < S - 1 ? up : 0.0) - (i > 0 ? down : 0.0);
            back[d * S + i] = share[i] * stays + (i < S - 1 ? share[i + 1] * up : 0.0) + (i > 0 ? share[i - 1] * down : 0.0);
        }
    }
    for (e = 0; e < D; e++)
        for (i = 0; i < S; i++) {
            double sum = 0.0;
            for (d = 0; d < D; d++) sum += W[e * D + d] * back[d * S + i];
            total += now[e * S + i] = p[e * S + i] * sum;
        }
    for (i = 0; i < D * S; i++) now[i] /= total;
}

void pmr_bank_places(const pmr_bank *b, double *memory, int64_t steps, const double *activity, int64_t delay,
                     const double *probability, double *places)
{
    const int S = b->places;
    const size_t models = (size_t)b->speeds * S;
    const int64_t block = delay < steps ? 1 : steps; /* one way back through the whole record, or one for each step */
    double *now = memory, *W = now + models, *work = W + (size_t)b->speeds * b->speeds;
    int64_t first, k;
    memset(places, 0, (size_t)steps * S * sizeof(double));
    for (first = 0; first < steps; first += block) {
        const int64_t last = delay < steps - first ? first + delay : steps - 1;
        for (k = last; k >= first; k--) {
            const double *p = probability + (size_t)k * models;
            size_t j;
            if (k == last) {
                memcpy(now, p, models * sizeof(double));
            } else {
                mix_speeds(b, activity[k + 1], W);
                look_back(b, W, p, now, work);
            }
            for (j = 0; j < models && k < first + block; j++) places[(size_t)k * S + j % S] += now[j];
        }
    }
}
