/* Friction of pads along the boom.

   A pad that presses with N, while its section slides out by dy in a step, pulls that back with

       f_{n+1} = clip(f_n + kappa dy, -L, L),    L = mu(v) |N|:

   it sticks as a spring of stiffness kappa, and slides at its law's limit L (Jenkins' element; Iwan 1966) of the speed
   v = |ds| / h by which its joint's path moves in a step or a part of one.  With Lambda
   the force of the joint's cylinder of stiffness k, of which lambda = Lambda - sum f reaches the sections, the pads
   of a joint slide by y = s - Lambda / k, and the cylinder gives way by sum f / k more, its gap.  On the face that a
   pad touches, an arm e from the axis, friction makes a moment -e sign(lambda) f: the multiplier of a row C' behind
   the contacts.

   law.h has mu(v) |N|. */
#include "law.h"

/* Of the lengths that a slip is found from: what is round-off; and how often it is improved at most. */
#define SLIP_ROUND_OFF 1e-15
#define SLIP_TRIES 64

/* x + softness (sum f - given) = moved with f = clip(old + kappa x, -limit, limit), whose left side grows at least as
   x does, by Newton's steps kept between what is known to be too little and too much.  One that is not half as long
   as the one before gives way to halving: where all pads slide on both sides of the solution Newton's steps go to and
   fro for ever. */
static double slide(int count, const double *kappa, const double *old, const double *limits, double moved,
                    double softness, double given, double *f)
{
    double x = moved, low = -INFINITY, high = INFINITY, last = INFINITY, total = 0.0;
    int tries, j;
    for (tries = 0; tries < SLIP_TRIES; tries++) {
        double slope = 1.0, size = 0.0, off, ahead;
        total = 0.0;
        for (j = 0; j < count; j++) {
            const double value = old[j] + kappa[j] * x;
            f[j] = value < -limits[j] ? -limits[j] : value > limits[j] ? limits[j] : value;
            total += f[j];
            size += fabs(f[j]);
            if (f[j] == value) slope += softness * kappa[j];
        }
        off = x + softness * (total - given) - moved;
        if (!(fabs(off) > SLIP_ROUND_OFF * (fabs(x) + fabs(moved) + softness * (size + fabs(given))))) break;
        if (off > 0.0) {
            low = larger(low, x - off);
            high = x;
        } else {
            high = x - off < high ? x - off : high;
            low = x;
        }
        ahead = x - off / slope;
        if (fabs(ahead - x) > last / 2.0 || !(ahead >= low && ahead <= high)) ahead = low + (high - low) / 2.0;
        last = fabs(ahead - x);
        x = ahead;
    }
    return total;
}

/* New friction of a joint's pads after the old one, with their limits, where the joint's path has moved so far; returns
   its sum. */
static double slide_joint(int count, const double *kappa, const double *old, const double *limits, double moved,
                          const pmr_cylinder *c, double *f)
{
    double softness = 0.0;
    if (c->gives > 0.0) {
        const double soft = larger(c->compliance - c->gives, 0.0); /* as more friction lets it slide less */
        softness = c->gives * soft / (c->gives + soft);
        moved -= c->gives * (c->force + c->friction - c->drive);
    }
    return slide(count, kappa, old, limits, moved, softness, c->friction, f);
}

static double friction_alone(int n, const double *kappa, const double *laws, const double *forces, const double *old,
                             double moved, double speed, const pmr_cylinder *c, double *limits, double *f)
{
    int j;
    for (j = 0; j < n; j++) limits[j] = friction_limit(laws + LAW_CONSTANTS * j, forces[j], speed, NULL);
    return slide_joint(n, kappa, old, limits, moved, c, f);
}

static double total_friction(const pmr_system *y, const double *friction, int joint)
{
    double sum = 0.0;
    int j;
    for (j = y->first_pad[joint]; j < y->first_pad[joint + 1]; j++) sum += friction[j];
    return sum;
}

/* Moments of pads by friction and the present multipliers. */
static void find_moments(const pmr_state *st, const double *friction, double *moments)
{
    const pmr_system *y = st->system;
    int j;
    for (j = 0; j < y->pads; j++) {
        const double moment = y->pad_arms[j] * friction[j];
        moments[j] = st->lambda[y->pad_contacts[j]] < 0.0 ? moment : -moment;
    }
}

/* Let cylinders give way to the sums of their joints' friction. */
static void set_gaps(pmr_state *st)
{
    const pmr_system *y = st->system;
    int i;
    for (i = 0; i < y->joints; i++)
        if (y->joint_gives[i] > 0.0) st->gap[y->joint_cylinders[i]] = y->joint_gives[i] * st->joint_sums[i];
}

/* Friction, its moments and its sums that follow from the present multipliers, which were found under the old ones.
   What counts as small is measured by what all pads could bear: gaps by sum mu |lambda| / k, forces on the modes by
   sum (e mu |lambda|)^2 |C'|^2, of which the largest so far stay. */
static void find_friction(pmr_state *st, double h)
{
    const pmr_system *y = st->system;
    double gap = 0.0, square = 0.0;
    int i, j;
    for (i = 0; i < y->joints; i++) {
        const int first = y->first_pad[i], count = y->first_pad[i + 1] - first, k = y->joint_cylinders[i];
        const double moved = st->s[y->joint_paths[i]] - st->travelled[i];
        pmr_cylinder c = {.gives = y->joint_gives[i], .friction = st->joint_sums[i], .drive = st->drives[i]};
        for (j = first; j < first + count; j++) {
            const double *row = st->C + (size_t)(y->contacts + j) * y->modes;
            const double force = st->lambda[y->pad_contacts[j]];
            const double limit = friction_limit(y->pad_laws + LAW_CONSTANTS * j, force, fabs(moved) / h, NULL);
            const double moment = y->pad_arms[j] * limit;
            st->limits[j] = limit;
            square += moment * moment * dot(row, row, 0, y->modes);
            if (c.gives > 0.0) gap += c.gives * limit;
        }
        if (c.gives > 0.0) {
            c.compliance = st->A[k * y->mp + k];
            c.force = st->lambda[k];
        }
        st->new_sums[i] = slide_joint(count, y->pad_stiffness + first, st->old_friction + first, st->limits + first,
                                      moved, &c, st->friction + first);
    }
    find_moments(st, st->friction, st->new_moments);
    st->progress.gap_largest = larger(st->progress.gap_largest, gap);
    st->progress.rub_largest = larger(st->progress.rub_largest, square);
}

static int sticks(const pmr_state *st, int pad) { return fabs(st->friction[pad]) < st->limits[pad]; }

/* The same along a seed, with pads that stick or slide going on so: sums and moments by what it makes of multipliers,
   of drivers u (N,) or NULL, and of the old sums. */
static void follow_friction(pmr_state *st, double h, const double *lambda, const double *u, const double *sums)
{
    const pmr_system *y = st->system;
    int i, j;
    for (i = 0; i < y->joints; i++) {
        const double gives = y->joint_gives[i], moved = st->s[y->joint_paths[i]] - st->travelled[i];
        const double faster = (u ? u[y->joint_paths[i]] : 0.0) * (moved < 0.0 ? -1.0 : 1.0) / h;
        double softness = 0.0, slope = 1.0, slid = u ? u[y->joint_paths[i]] : 0.0, total = 0.0;
        if (gives > 0.0) {
            const int k = y->joint_cylinders[i];
            const double soft = larger(st->A[k * y->mp + k] - gives, 0.0);
            softness = gives * soft / (gives + soft);
            slid -= gives * (lambda[k] + sums[i]) - softness * sums[i];
        }
        for (j = y->first_pad[i]; j < y->first_pad[i + 1]; j++) {
            const int k = y->pad_contacts[j];
            const double pushed = st->lambda[k] < 0.0 ? -lambda[k] : lambda[k];
            const double way = st->friction[j] < 0.0 ? -1.0 : 1.0;
            pmr_friction_slopes slopes;
            friction_limit(y->pad_laws + LAW_CONSTANTS * j, st->lambda[k], fabs(moved) / h, &slopes);
            st->along[j] = way * (slopes.by_force * pushed + slopes.by_speed * faster); /* of one that slides */
            if (sticks(st, j))
                slope += softness * y->pad_stiffness[j];
            else
                slid -= softness * st->along[j];
        }
        for (j = y->first_pad[i]; j < y->first_pad[i + 1]; j++) {
            if (sticks(st, j)) st->along[j] = y->pad_stiffness[j] * (slid / slope);
            total += st->along[j];
        }
        st->new_sums[i] = total;
    }
    find_moments(st, st->along, st->new_moments);
}

/* Whether gaps have changed by more than a share of the largest that could be. */
static int gaps_change(const pmr_state *st, double bound)
{
    const pmr_system *y = st->system;
    double change = 0.0;
    int i;
    for (i = 0; i < y->joints; i++)
        change = larger(change, y->joint_gives[i] * fabs(st->new_sums[i] - st->joint_sums[i]));
    return change > bound * st->progress.gap_largest;
}

/* Go on from the last step's end, whatever was tried since. */
static void begin_friction(pmr_state *st)
{
    const pmr_system *y = st->system;
    int i;
    copy(st->friction, st->old_friction, y->pads);
    find_moments(st, st->friction, st->lambda + y->contacts);
    for (i = 0; i < y->joints; i++) st->joint_sums[i] = total_friction(y, st->friction, i);
    set_gaps(st);
}

/* Work of the gaps that friction makes, of cylinders and of what moments move in the contacts by residual
   flexibility. */
static double friction_work(pmr_state *st, const pmr_scheme *c)
{
    const pmr_system *y = st->system;
    double *moments = st->turned, *moved = st->weighted, done = 0.0;
    int k, j, n;
    for (n = 0; n < y->modes; n++) moments[n] = 0.0;
    subtract_rows(st, y->contacts, y->rows, moments);
    over_S(y, c, moments, 0, y->modes, moved);
    for (k = 0; k < y->contacts; k++) {
        double gap = st->gap[k];
        for (j = y->contacts; j < y->rows; j++) gap += st->A[j * y->mp + k] * st->lambda[j];
        gap += c->z_gain * dot(moved, st->C + k * y->modes, 0, y->modes); /* A has what modes make of it, F has not */
        done -= 0.5 * (st->lambda[k] + st->old_lambda[k]) * (gap - st->old_gap[k]);
        st->old_gap[k] = gap;
    }
    return done;
}

static void end_friction(pmr_state *st)
{
    const pmr_system *y = st->system;
    int i;
    copy(st->old_friction, st->friction, y->pads);
    for (i = 0; i < y->joints; i++) {
        const int k = y->joint_cylinders[i];
        st->travelled[i] = st->s[y->joint_paths[i]];
        st->drives[i] = k < 0 ? 0.0 : st->lambda[k] + total_friction(y, st->friction, i);
    }
}
