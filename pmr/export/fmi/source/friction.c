#include "friction.h"

#include <math.h>
#include <string.h>

#if PADS
/* Of the lengths that a slip is found from: what is round-off; and how often it is improved at most. */
#define ROUND_OFF 1e-15
#define TRIES 64

/* Of all pads of a joint. */
static double total(const double *friction, int joint)
{
    double sum = 0.0;
    int j;
    for (j = first_pad[joint]; j < first_pad[joint + 1]; j++) sum += friction[j];
    return sum;
}

/* New friction of a joint's pads after the old one, which slides by `moved` under a friction `given` and by `softness` less under
   more of it: x + softness (sum of clip(old + kappa x, +-limit) - given) = moved, by Newton's steps kept between what is
   known to be too little and too much.  One that is not half as long as the one before gives way to halving what is between:
   where all pads slide on both sides of the solution Newton's steps go to and fro for ever. */
static void slide(int joint, const double *old, const double *limits, double moved, double softness, double given, double *found)
{
    double x = moved, low = -INFINITY, high = INFINITY, last = INFINITY;
    int tries, j;
    for (tries = 0; tries < TRIES; tries++) {
        double sum = 0.0, slope = 1.0, size = 0.0, off, ahead;
        for (j = first_pad[joint]; j < first_pad[joint + 1]; j++) {
            double value = old[j] + pad_stiffness[j] * x;
            found[j] = fmin(fmax(value, -limits[j]), limits[j]);
            sum += found[j];
            size += fabs(found[j]);
            if (found[j] == value) slope += softness * pad_stiffness[j];
        }
        off = x + softness * (sum - given) - moved;
        if (!(fabs(off) > ROUND_OFF * (fabs(x) + fabs(moved) + softness * (size + fabs(given))))) return;
        if (off > 0.0) {
            low = fmax(low, x - off);
            high = x;
        } else {
            high = fmin(high, x - off);
            low = x;
        }
        ahead = x - off / slope;
        if (fabs(ahead - x) > last / 2.0 || !(ahead >= low && ahead <= high)) ahead = low + (high - low) / 2.0;
        last = fabs(ahead - x);
        x = ahead;
    }
}

void take_friction(Body *body)
{
    memcpy(body->friction, body->memory.friction, sizeof body->friction);
    memcpy(body->multipliers + CONTACTS, body->memory.multipliers + CONTACTS, PADS * sizeof(double));
}

void subtract_friction(const Body *body, double A[ROWS][ROWS], double *motion)
{
    int i, j, k;
    for (k = 0; k < CONTACTS; k++)
        for (j = CONTACTS; j < ROWS; j++) motion[k] -= A[k][j] * body->multipliers[j];
    for (i = 0; i < JOINTS; i++)
        if (joint_gives[i] > 0.0) motion[joint_cylinders[i]] -= joint_gives[i] * total(body->friction, i);
}

int revise_friction(Body *body, int times)
{
    Memory *memory = &body->memory;
    const double *s = memory->variables + PATH;
    double limits[PADS], found[PADS], change = 0.0, size = memory->largest_friction;
    int i, j;
    for (j = 0; j < PADS; j++) limits[j] = pad_coefficients[j] * fabs(body->multipliers[pad_contacts[j]]);
    for (i = 0; i < JOINTS; i++) {
        double gives = joint_gives[i], given = total(body->friction, i), softness = 0.0;
        double moved = s[joint_paths[i]] - memory->travelled[i];
        if (gives > 0.0) {
            int c = joint_cylinders[i];
            double a = fmax(body->A[c][c] - gives, 0.0);
            softness = gives * a / (gives + a);
            moved -= gives * (body->multipliers[c] + given - memory->drives[i]);
        }
        slide(i, memory->friction, limits, moved, softness, given, found);
    }
    for (j = 0; j < PADS; j++) {
        double moment = pad_arms[j] * found[j];
        change = fmax(change, fabs(found[j] - body->friction[j]));
        size = fmax(size, limits[j]); /* where nothing slides friction may be round-off */
        body->friction[j] = found[j];
        body->multipliers[CONTACTS + j] = body->multipliers[pad_contacts[j]] < 0.0 ? moment : -moment;
    }
    if (!(change > CONVERGED * size) || (times == MOST_TIMES && change <= ACCEPTED * size)) {
        memory->largest_friction = size;
        return 0;
    }
    return times == MOST_TIMES ? -1 : 1;
}

void remember_friction(Body *body)
{
    Memory *memory = &body->memory;
    int i;
    memcpy(memory->friction, body->friction, sizeof memory->friction);
    memcpy(memory->multipliers + CONTACTS, body->multipliers + CONTACTS, PADS * sizeof(double));
    for (i = 0; i < JOINTS; i++) {
        int c = joint_cylinders[i];
        memory->travelled[i] = memory->variables[PATH + joint_paths[i]];
        memory->drives[i] = c < 0 ? 0.0 : body->multipliers[c] + total(body->friction, i);
    }
}

void add_to_cylinders(const Body *body, double *forces)
{
    int i;
    for (i = 0; i < JOINTS; i++)
        if (joint_cylinders[i] >= 0) forces[joint_cylinders[i]] += total(body->memory.friction, i);
}
#else
void take_friction(Body *body) { (void)body; }
void subtract_friction(const Body *body, double A[ROWS][ROWS], double *motion) { (void)body, (void)A, (void)motion; }
int revise_friction(Body *body, int times) { return (void)body, (void)times, 0; }
void remember_friction(Body *body) { (void)body; }
void add_to_cylinders(const Body *body, double *forces) { (void)body, (void)forces; }
#endif
