/* A machine on outriggers that only push on rigid ground: forces of the outriggers from the force F and the moment M about
   the pivot by which boom and machine press on the ground, along axes of the machine, and margins against tipping.

       N_i = k_i w_i,  w_i >= 0    or    N_i = 0,  w_i <= 0,      w = G u,   G^T N = (-F_z, M'_y, -M'_x)

   with rows (1, x, y) of G, rigid motions u of the machine and the moment M' about the point of the ground below the pivot.
   With k^(1/2) G = Q R and pulls k^(1/2) z that lifted outriggers would have, this is the complementarity problem

       (1 - Q Q^T) z = b + v,    z >= 0,  v >= 0,  z v = 0

   with forces k^(1/2) v, and -k^(1/2) b those of outriggers that also pull.  The margin over an edge is minus the moment
   about it; the use of the polygon is 1 less the smallest margin over that of the same vertical force in its centre.
   Beyond an edge nothing holds the machine; the forces hold the vertical one at the nearest point of the polygon then. */
#include "internal.h"

#include <string.h>

#include "numbers.h"

/* Added to the diagonal of the problem, which decides which outriggers lift off, but not their forces. */
#define REGULAR 1e-10
/* Share of the way to the centre by which a resultant beyond an edge is held inside of it. */
#define INSIDE 1e-9
/* A vertical force below this share of all forces does not say where the resultant is. */
#define NO_LOAD 1e-9
/* A column of which no more than this share is left beside those before it depends on them. */
#define DEPENDENT 1e-10
/* Share of its size by which a wrench is changed for derivatives. */
#define CHANGE 1e-6

enum { MOST = PMR_MOST_OUTRIGGERS, WORK = 4 * MOST + MOST * MOST };

/* Q R of k^(1/2) (1, x, y) of the outriggers that are not lifted; columns that depend on those before are left out. */
typedef struct {
    double root[MOST], Q[3][MOST], R[3][3];
    int used[3];
} sharing;

static void share_out(const pmr_stand *s, const int32_t *lifted, sharing *to)
{
    double stiffest = 0.0;
    int c, p, i, pass;
    for (i = 0; i < s->outriggers; i++) stiffest = fmax(stiffest, s->stiffness[i]);
    for (i = 0; i < s->outriggers; i++) to->root[i] = lifted[i] ? 0.0 : sqrt(s->stiffness[i] / stiffest);
    for (c = 0; c < 3; c++) {
        double *q = to->Q[c], before = 0.0, size = 0.0;
        for (i = 0; i < s->outriggers; i++) {
            q[i] = to->root[i] * (c ? s->places[2 * i + c - 1] : 1.0);
            before += q[i] * q[i];
        }
        for (p = 0; p < c; p++) to->R[p][c] = 0.0;
        for (pass = 0; pass < 2; pass++)
            for (p = 0; p < c; p++) {
                double along = 0.0;
                for (i = 0; to->used[p] && i < s->outriggers; i++) along += to->Q[p][i] * q[i];
                for (i = 0; i < s->outriggers; i++) q[i] -= along * to->Q[p][i];
                to->R[p][c] += along;
            }
        for (i = 0; i < s->outriggers; i++) size += q[i] * q[i];
        to->used[c] = size > DEPENDENT * DEPENDENT * before;
        to->R[c][c] = sqrt(size);
        for (i = 0; i < s->outriggers; i++) q[i] = to->used[c] ? q[i] / to->R[c][c] : 0.0;
    }
}

/* Forces of outriggers that also pull. */
static void carry(const pmr_stand *s, const sharing *of, const double *loads, double *forces)
{
    double share[3] = {0.0, 0.0, 0.0};
    int c, p, i;
    for (c = 0; c < 3; c++) {
        if (!of->used[c]) continue;
        share[c] = loads[c];
        for (p = 0; p < c; p++) share[c] -= of->R[p][c] * share[p];
        share[c] /= of->R[c][c];
    }
    for (i = 0; i < s->outriggers; i++) {
        forces[i] = 0.0;
        for (c = 0; c < 3; c++) forces[i] += of->root[i] * of->Q[c][i] * share[c];
    }
}

static int push_on_ground(const pmr_stand *s, const double *loads, double *forces)
{
    const int n = s->outriggers;
    double A[MOST * MOST], b[MOST], pulls[MOST], work[WORK];
    int32_t lifted[MOST] = {0}, pushes[MOST];
    sharing of;
    int i, j, c, pulled = 0;
    share_out(s, lifted, &of);
    carry(s, &of, loads, forces);
    for (i = 0; i < n; i++) pulled |= forces[i] < 0.0;
    if (!pulled) return PMR_DONE;
    for (i = 0; i < n; i++) {
        b[i] = -forces[i] / of.root[i];
        pushes[i] = 1;
        for (j = 0; j < n; j++) {
            A[i * n + j] = i == j ? 1.0 + REGULAR : 0.0;
            for (c = 0; c < 3; c++) A[i * n + j] -= of.Q[c][i] * of.Q[c][j];
        }
    }
    if (pmr_contact(n, A, b, pushes, pulls, lifted, work, NULL)) return PMR_LIFTED;
    share_out(s, lifted, &of);
    carry(s, &of, loads, forces);
    return PMR_DONE;
}

int pmr_stand_forces(const pmr_stand *s, int64_t count, const double *loads, double *forces)
{
    int64_t k;
    int failed = s->outriggers > MOST ? PMR_REFUSED : PMR_DONE;
    for (k = 0; k < count && !failed; k++) failed = push_on_ground(s, loads + 3 * k, forces + s->outriggers * k);
    return failed;
}

static const double *corner(const pmr_stand *s, int k) { return s->places + 2 * s->at_corners[k % s->corners]; }

/* Minus the moment about the edge from corner k to the next one. */
static double margin(const pmr_stand *s, int k, const double *w)
{
    double moment = 0.0;
    int j;
    for (j = 0; j < 6; j++) moment += s->edges[6 * k + j] * w[j];
    return -moment;
}

/* The point of the polygon that is nearest to a place beyond it, just inside. */
static void move_inside(const pmr_stand *s, const double *center, double *place)
{
    double best = INFINITY, nearest[2] = {0.0, 0.0};
    int k;
    for (k = 0; k < s->corners; k++) {
        const double *from = corner(s, k), *to = corner(s, k + 1), x = to[0] - from[0], y = to[1] - from[1];
        const double along = ((place[0] - from[0]) * x + (place[1] - from[1]) * y) / (x * x + y * y);
        const double share = fmin(fmax(along, 0.0), 1.0), at[2] = {from[0] + share * x, from[1] + share * y};
        const double away = hypot(at[0] - place[0], at[1] - place[1]);
        if (away >= best) continue;
        best = away;
        nearest[0] = at[0], nearest[1] = at[1];
    }
    for (k = 0; k < 2; k++) place[k] = nearest[k] + INSIDE * (center[k] - nearest[k]);
}

static int find_columns(const pmr_stand *s, const double *w, double *columns)
{
    const double pressing = fmax(-w[2], 0.0), forces = fabs(w[0]) + fabs(w[1]) + fabs(w[2]);
    const double pressed = fmax(pressing, NO_LOAD * fmax(forces, 1e-191));
    double *margins = columns + 6 + s->outriggers, least = INFINITY, smallest = INFINITY, center[2] = {0.0, 0.0};
    double loads[3] = {pressing, (w[4] + s->height * w[0]) / pressed, (s->height * w[1] - w[3]) / pressed};
    int k;
    memcpy(columns, w, 6 * sizeof(double));
    for (k = 0; k < 2 * s->corners; k++) center[k % 2] += corner(s, k / 2)[k % 2] / s->corners;
    for (k = 0; k < s->corners; k++) {
        const double in_center[6] = {0.0, 0.0, -1.0, -center[1], center[0], 0.0};
        margins[k] = margin(s, k, w);
        least = fmin(least, margins[k]);
        smallest = fmin(smallest, margins[k] / (pressed * margin(s, k, in_center)));
    }
    margins[s->corners] = fabs(w[2]) < pressed ? 0.0 : 1.0 - smallest; /* nothing presses yet */
    if (least < 0.0) move_inside(s, center, loads + 1);
    for (k = 1; k < 3; k++) loads[k] *= pressing;
    for (k = 0; k < 6; k++)
        if (!isfinite(w[k])) return PMR_NOT_FINITE;
    for (k = 0; k < 3; k++)
        if (!isfinite(loads[k])) return PMR_NOT_FINITE;
    return push_on_ground(s, loads, columns + 6);
}

int pmr_stand_columns(const pmr_stand *s, int64_t count, const double *wrenches, double *columns)
{
    const int width = 7 + s->outriggers + s->corners;
    int64_t k;
    int failed = s->outriggers > MOST ? PMR_REFUSED : PMR_DONE;
    for (k = 0; k < count && !failed; k++) failed = find_columns(s, wrenches + 6 * k, columns + width * k);
    return failed;
}

/* How the columns change as the wrench changes by `w`'s seeds: central differences of a law that is linear in the wrench,
   but for the use of the polygon and where an outrigger lifts off. */
int pmr_stand_along(const pmr_stand *s, const number w[6], double *columns, double *along)
{
    const int width = 7 + s->outriggers + s->corners;
    double size = 0.0, change = 0.0, at[6], sides[2][7 + 2 * MOST];
    int side, k, failed = PMR_DONE;
    for (k = 0; k < 6; k++) {
        at[k] = w[k].at;
        size = fmax(size, fabs(w[k].at));
        change = fmax(change, fabs(w[k].along));
    }
    failed = find_columns(s, at, columns);
    if (failed || !along) return failed;
    memset(along, 0, width * sizeof(double));
    if (!(size > 0.0 && change > 0.0)) return PMR_DONE;
    for (side = 0; side < 2 && !failed; side++) {
        for (k = 0; k < 6; k++) at[k] = w[k].at + (side ? -1.0 : 1.0) * CHANGE * size / change * w[k].along;
        failed = find_columns(s, at, sides[side]);
    }
    for (k = 0; k < width && !failed; k++) along[k] = (sides[0][k] - sides[1][k]) * change / (2.0 * CHANGE * size);
    return failed;
}

/* ---- masses of the machine ---- */

void pmr_add_masses(int32_t m, const double *masses, angle slewing, const angle *rocking, const number falling[3],
                    number wrench[6])
{
    const turning standing = rocking ? rock_by(rocking) : UNTURNED, slewed = about(2, slewing),
                  turned = rocking ? turn_on(&standing, &slewed) : slewed;
    int n, i, j;
    for (n = 0; n < m; n++) {
        const double *of = masses + 8 * n, *place = of + 1, *inertia = of + 4;
        const turning *t = of[7] != 0.0 ? &turned : &standing;
        number force[3], moment[3];
        for (i = 0; i < 3; i++) {
            number field = constant(0.0);
            for (j = 0; j < 3; j++) {
                field = plus(field, times(t->R[j][i], falling[j]));
                field = plus(field, times(gradient(t, i, j), constant(place[j])));
            }
            force[i] = times(constant(-of[0]), field);
        }
        for (i = 0; i < 3; i++) {
            const int a = (i + 1) % 3, b = (i + 2) % 3; /* r x F - I alpha - omega x I omega */
            moment[i] = minus(times(constant(place[a]), force[b]), times(constant(place[b]), force[a]));
            moment[i] = minus(moment[i], times(constant(inertia[i]), t->acceleration[i]));
            moment[i] = minus(moment[i], times(constant(inertia[b] - inertia[a]), times(t->velocity[a], t->velocity[b])));
        }
        for (i = 0; i < 3; i++)
            for (j = 0; j < 3; j++) {
                const number to = of[7] != 0.0 ? slewed.R[i][j] : constant(i == j);
                wrench[i] = plus(wrench[i], times(to, force[j]));
                wrench[3 + i] = plus(wrench[3 + i], times(to, moment[j]));
            }
    }
}

void pmr_masses_wrench(int32_t m, const double *masses, int64_t count, const double *angles, const double *falling,
                       double *wrenches)
{
    int64_t k;
    int n;
    for (k = 0; k < count; k++) {
        const double *a = angles + 12 * k;
        angle by[4];
        number fall[3], wrench[6] = {{0.0, 0.0}};
        for (n = 0; n < 4; n++) by[n] = (angle){constant(a[n]), constant(a[4 + n]), constant(a[8 + n])};
        for (n = 0; n < 3; n++) fall[n] = constant(falling[3 * k + n]);
        pmr_add_masses(m, masses, by[0], by + 1, fall, wrench);
        for (n = 0; n < 6; n++) wrenches[6 * k + n] = wrench[n].at;
    }
}
