#include <math.h>
#include <string.h>

#include "contact.h"
#include "dense.h"
#include "drive.h"
#include "friction.h"
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

/* [Omega^2 + T + floor, C^T; C, -F] (z, lambda) = (forces, clearance - H f), open rows left out, or no clearance without
   loads f: 1 if it is singular. */
static int solve_held(const Body *body, double floor, const double *forces, const double *f, double *x)
{
    const Rows *rows = &body->place.rows;
    double A[HELD * HELD] = {0.0};
    int k, l, n;
#if TERMS
    for (n = 0; n < MODES; n++)
        for (l = 0; l < MODES; l++) A[n * HELD + l] = body->drive.T[n][l];
#endif
    for (n = 0; n < MODES; n++) {
        A[n * HELD + n] += omega2[n] + floor;
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
    add_motion(rows, x, body->drive.f, multipliers, motion);
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
    for (k = 0; k < ROWS; k++) body->memory.closed[k] = k < CONTACTS;
    for (n = 0; n < MODES; n++) forces[n] = 1.0;
    if (solve_held(body, 0.0, forces, NULL, x)) return fail(body, "no static start: nothing holds the body");
    for (n = 0; n < MODES; n++) {
        product += x[n];
        square += x[n] * x[n];
    }
    floor = ALMOST_FREE * fabs(product / square);
    free_forces(body->drive.f, zero, zero, forces);
    for (tries = 0; tries < STATIC_TRIES; tries++) {
        int count, changes;
        if (solve_held(body, floor, forces, body->drive.f, held)) return fail(body, "no static start: rows depend on each other");
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
    if (solve_held(body, 0.0, forces, body->drive.f, x)) return fail(body, "no static start: nothing holds the body");
    for (n = 0; n < MODES; n++) {
        largest = fmax(largest, fabs(x[n]));
        off = fmax(off, fabs(x[n] - held[n]));
    }
    if (!(off <= UNCHANGED * largest) || mark_unbalanced(body, x, wrong))
        return fail(body, "no static start: nothing holds the body against the loads");
    memcpy(u + STATES, x, MODES * sizeof(double));
    return 0;
}

static int is_rigid(int k) { return k < CONTACTS && !gives_way[k]; }

/* Rows that are rigid: A x = b with A = C C^T there, x in place of b and zero at the others. */
static int solve_rigid(Body *body, double *x)
{
    const Rows *rows = &body->place.rows;
    double A[ROWS * ROWS];
    int k, l, n;
    for (k = 0; k < ROWS; k++) {
        if (!is_rigid(k)) x[k] = 0.0;
        for (l = 0; l < ROWS; l++) {
            A[k * ROWS + l] = k == l && !is_rigid(k);
            if (!is_rigid(k) || !is_rigid(l)) continue;
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
        if (!is_rigid(k) || pushes[k]) continue;
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

/* Forces of terms in the present state, as if they had been so in the steps before; added to others. */
static void push(Body *body, double *forces)
{
    Memory *memory = &body->memory;
    int k;
    memset(memory->pushed, 0, sizeof memory->pushed);
    memory->largest = 0.0;
#if TERMS
    {
        double pushed[PUSHED] = {0.0};
        subtract_terms(body->drive.T, memory->variables + STATES, pushed);
        for (k = 0; k < 4; k++) memcpy(memory->pushed[k], pushed, sizeof memory->pushed[k]);
    }
#endif
    for (k = 0; k < MODES; k++) forces[k] += memory->pushed[0][k];
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
    body->drive.known = 0;
    find_drive(body, VALUES, NULL);
    memset(z, 0, 2 * MODES * sizeof(double));
    if (u[START] == 2.0 && take_given(body)) return 1;
    if (u[START] == 1.0) {
        if (find_equilibrium(body)) return 1;
        change(body, u + PATH_RATE, NULL, &moving);
        add(moving.C[0], MODES, z, 1.0, x); /* rigid rows that move take the body along */
        if (solve_rigid(body, x)) return 1;
        subtract_rows(rows->C[0], x, v);
    }
    memset(memory->multipliers, 0, sizeof memory->multipliers);
    memset(memory->friction, 0, sizeof memory->friction);
    memory->largest_friction = 0.0;
    if (find_multipliers(body)) return 1;
    free_forces(body->drive.f, z, v, memory->acceleration);
    push(body, memory->acceleration);
    subtract_rows(rows->C[0], body->multipliers, memory->acceleration);
    memset(x, 0, sizeof x);
    add(rows->C[0], MODES, memory->acceleration, 1.0, x);
    if (solve_rigid(body, x)) return 1;
    subtract_rows(rows->C[0], x, memory->acceleration);
    for (k = 0; k < MODES; k++)
        if (quasi_static[k]) memory->acceleration[k] = 0.0;
    for (k = 0; k < ROWS; k++) {
        memory->multipliers[k] = gives_way[k] ? body->multipliers[k] : x[k];
        memory->force[k] = memory->share[k] = pushes[k] ? body->multipliers[k] : 0.0;
    }
    memcpy(memory->alike, memory->acceleration, sizeof memory->alike);
    take_friction(body);
    memcpy(body->multipliers, memory->multipliers, sizeof body->multipliers);
    remember_friction(body);
    body_changed(body);
    return 0;
}
