#include "body.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "contact.h"
#include "dense.h"
#include "rows.h"

/* Share of its terms by which given states may move a rigid row. */
#define VIOLATED 1e-6
/* The same of given rates: a step of index 3 leaves O(h^2) of them, some 1e-4 in fast motions. */
#define VIOLATED_RATE 1e-2
/* Of a static start: sets of closed rows that it tries; times that all wrong rows may change sides without leaving fewer
   wrong ones; share of the lowest omega^2 that holds what open rows leave free, and what it may change; what of a pull or of
   an overlap is round-off. */
#define STATIC_TRIES 1000
#define CHANCES 3
#define ALMOST_FREE 1e-8
#define UNCHANGED 1e-3
#define BALANCED 1e-9
enum { HELD = MODES + ROWS };

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

/* motion += C z + H f - F multipliers; NULL: there are none. */
static void add_motion(const Rows *rows, const double *z, const double *f, const double *multipliers, double *motion)
{
    add(rows->C[0], MODES, z, 1.0, motion);
    add(rows->H[0], INPUTS, f, 1.0, motion);
    if (multipliers) add(rows->F[0], ROWS, multipliers, -1.0, motion);
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
    Rows *rows = &body->place.rows;
    double motion[ROWS] = {0.0};
    int k;
    if (place(body)) return 1;
    add_motion(rows, u + STATES, u + LOADS, NULL, motion);
    if (settle(body, rows->F, motion, gives_way, body->multipliers)) return 1;
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
    subtract_rows(body->place.rows.C[0], body->multipliers, u + DERIVATIVES + MODES);
    add_global(u + STATES, u + LOADS, u + DISPLACEMENTS);
    add_local(body, NULL, NULL, body->multipliers, -1.0, u + DISPLACEMENTS);
    memcpy(u + FORCES, body->multipliers, sizeof body->multipliers);
    body->fresh = 1;
    return 0;
}

/* Multipliers of the rows that give way, from what moves these; zero in rigid ones, which deform nothing. */
static int solve_giving(Body *body, double *motion_to_multipliers)
{
    int k;
    if (solve_closed(body, body->place.rows.F, gives_way, motion_to_multipliers)) return 1;
    for (k = 0; k < ROWS; k++)
        if (!gives_way[k]) motion_to_multipliers[k] = 0.0;
    return 0;
}

/* Rates of the multipliers that follow from the position: F lambda' = (C z + H f)' - F' lambda. */
int body_velocities(Body *body)
{
    double *u = body->memory.variables, *rates = body->rates;
    const double *ds = u + PATH_RATE, *multipliers = body->multipliers;
    Rows moving;
    if (body->moving) return 0;
    if (body_evaluate(body)) return 1;
    change(body, ds, NULL, &moving);
    memset(body->rates, 0, sizeof body->rates);
    add_motion(&body->place.rows, u + STATES + MODES, u + LOAD_RATES, NULL, rates);
    add_motion(&moving, u + STATES, u + LOADS, multipliers, rates);
    if (solve_giving(body, rates)) return 1;
    add_global(u + STATES + MODES, u + LOAD_RATES, u + VELOCITIES);
    add_local(body, NULL, NULL, rates, -1.0, u + VELOCITIES);
    add_local(body, ds, NULL, multipliers, -1.0, u + VELOCITIES);
    body->moving = 1;
    return 0;
}

/* The two above, differentiated along a direction of states and inputs. */
int body_differentiate(Body *body, const double *seed, double *answer)
{
    const double *u = body->memory.variables, *z = u + STATES, *v = z + MODES, *f = u + LOADS, *df = u + LOAD_RATES;
    const double *of_z = seed + STATES, *of_v = of_z + MODES, *of_f = seed + LOADS, *of_df = seed + LOAD_RATES;
    const double *ds = u + PATH_RATE, *of_s = seed + PATH, *of_ds = seed + PATH_RATE, *multipliers = body->multipliers;
    double forces[ROWS] = {0.0}, rates[ROWS] = {0.0};
    const Rows *rows = &body->place.rows;
    Rows moving, by_s, by_rate, by_both;
    if (body_velocities(body)) return 1;
    change(body, ds, NULL, &moving);
    change(body, of_s, NULL, &by_s);
    change(body, of_ds, NULL, &by_rate);
    change(body, ds, of_s, &by_both);
    add_motion(rows, of_z, of_f, NULL, forces);
    add_motion(&by_s, z, f, multipliers, forces);
    if (solve_giving(body, forces)) return 1;
    add_motion(rows, of_v, of_df, NULL, rates);
    add_motion(&by_rate, z, f, multipliers, rates);
    add_motion(&moving, of_z, of_f, forces, rates);
    add_motion(&by_s, v, df, body->rates, rates);
    add_motion(&by_both, z, f, multipliers, rates);
    if (solve_giving(body, rates)) return 1;
    memcpy(answer + DERIVATIVES, of_v, MODES * sizeof(double));
    free_forces(of_f, of_z, of_v, answer + DERIVATIVES + MODES);
    subtract_rows(rows->C[0], forces, answer + DERIVATIVES + MODES);
    subtract_rows(by_s.C[0], multipliers, answer + DERIVATIVES + MODES);
    add_global(of_z, of_f, answer + DISPLACEMENTS);
    add_local(body, NULL, NULL, forces, -1.0, answer + DISPLACEMENTS);
    add_local(body, of_s, NULL, multipliers, -1.0, answer + DISPLACEMENTS);
    add_global(of_v, of_df, answer + VELOCITIES);
    add_local(body, NULL, NULL, rates, -1.0, answer + VELOCITIES);
    add_local(body, ds, NULL, forces, -1.0, answer + VELOCITIES);
    add_local(body, of_ds, NULL, multipliers, -1.0, answer + VELOCITIES);
    add_local(body, of_s, NULL, body->rates, -1.0, answer + VELOCITIES);
    add_local(body, ds, of_s, multipliers, -1.0, answer + VELOCITIES);
    memcpy(answer + FORCES, forces, sizeof forces);
    return 0;
}

/* [Omega^2 + floor, C^T; C, -F] (z, lambda) = (forces, clearance - H f), open rows left out, or no clearance without
   loads f: 1 if it is singular. */
static int solve_held(const Body *body, double floor, const double *forces, const double *f, double *x)
{
    const Rows *rows = &body->place.rows;
    double A[HELD * HELD] = {0.0};
    int k, l, n;
    for (n = 0; n < MODES; n++) {
        A[n * HELD + n] = omega2[n] + floor;
        x[n] = forces[n];
    }
    for (k = 0; k < ROWS; k++) {
        double *row = A + (MODES + k) * HELD;
        x[MODES + k] = 0.0;
        if (body->memory.closed[k] == 0.0) {
            row[MODES + k] = 1.0;
            continue;
        }
        for (n = 0; n < MODES; n++) row[n] = A[n * HELD + MODES + k] = rows->C[k][n];
        for (l = 0; l < ROWS; l++) row[MODES + l] = gives_way[k] ? -rows->F[k][l] : 0.0;
        if (!f) continue;
        x[MODES + k] = clearance[k];
        for (l = 0; l < INPUTS; l++) x[MODES + k] -= rows->H[k][l] * f[l];
    }
    return solve_dense(HELD, A, x);
}

/* Rows that pull although they only push, or would have to push although they are open: their number, each marked. */
static int mark_unbalanced(const Body *body, const double *x, int *wrong)
{
    const Rows *rows = &body->place.rows;
    const double *multipliers = x + MODES;
    double motion[ROWS] = {0.0}, largest = 0.0;
    int found = 0, k, n;
    for (k = 0; k < ROWS; k++) largest = fmax(largest, fabs(multipliers[k]));
    add_motion(rows, x, body->memory.variables + LOADS, multipliers, motion);
    for (k = 0; k < ROWS; k++) {
        double size = clearance[k];
        for (n = 0; n < MODES; n++) size += fabs(rows->C[k][n] * x[n]);
        wrong[k] = pushes[k] && (body->memory.closed[k] != 0.0 ? multipliers[k] < -BALANCED * largest
                                                                 : motion[k] - clearance[k] > BALANCED * size);
        found += wrong[k];
    }
    return found;
}

/* Equilibrium under the loads.  What open rows leave free for the moment is held by a share of the lowest omega^2, of which
   the last solve has none. */
static int find_equilibrium(Body *body)
{
    double *u = body->memory.variables, forces[MODES], x[HELD], held[HELD], floor, product = 0.0, square = 0.0;
    double largest = 0.0, off = 0.0;
    const double zero[MODES] = {0.0};
    int wrong[ROWS], fewest = ROWS + 1, chances = CHANCES, tries, k, n;
    for (k = 0; k < ROWS; k++) body->memory.closed[k] = 1.0;
    for (n = 0; n < MODES; n++) forces[n] = 1.0;
    if (solve_held(body, 0.0, forces, NULL, x)) return fail(body, "no static start: nothing holds the body");
    for (n = 0; n < MODES; n++) {
        product += x[n];
        square += x[n] * x[n];
    }
    floor = ALMOST_FREE * fabs(product / square);
    free_forces(u + LOADS, zero, zero, forces);
    for (tries = 0; tries < STATIC_TRIES; tries++) {
        int count, changes;
        if (solve_held(body, floor, forces, u + LOADS, held)) return fail(body, "no static start: rows depend on each other");
        count = mark_unbalanced(body, held, wrong);
        if (!count) break;
        if (count < fewest) {
            fewest = count;
            chances = CHANCES;
        } else {
            chances--;
        }
        changes = chances >= 0 ? count : 1;
        for (k = 0; k < ROWS; k++)
            if (wrong[k] && changes-- > 0) body->memory.closed[k] = 1.0 - body->memory.closed[k];
    }
    if (tries == STATIC_TRIES) return fail(body, "no static start: which pads are closed was not settled");
    if (solve_held(body, 0.0, forces, u + LOADS, x)) return fail(body, "no static start: nothing holds the body");
    for (n = 0; n < MODES; n++) {
        largest = fmax(largest, fabs(x[n]));
        off = fmax(off, fabs(x[n] - held[n]));
    }
    if (!(off <= UNCHANGED * largest) || mark_unbalanced(body, x, wrong))
        return fail(body, "no static start: nothing holds the body against the loads");
    memcpy(u + STATES, x, MODES * sizeof(double));
    return 0;
}

/* Rows that are rigid: A x = b with A = C C^T there, x in place of b and zero at the others. */
static int solve_rigid(Body *body, double *x)
{
    const Rows *rows = &body->place.rows;
    double A[ROWS * ROWS];
    int k, l, n;
    for (k = 0; k < ROWS; k++) {
        if (gives_way[k]) x[k] = 0.0;
        for (l = 0; l < ROWS; l++) {
            A[k * ROWS + l] = k == l && gives_way[k];
            if (gives_way[k] || gives_way[l]) continue;
            for (n = 0; n < MODES; n++) A[k * ROWS + l] += rows->C[k][n] * rows->C[l][n];
        }
    }
    return solve_dense(ROWS, A, x) ? fail(body, "rigid rows depend on each other at the start") : 0;
}

/* States that were set are the start, where no rigid row speaks against position or rates: C z = 0, C v + s' C' z = 0. */
static int take_given(Body *body)
{
    double *u = body->memory.variables, *z = u + STATES, *v = z + MODES;
    Rows moving;
    int k, n;
    change(body, u + PATH_RATE, NULL, &moving);
    memcpy(z, body->memory.given, sizeof body->memory.given);
    for (k = 0; k < ROWS; k++) {
        const double *C = body->place.rows.C[k], *turned = moving.C[k];
        double moved = 0.0, largest = 0.0, rate = 0.0, fastest = 0.0;
        if (gives_way[k] || pushes[k]) continue;
        for (n = 0; n < MODES; n++) {
            const double along = turned[n] * z[n];
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
    const Rows *rows = &body->place.rows;
    double *u = memory->variables, *z = u + STATES, *v = z + MODES, x[ROWS] = {0.0};
    Rows moving;
    int k;
    if (!(u[INTERNAL_STEP] > 0.0)) return fail(body, "internal_step: more than 0 s is allowed");
    if (!(u[RHO_INF] >= 0.0 && u[RHO_INF] <= 1.0)) return fail(body, "rho_inf: 0 to 1 is allowed");
    for (k = 0; k < 2 * MODES; k++)
        if (u[START] != 2.0 && memory->given[k] != 0.0) return fail(body, "modes were set, which start = 2 alone takes");
    if (place(body)) return 1;
    memset(z, 0, 2 * MODES * sizeof(double));
    if (u[START] == 2.0 && take_given(body)) return 1;
    if (u[START] == 1.0) {
        if (find_equilibrium(body)) return 1;
        change(body, u + PATH_RATE, NULL, &moving);
        add(moving.C[0], MODES, z, 1.0, x); /* rigid rows that move take the body along */
        if (solve_rigid(body, x)) return 1;
        subtract_rows(rows->C[0], x, v);
    }
    memset(memory->rigid, 0, sizeof memory->rigid);
    if (find_multipliers(body)) return 1;
    free_forces(u + LOADS, z, v, memory->acceleration);
    subtract_rows(rows->C[0], body->multipliers, memory->acceleration);
    memset(x, 0, sizeof x);
    add(rows->C[0], MODES, memory->acceleration, 1.0, x);
    if (solve_rigid(body, x)) return 1;
    subtract_rows(rows->C[0], x, memory->acceleration);
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
    const Rows *rows = &body->place.rows;
    Memory *memory = &body->memory;
    double *u = memory->variables, *z = u + STATES, *v = z + MODES, h = scheme->step;
    double z0[MODES], v0[MODES], a0[MODES], forces[MODES], free[MODES], motion[ROWS], A[ROWS][ROWS], pulled[ROWS][MODES];
    int all[ROWS], again, k, l, n;
    if (place(body)) return 1;
    for (k = 0; k < ROWS; k++) all[k] = 1;
    for (k = 0; k < ROWS; k++) over_S(scheme, rows->C[k], pulled[k]);
    for (k = 0; k < ROWS; k++)
        for (l = 0; l <= k; l++) {
            double sum = 0.0;
            for (n = 0; n < MODES; n++) sum += pulled[k][n] * rows->C[l][n];
            A[k][l] = A[l][k] = rows->F[k][l] + scheme->dz * sum;
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
        add_motion(rows, forces, u + LOADS, NULL, motion);
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
    double *u = body->memory.variables, t = u[TIME], before[PATHS], loads[INPUTS];
    double count = ceil(duration / u[INTERNAL_STEP] * (1.0 - 1e-9)), step;
    int k, l;
    if (!(duration >= 0.0)) return fail(body, "a communication step of 0 s or more is allowed");
    if (duration == 0.0) return 0;
    if (!(count < 1e9)) return fail(body, "a communication step of less than 1e9 internal steps is allowed");
    step = duration / count;
    if (fabs(step - u[INTERNAL_STEP]) <= 1e-9 * u[INTERNAL_STEP]) step = u[INTERNAL_STEP]; /* round-off of the times */
    if (set_scheme(body, step, u[RHO_INF])) return 1;
    memcpy(before, u + PATH, sizeof before);
    memcpy(loads, u + LOADS, sizeof loads);
    for (k = 1; k <= (int)count; k++) {
        for (l = 0; l < PATHS; l++) u[PATH + l] = before[l] + k * step * u[PATH_RATE + l];
        for (l = 0; l < INPUTS; l++) u[LOADS + l] = loads[l] + k * step * u[LOAD_RATES + l];
        u[TIME] = t + k * step;
        body_changed(body);
        if (take_step(body)) return 1;
    }
    for (k = 0; k < MODES; k++)
        if (!isfinite(u[STATES + k])) return fail(body, "the state is not finite: loads may have been none");
    return 0;
}
