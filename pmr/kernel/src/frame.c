/* A frame that moves: loads and amplitudes of terms as sums of products of few quantities, and these from how the frame is driven.

       u_k = sum over its products of  factor x_a x_b x_c

   A quantity x is 1, an entry of the rotation R from axes of the boom into those of the ground, a component of the angular
   velocity omega or acceleration alpha in axes of the boom, an entry of the acceleration field's gradient alpha x . + omega x (omega x .),
   a motion itself, where the tail of a section is (the sum of the first paths) or its rate, or one over an extension.  R, omega and
   alpha follow from luffing and slewing and, where the base rocks, from its roll, pitch and yaw. */
#include "internal.h"

#include <math.h>
#include <string.h>

/* An angle with its rate and second rate. */
typedef struct {
    double at, rate, second;
} pmr_angle;

/* R, omega and alpha of one frame in another. */
typedef struct {
    double R[3][3], velocity[3], acceleration[3];
} pmr_turning;

static pmr_angle angle_of(const pmr_system *y, const double *motions, int number)
{
    const int32_t at = y->frame_angles[number];
    pmr_angle angle = {0.0, 0.0, 0.0};
    if (at >= 0) angle = (pmr_angle){motions[at], motions[y->motions + at], motions[2 * y->motions + at]};
    return angle;
}

/* Raised by phi, then slewed by psi: R = R_Z(psi) R_Y(-phi). */
static pmr_turning raise_and_slew(pmr_angle phi, pmr_angle psi)
{
    const double s = sin(phi.at), c = cos(phi.at), sz = sin(psi.at), cz = cos(psi.at), both = psi.rate * phi.rate;
    const pmr_turning turning = {.R = {{cz * c, -sz, -cz * s}, {sz * c, cz, -sz * s}, {s, 0.0, c}},
                                 .velocity = {psi.rate * s, -phi.rate, psi.rate * c},
                                 .acceleration = {psi.second * s + both * c, -phi.second, psi.second * c - both * s}};
    return turning;
}

static void product(double A[3][3], double B[3][3], double C[3][3])
{
    int i, j, k;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            C[i][j] = 0.0;
            for (k = 0; k < 3; k++) C[i][j] += A[i][k] * B[k][j];
        }
}

/* A base that rolls by a, pitches by b and yaws by c, R_Z(c) R_Y(b) R_X(a), in its own axes. */
static pmr_turning rock(pmr_angle a, pmr_angle b, pmr_angle c)
{
    const double sa = sin(a.at), ca = cos(a.at), sb = sin(b.at), cb = cos(b.at);
    const pmr_angle down = {-b.at, -b.rate, -b.second};
    pmr_turning turned = raise_and_slew(down, c), base;
    double roll[3][3] = {{1.0, 0.0, 0.0}, {0.0, ca, -sa}, {0.0, sa, ca}};
    product(turned.R, roll, base.R);
    base.velocity[0] = a.rate - c.rate * sb;
    base.velocity[1] = b.rate * ca + c.rate * sa * cb;
    base.velocity[2] = c.rate * ca * cb - b.rate * sa;
    base.acceleration[0] = a.second - c.second * sb - c.rate * b.rate * cb;
    base.acceleration[1] = b.second * ca - b.rate * a.rate * sa + c.second * sa * cb + c.rate * a.rate * ca * cb - c.rate * b.rate * sa * sb;
    base.acceleration[2] = c.second * ca * cb - c.rate * a.rate * sa * cb - c.rate * b.rate * ca * sb - b.second * sa - b.rate * a.rate * ca;
    return base;
}

static pmr_turning turn(const pmr_system *y, const double *motions)
{
    pmr_turning boom = raise_and_slew(angle_of(y, motions, 0), angle_of(y, motions, 1));
    pmr_turning turning = boom, base;
    double velocity[3], acceleration[3];
    int j, k;
    if (y->frame_angles[2] < 0 && y->frame_angles[3] < 0 && y->frame_angles[4] < 0) return boom;
    base = rock(angle_of(y, motions, 2), angle_of(y, motions, 3), angle_of(y, motions, 4));
    for (k = 0; k < 3; k++) {
        velocity[k] = acceleration[k] = 0.0;
        for (j = 0; j < 3; j++) {
            velocity[k] += boom.R[j][k] * base.velocity[j];
            acceleration[k] += boom.R[j][k] * base.acceleration[j];
        }
    }
    for (k = 0; k < 3; k++) {
        const int a = (k + 1) % 3, b = (k + 2) % 3;
        turning.velocity[k] = velocity[k] + boom.velocity[k];
        turning.acceleration[k] = acceleration[k] + velocity[a] * boom.velocity[b] - velocity[b] * boom.velocity[a] + boom.acceleration[k];
    }
    product(base.R, boom.R, turning.R);
    return turning;
}

/* Entry i, j of alpha x . + omega x (omega x .). */
static double gradient(const pmr_turning *turning, int i, int j)
{
    static const double sign[3][3] = {{0.0, -1.0, 1.0}, {1.0, 0.0, -1.0}, {-1.0, 1.0, 0.0}};
    const double *w = turning->velocity;
    double entry = w[i] * w[j];
    if (i == j) entry -= w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
    else entry += sign[i][j] * turning->acceleration[3 - i - j];
    return entry;
}

static double quantity(const pmr_system *y, const pmr_turning *turning, const double *motions, const int32_t *of)
{
    double sum = 0.0;
    int k;
    switch (of[0]) {
    case PMR_TURNED: return turning->R[of[1]][of[2]];
    case PMR_VELOCITY: return turning->velocity[of[1]];
    case PMR_TURNING: return turning->acceleration[of[1]];
    case PMR_GRADIENT: return gradient(turning, of[1], of[2]);
    case PMR_MOTION: return motions[of[1]];
    case PMR_REACH:
        for (k = 0; k < of[1]; k++) sum += motions[of[2] * y->motions + k];
        return sum;
    case PMR_OVER: return 1.0 / motions[of[1] - 1];
    default: return 1.0;
    }
}

int pmr_frame_drivers(const pmr_system *y, const double *motions, double *u, double *quantities)
{
    pmr_turning turning;
    int32_t k, n;
    if (!y->motions) return PMR_REFUSED;
    turning = turn(y, motions);
    for (k = 0; k < y->quantities; k++) quantities[k] = quantity(y, &turning, motions, y->quantity_list + 3 * k);
    for (k = 0; k < y->paths; k++) u[k] = motions[y->frame_paths[k]];
    for (k = 0; k < y->inputs + y->terms; k++) {
        double sum = 0.0;
        for (n = y->first_product[k]; n < y->first_product[k + 1]; n++) {
            const int32_t *of = y->products + 3 * n;
            sum += y->factors[n] * quantities[of[0]] * quantities[of[1]] * quantities[of[2]];
        }
        u[y->paths + k] = sum;
    }
    return PMR_DONE;
}
