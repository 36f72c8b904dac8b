#include "contact.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include "dense.h"
#include "rows.h"

/* Times that all wrong rows may change sides without leaving fewer wrong ones; solves after which it is given up. */
#define CHANCES 3
#define LIMIT 1000
/* What of a pull or of a negative gap is round-off. */
#define ROUND_OFF 1e-12

int solve_closed(Body *body, double A[ROWS][ROWS], const int *among, double *motion_to_multipliers)
{
    int numbers[ROWS], count = 0, k, l;
    double factor[ROWS][ROWS], entries[ROWS];
    for (k = 0; k < ROWS; k++) {
        if (!among[k] || body->memory.closed[k] == 0.0) continue;
        numbers[count] = k;
        for (l = 0; l <= count; l++) entries[l] = A[k][numbers[l]];
        if (factorise_row(count, ROWS, entries, factor[0])) {
            char where[100 * PATHS];
            say_where(body, where, sizeof where);
            snprintf(body->message, sizeof body->message, "at %s the row %s depends on others, or nothing holds it", where,
                     row_names[k]);
            return 1;
        }
        count++;
    }
    for (l = 0; l < count; l++) entries[l] = motion_to_multipliers[numbers[l]];
    if (count) substitute(count, ROWS, factor[0], entries);
    for (k = 0; k < ROWS; k++)
        if (among[k]) motion_to_multipliers[k] = 0.0;
    for (l = 0; l < count; l++) motion_to_multipliers[numbers[l]] = entries[l];
    return 0;
}

static int mark_wrong(Body *body, double A[ROWS][ROWS], const double *excess, const int *among,
                      const double *multipliers, int *wrong)
{
    int k, l, found = 0;
    double largest = 0.0;
    for (k = 0; k < ROWS; k++)
        if (among[k]) largest = fmax(largest, fabs(multipliers[k]));
    for (k = 0; k < ROWS; k++) {
        wrong[k] = 0;
        if (!among[k] || !pushes[k]) continue;
        if (body->memory.closed[k] != 0.0) {
            wrong[k] = multipliers[k] < -ROUND_OFF * largest;
        } else {
            double gap = -excess[k], size = fabs(gap);
            for (l = 0; l < ROWS; l++) {
                double part = among[l] ? A[k][l] * multipliers[l] : 0.0;
                gap += part;
                size += fabs(part);
            }
            wrong[k] = gap < -ROUND_OFF * size;
        }
        found += wrong[k];
    }
    return found;
}

int settle(Body *body, double A[ROWS][ROWS], const double *motion, const int *among, double *multipliers)
{
    double excess[ROWS];
    char where[100 * PATHS];
    int wrong[ROWS], fewest = ROWS + 1, chances = CHANCES, tried, k;
    for (k = 0; k < ROWS; k++) excess[k] = motion[k] - clearance[k];
    for (tried = 0; tried < LIMIT; tried++) {
        int count, changes;
        for (k = 0; k < ROWS; k++)
            if (among[k]) multipliers[k] = excess[k];
        if (solve_closed(body, A, among, multipliers)) return 1;
        count = mark_wrong(body, A, excess, among, multipliers, wrong);
        if (count == 0) return 0;
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
    say_where(body, where, sizeof where);
    snprintf(body->message, sizeof body->message, "at %s it was not settled which pads are closed", where);
    return 1;
}

int let_go(Body *body, const int *among)
{
    Memory *memory = &body->memory;
    int k, n, found = 0;
    for (k = 0; k < ROWS; k++) {
        if (!among[k] || memory->closed[k] != 0.0 || (memory->force[k] == 0.0 && memory->share[k] == 0.0)) continue;
        for (n = 0; n < MODES; n++) {
            if (quasi_static[n]) continue;
            memory->acceleration[n] += body->place.rows.C[k][n] * memory->force[k];
            memory->alike[n] += body->place.rows.C[k][n] * memory->share[k];
        }
        memory->force[k] = memory->share[k] = 0.0;
        found = 1;
    }
    return found;
}

void remember(Body *body)
{
    const Scheme *scheme = body->scheme;
    Memory *memory = &body->memory;
    int k;
    for (k = 0; k < ROWS; k++)
        if (pushes[k]) {
            double left = (scheme->alpha_f * memory->force[k] - scheme->alpha_m * memory->share[k]) / (1.0 - scheme->alpha_m);
            memory->share[k] = scheme->gain * body->multipliers[k] + left;
            memory->force[k] = body->multipliers[k];
        }
}
