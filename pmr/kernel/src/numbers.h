/* Numbers with how they change along a seed, frames that turn by angles with their rates, and the cylinder that raises a
   boom: what frame.c, ground.c and cylinder.c share. */
#ifndef PMR_NUMBERS_H
#define PMR_NUMBERS_H

#include <math.h>

#include "pmr_kernel.h"

typedef struct {
    double at, along;
} number;

static inline number constant(double at) { return (number){at, 0.0}; }
static inline number plus(number a, number b) { return (number){a.at + b.at, a.along + b.along}; }
static inline number minus(number a, number b) { return (number){a.at - b.at, a.along - b.along}; }
static inline number times(number a, number b) { return (number){a.at * b.at, a.along * b.at + a.at * b.along}; }
static inline number negative(number a) { return (number){-a.at, -a.along}; }
static inline number sine(number a) { return (number){sin(a.at), cos(a.at) * a.along}; }
static inline number cosine(number a) { return (number){cos(a.at), -sin(a.at) * a.along}; }
static inline number inverse(number a) { return (number){1.0 / a.at, -a.along / (a.at * a.at)}; }

/* An angle with its rate and second rate. */
typedef struct {
    number at, rate, second;
} angle;

/* R, omega and alpha of one frame in another. */
typedef struct {
    number R[3][3], velocity[3], acceleration[3];
} turning;

static const turning UNTURNED = {.R = {{{1.0, 0.0}}, {{0.0, 0.0}, {1.0, 0.0}}, {{0.0, 0.0}, {0.0, 0.0}, {1.0, 0.0}}}};

/* Turned by an angle about axis k. */
static inline turning about(int k, angle by)
{
    const number c = cosine(by.at), s = sine(by.at);
    const int i = (k + 1) % 3, j = (k + 2) % 3;
    turning turned = {0};
    turned.R[k][k].at = 1.0;
    turned.R[i][i] = turned.R[j][j] = c;
    turned.R[i][j] = negative(s);
    turned.R[j][i] = s;
    turned.velocity[k] = by.rate;
    turned.acceleration[k] = by.second;
    return turned;
}

/* Turned as `on`, within a frame that is turned as `base`. */
static inline turning turn_on(const turning *base, const turning *on)
{
    turning turned = {0};
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (k = 0; k < 3; k++) {
            for (j = 0; j < 3; j++) turned.R[i][k] = plus(turned.R[i][k], times(base->R[i][j], on->R[j][k]));
            turned.velocity[k] = plus(turned.velocity[k], times(on->R[i][k], base->velocity[i]));
            turned.acceleration[k] = plus(turned.acceleration[k], times(on->R[i][k], base->acceleration[i]));
        }
    for (k = 0; k < 3; k++) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        const number crossed =
            minus(times(turned.velocity[a], on->velocity[b]), times(turned.velocity[b], on->velocity[a]));
        turned.acceleration[k] = plus(plus(turned.acceleration[k], crossed), on->acceleration[k]);
    }
    for (k = 0; k < 3; k++) turned.velocity[k] = plus(turned.velocity[k], on->velocity[k]);
    return turned;
}

/* A base that rolls, pitches and yaws by `by`, R_Z R_Y R_X. */
static inline turning rock_by(const angle by[3])
{
    const turning roll = about(0, by[0]), pitch = about(1, by[1]), yaw = about(2, by[2]), bent = turn_on(&yaw, &pitch);
    return turn_on(&bent, &roll);
}

static const double GRADIENT_SIGN[3][3] = {{0.0, -1.0, 1.0}, {1.0, 0.0, -1.0}, {-1.0, 1.0, 0.0}};

/* Entry i, j of alpha x . + omega x (omega x .). */
static inline number gradient(const turning *turned, int i, int j)
{
    const number *w = turned->velocity;
    number entry = times(w[i], w[j]);
    int k;
    if (i != j) return plus(entry, times(constant(GRADIENT_SIGN[i][j]), turned->acceleration[3 - i - j]));
    for (k = 0; k < 3; k++) entry = minus(entry, times(w[k], w[k]));
    return entry;
}

/* Cylinder from foot to lug, x and z of each, of a boom that is raised by phi: its length, its direction along x and z of
   the boom, and returned, by how much it grows for each radian. */
static inline number cylinder_line(const double *foot, const double *lug, number phi, number *length, number direction[2])
{
    const number s = sine(phi), co = cosine(phi);
    const number at[2] = {minus(times(constant(lug[0]), co), times(constant(lug[1]), s)),
                          plus(times(constant(lug[0]), s), times(constant(lug[1]), co))};
    const number x = minus(at[0], constant(foot[0])), z = minus(at[1], constant(foot[1]));
    const number square = plus(times(x, x), times(z, z));
    *length = (number){sqrt(square.at), 0.5 * square.along / sqrt(square.at)};
    direction[0] = times(inverse(*length), plus(times(x, co), times(z, s)));
    direction[1] = times(inverse(*length), minus(times(z, co), times(x, s)));
    return times(minus(times(z, at[0]), times(x, at[1])), inverse(*length));
}

/* Columns (6 + n + e + 1) of `pmr_stand_columns` and, unless NULL, how they change. */
int pmr_stand_along(const pmr_stand *stand, const number wrench[6], double *columns, double *along);
/* Weight and inertia of m masses of a machine (m, 8), as `pmr_masses_wrench` takes them, added to the wrench (6,); `rocking`
   is NULL where nothing rocks. */
void pmr_add_masses(int32_t m, const double *masses, angle slewing, const angle *rocking, const number falling[3],
                    number wrench[6]);

#endif
