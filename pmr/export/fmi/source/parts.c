/* A communication step, each step of it in 1, 2, 4 ... equal parts: as few as keep the forces of contacts that only push to a
   tolerance, as a run makes them (pmr/simulation/native/levels.py has the derivation). */
#include "body.h"

#include <math.h>
#include <string.h>

#include "contact.h"
#include "drive.h"
#include "rows.h"

/* Where a step misses less than this share of what it may, the next one is made in half as many parts. */
#define SPARE 0.125

/* How often a step may be halved. */
static int most_halvings(double step)
{
    int needed = (int)fmin(fmax(ceil(step * CONTACT_OMEGA / RESOLVED - 1e-9), 1.0), MOST_PARTS), found = 0;
    while ((1 << found) < needed) found++;
    return found;
}

/* Accelerations of the modes in the present state, with the multipliers of the step before. */
static int accelerate(Body *body, double *a)
{
    const double *u = body->memory.variables;
    int n;
    if (place(body)) return 1;
    find_drive(body, VALUES, NULL);
    free_forces(body->drive.f, u + STATES, u + STATES + MODES, a);
    subtract_rows(body->place.rows.C[0], body->memory.multipliers, a);
#if TERMS
    {
        double pushed[PUSHED] = {0.0};
        subtract_terms(body->drive.T, u + STATES, pushed);
        for (n = 0; n < MODES; n++) a[n] += pushed[n];
    }
#endif
    for (n = 0; n < MODES; n++)
        if (quasi_static[n]) a[n] = 0.0;
    return 0;
}

/* Begin with parts of another length where the last step ended. */
static int begin(Body *body)
{
    Memory *memory = &body->memory;
    int k;
    if (accelerate(body, memory->accelerated)) return 1;
    memcpy(memory->acceleration, memory->accelerated, sizeof memory->acceleration);
    memcpy(memory->alike, memory->accelerated, sizeof memory->alike);
    for (k = 0; k < ROWS; k++) memory->force[k] = memory->share[k] = pushes[k] ? memory->multipliers[k] : 0.0;
    return 0;
}

/* What a part misses of the closed contacts' forces at most, over what it may miss; before it they had other forces. */
static int missed(Body *body, const double *closed, const double *multipliers, double *found)
{
    Memory *memory = &body->memory;
    double h = body->scheme->step, e[MODES], entries[ROWS], most = 0.0;
    int all[ROWS], k, n;
    for (n = 0; n < MODES; n++) e[n] = (memory->acceleration[n] - memory->accelerated[n]) * (h * h / 12.0);
    for (k = 0; k < ROWS; k++) {
        double impulse = (memory->multipliers[k] - multipliers[k]) * (5.0 * h * h / 12.0);
        all[k] = k < CONTACTS;
        memory->largest_force = fmax(memory->largest_force, memory->multipliers[k]);
        if (memory->closed[k] == closed[k]) continue;
        for (n = 0; n < MODES; n++) e[n] -= body->place.rows.C[k][n] * impulse;
    }
    for (k = 0; k < ROWS; k++) {
        entries[k] = 0.0;
        for (n = 0; n < MODES; n++) entries[k] += body->place.rows.C[k][n] * e[n];
    }
    if (solve_closed(body, body->A, all, entries)) return 1;
    for (k = 0; k < ROWS; k++) most = fmax(most, fabs(entries[k]));
    memcpy(memory->accelerated, memory->acceleration, sizeof memory->accelerated);
    *found = most > 0.0 ? most / (FORCE_TOLERANCE * memory->largest_force * fmin(1.0, h * CONTACT_OMEGA)) : 0.0;
    return 0;
}

/* The parts of a step, and what one of them misses at most, where it is `judged`. */
static int take_parts(Body *body, const double *given, double time, double step, int count, int judged, double *most)
{
    double closed[ROWS], multipliers[ROWS], own;
    int part;
    *most = 0.0;
    for (part = 1; part <= count; part++) {
        memcpy(closed, body->memory.closed, sizeof closed);
        memcpy(multipliers, body->memory.multipliers, sizeof multipliers);
        drive_on(body->memory.variables, given, time + step * part / count);
        body_changed(body);
        if (take_step(body)) return 1;
        if (!judged) continue;
        if (missed(body, closed, multipliers, &own)) return 1;
        *most = fmax(*most, own);
    }
    return 0;
}

/* A step with inputs `given` (4 DRIVERS,) at the beginning of the communication, `time` after it. */
static int step_in_parts(Body *body, const double *given, double time, double step)
{
    Memory *memory = &body->memory, began;
    int last = most_halvings(step), level = memory->level < last ? memory->level : last;
    double most;
    if (last) began = *memory;
    for (;;) {
        double length = step / (1 << level);
        if (set_scheme(body, length, memory->variables[RHO_INF])) return 1;
        if (last && fabs(length - memory->length) > 1e-9 * length) { /* after a step that was taken back it is the old one */
            drive_on(memory->variables, given, time);
            body_changed(body);
            if (begin(body)) return 1;
        }
        if (take_parts(body, given, time, step, 1 << level, last > 0, &most)) return 1;
        memory->length = length;
        if (!last || most <= 1.0 || level == last) break;
        *memory = began;
        body_changed(body);
        while (most > 1.0 && level < last) { /* half the length misses an eighth and may miss a half */
            level++;
            most /= 4.0;
        }
    }
    memory->level = most < SPARE && level > 0 ? level - 1 : level;
    return 0;
}

int body_advance(Body *body, double duration)
{
    double *u = body->memory.variables, t = u[TIME], given[4 * DRIVERS];
    double count = ceil(duration / u[INTERNAL_STEP] * (1.0 - 1e-9)), step;
    int k;
    if (!(duration >= 0.0)) return fail(body, "a communication step of 0 s or more is allowed");
    if (duration == 0.0) return 0;
    if (!(count < 1e9)) return fail(body, "a communication step of less than 1e9 internal steps is allowed");
    check_inputs(body);
    step = duration / count;
    if (fabs(step - u[INTERNAL_STEP]) <= 1e-9 * u[INTERNAL_STEP]) step = u[INTERNAL_STEP]; /* round-off of the times */
    memcpy(given, u + DRIVEN, sizeof given);
    for (k = 1; k <= (int)count; k++) {
        if (step_in_parts(body, given, (k - 1) * step, step)) return 1;
        u[TIME] = t + k * step;
    }
    for (k = 0; k < MODES; k++)
        if (!isfinite(u[STATES + k])) return fail(body, "the state is not finite: loads may have been none");
    return 0;
}
