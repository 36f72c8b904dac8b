/* A frame that moves: loads and amplitudes of terms as sums of products of few quantities, and these from how the
   frame is driven.

       u_k = sum over its products of  factor x_a x_b x_c

   A quantity x is 1, an entry of the rotation R from axes of the boom into those of the ground, a component of the
   angular velocity omega or acceleration alpha in axes of the boom, an entry of the acceleration field's gradient
   alpha x . + omega x (omega x .), a motion itself, where the tail of a section is (the sum of the first paths) or
   its rate, one over an extension, or a component in axes of the boom of the direction that is up for the machine.  R,
   omega and alpha follow from luffing and slewing and, where the base rocks, from its roll, pitch and yaw.  Numbers
   carry a derivative along a seed of the motions with them. */
#include "internal.h"

#include <string.h>

#include "numbers.h"

/* Motions (3, n), and a seed of them or NULL. */
typedef struct {
    const pmr_system *system;
    const double *at, *seed;
} course;

INLINE number motion(const course *c, int n, int order)
{
    const int at = order * c->system->motions + n;
    return (number){c->at[at], c->seed ? c->seed[at] : 0.0};
}

INLINE angle angle_of(const course *c, int which)
{
    const int32_t n = c->system->frame_angles[which];
    if (n < 0) return (angle){constant(0.0), constant(0.0), constant(0.0)};
    return (angle){motion(c, n, 0), motion(c, n, 1), motion(c, n, 2)};
}

/* Roll, pitch and yaw of the base; whether it has any. */
static int rocks(const course *c, angle by[3])
{
    const int32_t *angles = c->system->frame_angles + 2;
    int k;
    for (k = 0; k < 3; k++) by[k] = angle_of(c, 2 + k);
    return angles[0] >= 0 || angles[1] >= 0 || angles[2] >= 0;
}

/* A boom that is raised by phi, then slewed by psi, R_Z(psi) R_Y(-phi), on its base. */
static turning slew(const course *c)
{
    const angle phi = angle_of(c, 0);
    const turning raised = about(1, (angle){negative(phi.at), negative(phi.rate), negative(phi.second)}),
                  slewed = about(2, angle_of(c, 1));
    return turn_on(&slewed, &raised);
}

/* The boom on its base. */
static turning turn(const course *c, turning *base)
{
    const turning boom = slew(c);
    angle by[3];
    *base = UNTURNED;
    if (!rocks(c, by)) return boom;
    *base = rock_by(by);
    return turn_on(base, &boom);
}

static void read_turning(const turning *from, pmr_turning *to)
{
    int i, j;
    for (i = 0; i < 3; i++) {
        to->velocity[i] = from->velocity[i].at;
        to->acceleration[i] = from->acceleration[i].at;
        for (j = 0; j < 3; j++) to->R[3 * i + j] = from->R[i][j].at;
    }
}

void pmr_frame_turning(const pmr_system *y, const double *motions, pmr_turning *boom, pmr_turning *base)
{
    const course c = {y, motions, NULL};
    turning of_base;
    const turning of_boom = turn(&c, &of_base);
    read_turning(&of_boom, boom);
    read_turning(&of_base, base);
}

INLINE number quantity(const course *c, const turning *turned, const int32_t *of)
{
    number sum = constant(0.0);
    int k;
    switch (of[0]) {
    case PMR_TURNED: return turned->R[of[1]][of[2]];
    case PMR_VELOCITY: return turned->velocity[of[1]];
    case PMR_TURNING: return turned->acceleration[of[1]];
    case PMR_GRADIENT: return gradient(turned, of[1], of[2]);
    case PMR_MOTION: return motion(c, of[1], 0);
    case PMR_REACH:
        for (k = 0; k < of[1]; k++) sum = plus(sum, motion(c, k, of[2]));
        return sum;
    case PMR_OVER: return inverse(motion(c, of[1] - 1, 0));
    case PMR_RAISED: return of[1] == 1 ? constant(0.0) : of[1] ? cosine(angle_of(c, 0).at) : sine(angle_of(c, 0).at);
    default: return constant(1.0);
    }
}

INLINE number taken(const double *values, const double *changes, int n)
{
    return (number){values[n], changes ? changes[n] : 0.0};
}

/* Paths where the boom is turned so, loads and amplitudes of terms, or of these the loads by `count` of the inputs alone,
   and unless `along` is NULL how they change.  Compiled without it where it is a NULL, no derivative is computed. */
INLINE void show_drivers(const course *c, const turning *turned, int count, const int32_t *inputs, double *u,
                         double *along, double *work)
{
    const pmr_system *y = c->system;
    double *changes = along ? work + y->quantities : NULL;
    int32_t k, n;
    for (k = 0; k < y->quantities; k++) {
        const number now = quantity(c, turned, y->quantity_list + 3 * k);
        work[k] = now.at;
        if (along) changes[k] = now.along;
    }
    for (k = 0; k < y->paths; k++) {
        const number path = motion(c, y->frame_paths[k], 0);
        u[k] = path.at;
        if (along) along[k] = path.along;
    }
    for (k = 0; k < count; k++) {
        const int32_t of = inputs ? inputs[k] : k, *first = y->first_product + of;
        number sum = constant(0.0);
        for (n = first[0]; n < first[1]; n++) {
            const int32_t *by = y->products + 3 * n;
            const number product = times(times(taken(work, changes, by[0]), taken(work, changes, by[1])), taken(work, changes, by[2]));
            sum = plus(sum, times(constant(y->factors[n]), product));
        }
        u[y->paths + of] = sum.at;
        if (along) along[y->paths + of] = sum.along;
    }
}

void pmr_frame_along(const pmr_system *y, const double *motions, const double *seed, double *u, double *along, double *work)
{
    const course c = {y, motions, seed};
    turning base;
    const turning turned = turn(&c, &base);
    show_drivers(&c, &turned, y->drivers - y->paths, NULL, u, along, work);
}

void pmr_frame_turned(const pmr_system *y, const double *motions, const pmr_turning *boom, int count,
                      const int32_t *inputs, double *u, double *work)
{
    const course c = {y, motions, NULL};
    turning turned;
    int i, j;
    for (i = 0; i < 3; i++) {
        turned.velocity[i] = constant(boom->velocity[i]);
        turned.acceleration[i] = constant(boom->acceleration[i]);
        for (j = 0; j < 3; j++) turned.R[i][j] = constant(boom->R[3 * i + j]);
    }
    show_drivers(&c, &turned, count, inputs, u, NULL, work);
}

int pmr_frame_drivers(const pmr_system *y, const double *motions, double *u, double *work)
{
    const course c = {y, motions, NULL};
    turning base, turned;
    if (!y->motions) return PMR_REFUSED;
    turned = turn(&c, &base);
    show_drivers(&c, &turned, y->drivers - y->paths, NULL, u, NULL, work);
    return PMR_DONE;
}

/* Output, reaction or force by its number among all, and how it changes. */
INLINE number value_of(const pmr_system *y, const double *values, const double *changes, int n)
{
    if (n >= y->outputs + y->reactions)
        n += y->op - y->outputs + y->hp - y->reactions;
    else if (n >= y->outputs)
        n += y->op - y->outputs;
    return taken(values, changes, n);
}

/* Component j of the wrench about the pivot with which the boom presses on the ground, but for a cylinder that gives
   way. */
INLINE number pressed(const course *c, const double *values, const double *changes, int j)
{
    const pmr_system *y = c->system;
    number sum = constant(0.0);
    int k, p;
    for (k = 0; k < y->pressing; k++) {
        const double *of = y->pressing_wrenches + (size_t)(6 * k + j) * (1 + y->paths);
        number lever = constant(of[0]); /* of a unit, where the paths stand */
        for (p = 0; p < y->paths; p++) lever = plus(lever, times(constant(of[1 + p]), motion(c, y->frame_paths[p], 0)));
        sum = plus(sum, times(value_of(y, values, changes, y->pressing_numbers[k]), lever));
    }
    return sum;
}

/* Outriggers under forces of boom, rope and machine; values end with the wrench of a rope on a winch on the machine. */
INLINE int find_ground(const course *c, const double *values, const double *changes, double *columns, double *along)
{
    const pmr_system *y = c->system;
    const turning slewed = slew(c);
    angle rocking[3];
    const int32_t *of = y->ground_numbers;
    number boom[6], wrench[6] = {{0.0, 0.0}}, falling[3], direction[2], length;
    int i, j, k;
    for (j = 0; j < 6; j++) /* no derivatives with a hoist */
        boom[j] = plus(constant(values[y->op + y->hp + y->forces + j]), pressed(c, values, changes, j));
    if (of[4] >= 0) { /* a cylinder that gives way pushes the ground from lug to foot */
        const double *lug = y->cylinder_hinges + 2;
        const number force = negative(value_of(y, values, changes, of[4]));
        (void)cylinder_line(y->cylinder_hinges, lug, angle_of(c, 0).at, &length, direction);
        for (k = 0; k < 2; k++) direction[k] = times(force, direction[k]);
        boom[0] = plus(boom[0], direction[0]);
        boom[2] = plus(boom[2], direction[1]);
        boom[4] = plus(boom[4], minus(times(constant(lug[1]), direction[0]), times(constant(lug[0]), direction[1])));
    }
    for (i = 0; i < 6; i++)
        for (j = 0; j < 3; j++) wrench[i] = plus(wrench[i], times(slewed.R[i % 3][j], boom[i - i % 3 + j]));
    for (k = 0; k < 3; k++) falling[k] = of[k] < 0 ? constant(0.0) : motion(c, of[k], 0);
    if (of[3] >= 0) falling[2] = plus(falling[2], motion(c, of[3], 0));
    pmr_add_masses(y->ground_mass_count, y->ground_masses, angle_of(c, 1), rocks(c, rocking) ? rocking : NULL, falling,
                   wrench);
    return pmr_stand_along(&y->stand, wrench, columns, along);
}

int pmr_ground_outputs(const pmr_system *y, const double *motions, const double *seed, const double *values,
                       const double *changes, double *columns, double *along)
{
    const course c = {y, motions, seed}, unchanged = {y, motions, NULL};
    return along ? find_ground(&c, values, changes, columns, along) : find_ground(&unchanged, values, NULL, columns, NULL);
}

int pmr_frame_outputs(const pmr_system *y, const double *motions, const double *seed, const double *values,
                       const double *changes, double *further, double *along)
{
    const course c = {y, motions, seed};
    int n = y->reactions, i, k;
    if (y->has_tip) {
        turning base;
        const turning turned = turn(&c, &base);
        number r[3], at;
        for (k = 0; k < 3; k++) {
            r[k] = constant(y->tip_place[k]);
            if (y->tip_numbers[k] >= 0) r[k] = plus(r[k], value_of(y, values, changes, y->tip_numbers[k]));
        }
        for (k = 0; k < y->tip_numbers[3]; k++) r[0] = plus(r[0], motion(&c, k, 0));
        for (i = 0; i < 3; i++, n++) {
            at = constant(0.0);
            for (k = 0; k < 3; k++) at = plus(at, times(turned.R[i][k], r[k]));
            further[n] = at.at;
            if (along) along[n] = at.along;
        }
    }
    if (y->has_cylinder) { /* positive where it presses: the moment over what its length grows by for each radian */
        const double *foot = y->cylinder_hinges;
        number length, direction[2], arm = cylinder_line(foot, foot + 2, angle_of(&c, 0).at, &length, direction),
                                     force = times(pressed(&c, values, changes, 4), inverse(arm));
        further[n] = force.at;
        if (along) along[n] = force.along;
        for (k = 0; k < 2 && y->cylinder_pin[k] >= 0; k++) { /* a pin bears what the cylinder does not */
            number more = times(force, direction[k]);
            if (k) more = plus(more, value_of(y, values, changes, y->cylinder_pin[2]));
            further[y->cylinder_pin[k]] += more.at;
            if (along) along[y->cylinder_pin[k]] += more.along;
        }
        n++;
    }
    return y->ground ? pmr_ground_outputs(y, motions, seed, values, changes, further + n, along ? along + n : NULL)
                     : PMR_DONE;
}
