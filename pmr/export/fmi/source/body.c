#include "body.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "contact.h"
#include "tables.h"

/* Share of its terms by which given states may move a rigid row. */
#define VIOLATED 1e-6
/* The same of given rates: a step of index 3 leaves O(h^2) of them, some 1e-4 in fast motions. */
#define VIOLATED_RATE 1e-2
/* Sets of closed rows that a static start tries. */
#define STATIC_TRIES 100

static int fail(Body *body, const char *why)
{
    snprintf(body->message, sizeof body->message, "%s", why);
    return 1;
}

/* result += factor * T x, for T (ROWS, width). */
static void add(const double *T, int width, const double *x, double factor, double *result)
{
    int k, n;
    for (k = 0; k < ROWS; k++) {
        double sum = 0.0;
        for (n = 0; n < width; n++) sum += T[k * width + n] * x[n];
        result[k] += factor * sum;
    }
}

/* forces -= C^T multipliers, or another table with values (ROWS, MODES). */
static void subtract_rows(const double *C, const double *multipliers, double *forces)
{
    int k, n;
    for (k = 0; k < ROWS; k++)
        for (n = 0; n < MODES; n++) forces[n] -= C[k * MODES + n] * multipliers[k];
}

/* Forces on the modes: B f - D v - Omega^2 z. */
static void free_forces(const double *f, const double *z, const double *v, double *forces)
{
    int n, l;
    for (n = 0; n < MODES; n++) forces[n] = -omega2[n] * z[n];
#if DAMPING_COUPLES
    for (n = 0; n < MODES; n++)
        for (l = 0; l < MODES; l++) forces[n] -= damping[n * MODES + l] * v[l];
#else
    for (n = 0; n < MODES; n++) forces[n] -= damping[n] * v[n];
#endif
    for (l = 0; l < INPUTS; l++)
        for (n = 0; n < MODES; n++) forces[n] += inputs[l][n] * f[l];
}

/* Accelerations S^-1 x with S = 1 + D dv + Omega^2 dz. */
static void over_S(const Scheme *scheme, const double *x, double *result)
{
    int n;
#if DAMPING_COUPLES
    int l;
    for (n = 0; n < MODES; n++) {
        result[n] = 0.0;
        for (l = 0; l < MODES; l++) result[n] += scheme->inverse[n * MODES + l] * x[l];
    }
#else
    for (n = 0; n < MODES; n++) result[n] = scheme->inverse[n] * x[n];
#endif
}

static int set_scheme(Body *body, double step, double rho_inf)
{
    Scheme *scheme = &body->scheme;
    int n;
    if (scheme->step == step && scheme->rho_inf == rho_inf) return 0;
    scheme->step = step;
    scheme->rho_inf = rho_inf;
    scheme->alpha_m = (2.0 * rho_inf - 1.0) / (rho_inf + 1.0); /* Chung, Hulbert 1993, eq. 25 */
    scheme->alpha_f = rho_inf / (rho_inf + 1.0);
    scheme->gamma = 0.5 + scheme->alpha_f - scheme->alpha_m;
    scheme->beta = (scheme->gamma + 0.5) * (scheme->gamma + 0.5) / 4.0;
    scheme->gain = (1.0 - scheme->alpha_f) / (1.0 - scheme->alpha_m);
    scheme->dz = step * step * scheme->beta * scheme->gain;
    scheme->dv = step * scheme->gamma * scheme->gain;
#if DAMPING_COUPLES
    {
        int l;
        for (l = 0; l < MODES; l++) { /* column l, which is row l too */
            double S[MODES * MODES], *column = scheme->inverse + l * MODES;
            for (n = 0; n < MODES * MODES; n++) S[n] = damping[n] * scheme->dv;
            for (n = 0; n < MODES; n++) {
                S[n * MODES + n] += 1.0 + omega2[n] * scheme->dz;
                column[n] = n == l;
            }
            if (solve_dense(MODES, S, column)) return fail(body, "the damping makes the step singular");
        }
    }
#else
    for (n = 0; n < MODES; n++) scheme->inverse[n] = 1.0 / (1.0 + damping[n] * scheme->dv + omega2[n] * scheme->dz);
#endif
    return 0;
}

/* Tables at the present path coordinate, with derivatives up to `order`. */
static int place(Body *body, int order)
{
    Place *place = &body->place;
    double s = body->memory.variables[PATH], low = breaks[0], high = breaks[INTERVALS];
    double slack = BEYOND_ENDS * (high - low), x;
    int j, k;
    if (place->s == s && place->order >= order) return 0;
    if (!(s >= low - slack && s <= high + slack)) {
        snprintf(body->message, sizeof body->message, "s = %.9g m lies off the path: %.9g to %.9g m is allowed", s, low,
                 high);
        return 1;
    }
    place->s = s;
    place->order = order;
    s = fmin(fmax(s, low), high);
    j = place->interval = interval_of(s, place->interval);
    x = s - breaks[j];
    evaluate(table_C[j][0], POWERS_C, ROWS * MODES, x, order, place->C[0][0]);
    evaluate(table_G[j][0], POWERS_G, ROWS * ROWS, x, order, place->F[0][0]);
    evaluate(table_H[j][0], POWERS_H, ROWS * INPUTS, x, order, place->H[0][0]);
    for (k = 0; k < ROWS; k++) place->F[0][k][k] += compliance[k];
    return 0;
}

/* y += factor * X(s) multipliers, or with the derivative of X of some order. */
static void add_local(const Body *body, const double *multipliers, int derivative, double factor, double *y)
{
    int j = body->place.interval, p, d, k, n;
    double x = fmin(fmax(body->place.s, breaks[0]), breaks[INTERVALS]) - breaks[j], power = factor;
    for (p = POWERS_X - 1 - derivative; p >= 0; p--) {
        double share = power;
        for (d = 0; d < derivative; d++) share *= POWERS_X - 1 - p - d;
        for (k = 0; k < ROWS; k++) {
            const double *column = table_X[j][p] + k * OUTPUTS;
            double scale = share * multipliers[k];
            if (scale == 0.0) continue;
            for (n = 0; n < OUTPUTS; n++) y[n] += scale * column[n];
        }
        power *= x;
    }
}

/* y = O z + W f. */
static void add_global(const double *z, const double *f, double *y)
{
    int n, l;
    for (n = 0; n < OUTPUTS; n++) y[n] = 0.0;
    for (l = 0; l < MODES; l++)
        for (n = 0; n < OUTPUTS; n++) y[n] += shapes[l][n] * z[l];
    for (l = 0; l < INPUTS; l++)
        for (n = 0; n < OUTPUTS; n++) y[n] += direct[l][n] * f[l];
}

/* Multipliers of the rows that give way, from the position; those of rigid ones as the last step left them. */
static int find_multipliers(Body *body)
{
    const double *u = body->memory.variables;
    double motion[ROWS] = {0.0};
    int k;
    if (place(body, 0)) return 1;
    add(body->place.C[0][0], MODES, u + STATES, 1.0, motion);
    add(body->place.H[0][0], INPUTS, u + LOADS, 1.0, motion);
    if (settle(body, body->place.F[0], motion, gives_way, body->multipliers)) return 1;
    for (k = 0; k < ROWS; k++)
        if (!gives_way[k]) body->multipliers[k] = body->memory.rigid[k];
    return 0;
}

void body_changed(Body *body) { body->fresh = body->moving = 0; }

void body_reset(Body *body)
{
    int k;
    memset(body, 0, sizeof *body);
    memcpy(body->memory.variables, start_values, sizeof start_values);
    body->memory.variables[START] = 0.0;
    body->place.order = -1;
    for (k = 0; k < ROWS; k++) body->memory.closed[k] = !pushes[k];
}

int body_evaluate(Body *body)
{
    double *u = body->memory.variables;
    int n;
    if (body->fresh) return 0;
    if (find_multipliers(body)) return 1;
    for (n = 0; n < MODES; n++) u[DERIVATIVES + n] = u[STATES + MODES + n];
    free_forces(u + LOADS, u + STATES, u + STATES + MODES, u + DERIVATIVES + MODES);
    subtract_rows(body->place.C[0][0], body->multipliers, u + DERIVATIVES + MODES);
    add_global(u + STATES, u + LOADS, u + DISPLACEMENTS);
    add_local(body, body->multipliers, 0, -1.0, u + DISPLACEMENTS);
    memcpy(u + FORCES, body->multipliers, sizeof body->multipliers);
    body->fresh = 1;
    return 0;
}

/* Rates of the multipliers that follow from the position: F lambda' = (C z + H f)' - F' lambda. */
int body_velocities(Body *body)
{
    double *u = body->memory.variables, ds = u[PATH_RATE];
    const Place *at = &body->place;
    if (body->moving) return 0;
    if (body_evaluate(body) || place(body, 1)) return 1;
    memset(body->rates, 0, sizeof body->rates);
    add(at->C[0][0], MODES, u + STATES + MODES, 1.0, body->rates);
    add(at->C[1][0], MODES, u + STATES, ds, body->rates);
    add(at->H[0][0], INPUTS, u + LOAD_RATES, 1.0, body->rates);
    add(at->H[1][0], INPUTS, u + LOADS, ds, body->rates);
    add(at->F[1][0], ROWS, body->multipliers, -ds, body->rates);
    if (solve_closed(body, body->place.F[0], gives_way, body->rates)) return 1;
    {
        int k;
        for (k = 0; k < ROWS; k++)
            if (!gives_way[k]) body->rates[k] = 0.0; /* it deforms nothing */
    }
    add_global(u + STATES + MODES, u + LOAD_RATES, u + VELOCITIES);
    add_local(body, body->rates, 0, -1.0, u + VELOCITIES);
    add_local(body, body->multipliers, 1, -ds, u + VELOCITIES);
    body->moving = 1;
    return 0;
}

/* The two above, differentiated along a direction of states and inputs. */
int body_differentiate(Body *body, const double *seed, double *answer)
{
    const double *u = body->memory.variables, *z = u + STATES, *v = z + MODES, *f = u + LOADS, *df = u + LOAD_RATES;
    const double *of_z = seed + STATES, *of_v = of_z + MODES, *of_f = seed + LOADS, *of_df = seed + LOAD_RATES;
    const double ds = u[PATH_RATE], of_s = seed[PATH], of_ds = seed[PATH_RATE];
    double along[ROWS] = {0.0}, forces[ROWS] = {0.0}, rates[ROWS] = {0.0}, scaled[ROWS];
    const Place *at = &body->place;
    int k, n;
    if (body_velocities(body) || place(body, 2)) return 1;
    add(at->C[1][0], MODES, z, 1.0, along); /* what a change of s alone moves the rows by */
    add(at->H[1][0], INPUTS, f, 1.0, along);
    add(at->F[1][0], ROWS, body->multipliers, -1.0, along);
    add(at->C[0][0], MODES, of_z, 1.0, forces);
    add(at->H[0][0], INPUTS, of_f, 1.0, forces);
    for (k = 0; k < ROWS; k++) forces[k] += of_s * along[k];
    if (solve_closed(body, body->place.F[0], gives_way, forces)) return 1;
    for (k = 0; k < ROWS; k++)
        if (!gives_way[k]) forces[k] = 0.0;
    add(at->C[0][0], MODES, of_v, 1.0, rates);
    add(at->H[0][0], INPUTS, of_df, 1.0, rates);
    for (k = 0; k < ROWS; k++) rates[k] += of_ds * along[k];
    add(at->C[1][0], MODES, of_z, ds, rates);
    add(at->H[1][0], INPUTS, of_f, ds, rates);
    add(at->F[1][0], ROWS, forces, -ds, rates);
    add(at->C[1][0], MODES, v, of_s, rates);
    add(at->H[1][0], INPUTS, df, of_s, rates);
    add(at->F[1][0], ROWS, body->rates, -of_s, rates);
    add(at->C[2][0], MODES, z, of_s * ds, rates);
    add(at->H[2][0], INPUTS, f, of_s * ds, rates);
    add(at->F[2][0], ROWS, body->multipliers, -of_s * ds, rates);
    if (solve_closed(body, body->place.F[0], gives_way, rates)) return 1;
    for (k = 0; k < ROWS; k++)
        if (!gives_way[k]) rates[k] = 0.0;
    for (n = 0; n < MODES; n++) answer[DERIVATIVES + n] = of_v[n];
    free_forces(of_f, of_z, of_v, answer + DERIVATIVES + MODES);
    for (k = 0; k < ROWS; k++) scaled[k] = of_s * body->multipliers[k];
    subtract_rows(body->place.C[0][0], forces, answer + DERIVATIVES + MODES);
    subtract_rows(body->place.C[1][0], scaled, answer + DERIVATIVES + MODES);
    add_global(of_z, of_f, answer + DISPLACEMENTS);
    add_local(body, forces, 0, -1.0, answer + DISPLACEMENTS);
    add_local(body, body->multipliers, 1, -of_s, answer + DISPLACEMENTS);
    add_global(of_v, of_df, answer + VELOCITIES);
    add_local(body, rates, 0, -1.0, answer + VELOCITIES);
    add_local(body, forces, 1, -ds, answer + VELOCITIES);
    add_local(body, body->multipliers, 1, -of_ds, answer + VELOCITIES);
    add_local(body, body->rates, 1, -of_s, answer + VELOCITIES);
    add_local(body, body->multipliers, 2, -of_s * ds, answer + VELOCITIES);
    memcpy(answer + FORCES, forces, sizeof forces);
    return 0;
}

/* Equilibrium under the loads: [Omega^2, C^T; C, -F] (z, lambda) = (B f, clearance - H f), open rows left out. */
static int find_equilibrium(Body *body)
{
    enum { SIZE = MODES + ROWS };
    double *u = body->memory.variables, A[SIZE * SIZE], x[SIZE], motion[ROWS];
    const double zero[MODES] = {0.0};
    int tries, k, l, n;
    for (k = 0; k < ROWS; k++) body->memory.closed[k] = 1.0;
    for (tries = 0; tries < STATIC_TRIES; tries++) {
        int wrong = 0;
        memset(A, 0, sizeof A);
        for (n = 0; n < MODES; n++) A[n * SIZE + n] = omega2[n];
        free_forces(u + LOADS, zero, zero, x);
        for (k = 0; k < ROWS; k++) {
            double *row = A + (MODES + k) * SIZE;
            x[MODES + k] = 0.0;
            if (body->memory.closed[k] == 0.0) {
                row[MODES + k] = 1.0;
                continue;
            }
            for (n = 0; n < MODES; n++) row[n] = A[n * SIZE + MODES + k] = body->place.C[0][k][n];
            for (l = 0; l < ROWS; l++) row[MODES + l] = gives_way[k] ? -body->place.F[0][k][l] : 0.0;
            for (l = 0; l < INPUTS; l++) x[MODES + k] -= body->place.H[0][k][l] * u[LOADS + l];
            x[MODES + k] += clearance[k];
        }
        if (solve_dense(SIZE, A, x)) return fail(body, "no static start: nothing holds the body");
        memset(motion, 0, sizeof motion);
        add(body->place.C[0][0], MODES, x, 1.0, motion);
        add(body->place.H[0][0], INPUTS, u + LOADS, 1.0, motion);
        add(body->place.F[0][0], ROWS, x + MODES, -1.0, motion);
        for (k = 0; k < ROWS; k++) {
            int closed = body->memory.closed[k] != 0.0;
            if (!pushes[k] || (closed ? x[MODES + k] >= 0.0 : motion[k] <= clearance[k])) continue;
            body->memory.closed[k] = !closed;
            wrong = 1;
        }
        if (!wrong) {
            memcpy(u + STATES, x, MODES * sizeof(double));
            return 0;
        }
    }
    return fail(body, "no static start: which pads are closed was not settled");
}

/* Rows that are rigid: A x = b with A = C C^T there, x in place of b and zero at the others. */
static int solve_rigid(Body *body, double *x)
{
    double A[ROWS * ROWS];
    int k, l, n;
    for (k = 0; k < ROWS; k++) {
        if (gives_way[k]) x[k] = 0.0;
        for (l = 0; l < ROWS; l++) {
            A[k * ROWS + l] = k == l && gives_way[k];
            if (gives_way[k] || gives_way[l]) continue;
            for (n = 0; n < MODES; n++) A[k * ROWS + l] += body->place.C[0][k][n] * body->place.C[0][l][n];
        }
    }
    return solve_dense(ROWS, A, x) ? fail(body, "rigid rows depend on each other at the start") : 0;
}

/* States that were set are the start, where no rigid row speaks against position or rates: C z = 0, C v + s' C' z = 0. */
static int take_given(Body *body)
{
    double *u = body->memory.variables, *z = u + STATES, *v = z + MODES;
    int k, n;
    memcpy(z, body->memory.given, sizeof body->memory.given);
    for (k = 0; k < ROWS; k++) {
        const double *C = body->place.C[0][k], *slope = body->place.C[1][k];
        double moved = 0.0, largest = 0.0, rate = 0.0, fastest = 0.0;
        if (gives_way[k] || pushes[k]) continue;
        for (n = 0; n < MODES; n++) {
            const double along = u[PATH_RATE] * slope[n] * z[n];
            moved += C[n] * z[n];
            largest += fabs(C[n] * z[n]);
            rate += C[n] * v[n] + along;
            fastest += fabs(C[n] * v[n]) + fabs(along);
        }
        if (!(fabs(moved) <= VIOLATED * largest)) return fail(body, "start as given: the states move a rigid row");
        if (!(fabs(rate) <= VIOLATED_RATE * fastest))
            return fail(body, "start as given: the states' rates move a rigid row, or do not follow it along the path");
    }
    return 0;
}

int body_start(Body *body)
{
    Memory *memory = &body->memory;
    double *u = memory->variables, *z = u + STATES, *v = z + MODES, x[ROWS] = {0.0};
    int k;
    if (!(u[INTERNAL_STEP] > 0.0)) return fail(body, "internal_step: more than 0 s is allowed");
    if (!(u[RHO_INF] >= 0.0 && u[RHO_INF] <= 1.0)) return fail(body, "rho_inf: 0 to 1 is allowed");
    for (k = 0; k < 2 * MODES; k++)
        if (u[START] != 2.0 && memory->given[k] != 0.0) return fail(body, "modes were set, which start = 2 alone takes");
    if (place(body, 1)) return 1;
    memset(z, 0, 2 * MODES * sizeof(double));
    if (u[START] == 2.0 && take_given(body)) return 1;
    if (u[START] == 1.0) {
        if (find_equilibrium(body)) return 1;
        add(body->place.C[1][0], MODES, z, u[PATH_RATE], x); /* rigid rows that move take the body along */
        if (solve_rigid(body, x)) return 1;
        subtract_rows(body->place.C[0][0], x, v);
    }
    memset(memory->rigid, 0, sizeof memory->rigid);
    if (find_multipliers(body)) return 1;
    free_forces(u + LOADS, z, v, memory->acceleration);
    subtract_rows(body->place.C[0][0], body->multipliers, memory->acceleration);
    memset(x, 0, sizeof x);
    add(body->place.C[0][0], MODES, memory->acceleration, 1.0, x);
    if (solve_rigid(body, x)) return 1;
    subtract_rows(body->place.C[0][0], x, memory->acceleration);
    for (k = 0; k < ROWS; k++) {
        memory->rigid[k] = x[k];
        memory->force[k] = memory->share[k] = pushes[k] ? body->multipliers[k] : 0.0;
    }
    memcpy(memory->alike, memory->acceleration, sizeof memory->alike);
    body_changed(body);
    return 0;
}

/* One step to the path coordinate and the loads among the variables. */
static int take_step(Body *body)
{
    const Scheme *scheme = &body->scheme;
    Memory *memory = &body->memory;
    double *u = memory->variables, *z = u + STATES, *v = z + MODES, h = scheme->step;
    double z0[MODES], v0[MODES], a0[MODES], forces[MODES], free[MODES], motion[ROWS], A[ROWS][ROWS], pulled[ROWS][MODES];
    int all[ROWS], again, k, l, n;
    if (place(body, 0)) return 1;
    for (k = 0; k < ROWS; k++) all[k] = 1;
    for (k = 0; k < ROWS; k++) over_S(scheme, body->place.C[0][k], pulled[k]);
    for (k = 0; k < ROWS; k++)
        for (l = 0; l <= k; l++) {
            double sum = 0.0;
            for (n = 0; n < MODES; n++) sum += pulled[k][n] * body->place.C[0][l][n];
            A[k][l] = A[l][k] = body->place.F[0][k][l] + scheme->dz * sum;
        }
    do {
        for (n = 0; n < MODES; n++) {
            double left = (scheme->alpha_f * memory->acceleration[n] - scheme->alpha_m * memory->alike[n]) / (1.0 - scheme->alpha_m);
            a0[n] = left;
            z0[n] = z[n] + h * v[n] + h * h * ((0.5 - scheme->beta) * memory->alike[n] + scheme->beta * left);
            v0[n] = v[n] + h * ((1.0 - scheme->gamma) * memory->alike[n] + scheme->gamma * left);
        }
        free_forces(u + LOADS, z0, v0, forces);
        over_S(scheme, forces, free);
        for (n = 0; n < MODES; n++) forces[n] = z0[n] + scheme->dz * free[n];
        memset(motion, 0, sizeof motion);
        add(body->place.C[0][0], MODES, forces, 1.0, motion);
        add(body->place.H[0][0], INPUTS, u + LOADS, 1.0, motion);
        if (settle(body, A, motion, all, body->multipliers)) return 1;
        again = let_go(body, all);
    } while (again);
    subtract_rows(pulled[0], body->multipliers, free);
    for (n = 0; n < MODES; n++) {
        memory->acceleration[n] = free[n];
        memory->alike[n] = a0[n] + scheme->gain * free[n];
        z[n] = z0[n] + scheme->dz * free[n];
        v[n] = v0[n] + scheme->dv * free[n];
    }
    for (k = 0; k < ROWS; k++) memory->rigid[k] = gives_way[k] ? 0.0 : body->multipliers[k];
    remember(body);
    return 0;
}

int body_advance(Body *body, double duration)
{
    double *u = body->memory.variables, t = u[TIME], before[1 + INPUTS];
    double count = ceil(duration / u[INTERNAL_STEP] * (1.0 - 1e-9)), step;
    int k, l;
    if (!(duration >= 0.0)) return fail(body, "a communication step of 0 s or more is allowed");
    if (duration == 0.0) return 0;
    if (!(count < 1e9)) return fail(body, "a communication step of less than 1e9 internal steps is allowed");
    step = duration / count;
    if (fabs(step - u[INTERNAL_STEP]) <= 1e-9 * u[INTERNAL_STEP]) step = u[INTERNAL_STEP]; /* round-off of the times */
    if (set_scheme(body, step, u[RHO_INF])) return 1;
    memcpy(before, u + PATH, sizeof(double));
    memcpy(before + 1, u + LOADS, INPUTS * sizeof(double));
    for (k = 1; k <= (int)count; k++) {
        u[PATH] = before[0] + k * step * u[PATH_RATE];
        for (l = 0; l < INPUTS; l++) u[LOADS + l] = before[1 + l] + k * step * u[LOAD_RATES + l];
        u[TIME] = t + k * step;
        body_changed(body);
        if (take_step(body)) return 1;
    }
    for (k = 0; k < MODES; k++)
        if (!isfinite(u[STATES + k])) return fail(body, "the state is not finite: loads may have been none");
    return 0;
}
