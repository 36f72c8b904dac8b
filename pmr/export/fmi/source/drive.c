#include "drive.h"
#include "rows.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

void drive_on(double *variables, const double *given, double time)
{
    int n;
    for (n = 0; n < DRIVERS; n++) {
        double u = given[n], u1 = given[DRIVERS + n], u2 = given[2 * DRIVERS + n], u3 = given[3 * DRIVERS + n];
        double *now = variables + DRIVEN + n;
        now[0] = u + time * (u1 + time / 2.0 * (u2 + time / 3.0 * u3));
        now[DRIVERS] = u1 + time * (u2 + time / 2.0 * u3);
        now[2 * DRIVERS] = u2 + time * u3;
    }
}

/* The range of a path, or a turn of an angle; 0 of an input that is no motion. */
static double range_of(int driver)
{
#if FRAME
    int k;
    for (k = 0; k < ANGLES; k++)
        if (driver == angle_drivers[k]) return WHOLE_TURN;
#endif
    return driver < PATHS ? path_ends[driver][1] - path_ends[driver][0] : 0.0;
}

void check_inputs(Body *body)
{
    const double *u = body->memory.variables + DRIVEN;
    int n;
    for (n = 0; n < DRIVERS; n++) {
        double second = fabs(u[2 * DRIVERS + n]) + fabs(u[3 * DRIVERS + n]), range = range_of(n), off = body->off[n];
        const char *what = NULL;
        if (range > 0.0 && off > JUMP * range)
            what = "it jumps, which excites what no boom does: set it at the end of each step, in m or rad";
        else if (FRAME && range > 0.0 && off > LEFT_OUT && second == 0.0 && body->second[n] == 0.0)
            what = "it moves without a second rate, so the inertia of what moves is left out: set its rates of order one and two";
        if (what && !body->warned[n]) {
            snprintf(body->warning, sizeof body->warning, "value reference %d: %s", DRIVEN + n, what);
            body->warned[n] = 1;
        }
        body->second[n] = second;
        body->off[n] = 0.0;
    }
}

#if FRAME
static const Number none = {0.0, 0.0, 0.0, 0.0};
static const Number one = {1.0, 0.0, 0.0, 0.0};

static Number plus(Number x, Number y)
{
    Number z = {x.value + y.value, x.rate + y.rate, x.along + y.along, x.both + y.both};
    return z;
}

static Number scaled(double factor, Number x)
{
    Number z = {factor * x.value, factor * x.rate, factor * x.along, factor * x.both};
    return z;
}

static Number times(Number x, Number y)
{
    Number z;
    z.value = x.value * y.value;
    z.rate = x.rate * y.value + x.value * y.rate;
    z.along = x.along * y.value + x.value * y.along;
    z.both = x.both * y.value + x.rate * y.along + x.along * y.rate + x.value * y.both;
    return z;
}

/* g(x) from g, g' and g'' at its value. */
static Number chained(Number x, double g, double g1, double g2)
{
    Number z = {g, g1 * x.rate, g1 * x.along, g1 * x.both + g2 * x.rate * x.along};
    return z;
}

static Number sine(Number x) { return chained(x, sin(x.value), cos(x.value), -sin(x.value)); }
static Number cosine(Number x) { return chained(x, cos(x.value), -sin(x.value), -cos(x.value)); }
static Number minus(Number x, Number y) { return plus(x, scaled(-1.0, y)); }

/* An input or its rate of some order, and how it changes; zero where there is none. */
static Number driver(const double *u, const double *seed, int number, int order)
{
    Number x = none;
    if (number < 0) return x;
    number += DRIVEN + order * DRIVERS;
    x.value = u[number];
    if (order < 3) x.rate = u[number + DRIVERS];
    if (seed) {
        x.along = seed[number];
        if (order < 3) x.both = seed[number + DRIVERS];
    }
    return x;
}

/* How a frame turns: R from its axes into those of its base, angular velocity and acceleration in its axes. */
typedef struct {
    Number R[3][3], velocity[3], acceleration[3];
} Turning;

/* Raised by phi and slewed by psi: R = R_Z(psi) R_Y(-phi). */
static void raise_and_slew(const Number *phi, const Number *psi, Turning *found)
{
    Number s = sine(phi[0]), c = cosine(phi[0]), sz = sine(psi[0]), cz = cosine(psi[0]), both = times(psi[1], phi[1]);
    Number R[3][3] = {{times(cz, c), scaled(-1.0, sz), scaled(-1.0, times(cz, s))},
                      {times(sz, c), cz, scaled(-1.0, times(sz, s))},
                      {s, none, c}};
    memcpy(found->R, R, sizeof R);
    found->velocity[0] = times(psi[1], s);
    found->velocity[1] = scaled(-1.0, phi[1]);
    found->velocity[2] = times(psi[1], c);
    found->acceleration[0] = plus(times(psi[2], s), times(both, c));
    found->acceleration[1] = scaled(-1.0, phi[2]);
    found->acceleration[2] = minus(times(psi[2], c), times(both, s));
}

static Number product(Number x, Number y, Number z) { return times(times(x, y), z); }

/* A base that rolls by a, pitches by b and yaws by c: R_Z(c) R_Y(b) R_X(a), in its own axes. */
static void rock(const Number *a, const Number *b, const Number *c, Turning *found)
{
    Number sa = sine(a[0]), ca = cosine(a[0]), sb = sine(b[0]), cb = cosine(b[0]), opposite[3], roll[3][3];
    Number ab = times(a[1], b[1]), bc = times(b[1], c[1]), ac = times(a[1], c[1]);
    Turning turned;
    int i, j, k;
    for (k = 0; k < 3; k++) opposite[k] = scaled(-1.0, b[k]);
    raise_and_slew(opposite, c, &turned);
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) roll[i][j] = none;
    roll[0][0] = one;
    roll[1][1] = roll[2][2] = ca;
    roll[1][2] = scaled(-1.0, sa);
    roll[2][1] = sa;
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            found->R[i][j] = none;
            for (k = 0; k < 3; k++) found->R[i][j] = plus(found->R[i][j], times(turned.R[i][k], roll[k][j]));
        }
    found->velocity[0] = minus(a[1], times(c[1], sb));
    found->velocity[1] = plus(times(b[1], ca), product(c[1], sa, cb));
    found->velocity[2] = minus(product(c[1], ca, cb), times(b[1], sa));
    found->acceleration[0] = minus(minus(a[2], times(c[2], sb)), times(bc, cb));
    found->acceleration[1] = minus(plus(minus(times(b[2], ca), times(ab, sa)), plus(product(c[2], sa, cb), product(ac, ca, cb))),
                                   product(bc, sa, sb));
    found->acceleration[2] = minus(minus(product(c[2], ca, cb), product(ac, sa, cb)),
                                   plus(product(bc, ca, sb), plus(times(b[2], sa), times(ab, ca))));
}

static void cross(const Number *x, const Number *y, Number *z)
{
    int k;
    for (k = 0; k < 3; k++) z[k] = minus(times(x[(k + 1) % 3], y[(k + 2) % 3]), times(x[(k + 2) % 3], y[(k + 1) % 3]));
}

/* The frame, carried by its base. */
static void turn(const double *u, const double *seed, Turning *found)
{
    Number angles[ANGLES][3];
    Turning own, base;
    int i, j, k;
    for (k = 0; k < ANGLES; k++)
        for (i = 0; i < 3; i++) angles[k][i] = driver(u, seed, angle_drivers[k], i);
    raise_and_slew(angles[0], angles[1], found);
    if (angle_drivers[2] < 0 && angle_drivers[3] < 0 && angle_drivers[4] < 0) return;
    own = *found;
    rock(angles[2], angles[3], angles[4], &base);
    {
        Number velocity[3], acceleration[3], crossed[3];
        for (k = 0; k < 3; k++) {
            velocity[k] = acceleration[k] = none;
            for (j = 0; j < 3; j++) {
                velocity[k] = plus(velocity[k], times(own.R[j][k], base.velocity[j]));
                acceleration[k] = plus(acceleration[k], times(own.R[j][k], base.acceleration[j]));
            }
        }
        cross(velocity, own.velocity, crossed);
        for (k = 0; k < 3; k++) {
            found->velocity[k] = plus(velocity[k], own.velocity[k]);
            found->acceleration[k] = plus(plus(acceleration[k], crossed[k]), own.acceleration[k]);
        }
    }
    for (i = 0; i < 3; i++)
        for (j = 0; j < 3; j++) {
            found->R[i][j] = none;
            for (k = 0; k < 3; k++) found->R[i][j] = plus(found->R[i][j], times(base.R[i][k], own.R[k][j]));
        }
}

/* Where the tail of a section is on the axis of the boom, or its rate of some order. */
static Number reach(const double *u, const double *seed, int section, int order)
{
    Number x = none;
    int k;
    for (k = 1; k <= section; k++) x = plus(x, driver(u, seed, section_paths[k], order));
    return x;
}

static void find_quantities(const double *u, const double *seed, const Turning *turning, Number *x)
{
    static const double sign[3][3] = {{0.0, -1.0, 1.0}, {1.0, 0.0, -1.0}, {-1.0, 1.0, 0.0}};
    Number square = none, length;
    int n, k;
    for (k = 0; k < 3; k++) square = plus(square, times(turning->velocity[k], turning->velocity[k]));
    for (n = 0; n < QUANTITIES; n++) {
        int i = quantities[n][1], j = quantities[n][2];
        switch (quantities[n][0]) {
        case ONE: x[n] = one; break;
        case TURNED: x[n] = turning->R[i][j]; break;
        case VELOCITY: x[n] = turning->velocity[i]; break;
        case TURNING: x[n] = turning->acceleration[i]; break;
        case GRADIENT: /* of alpha x r + omega x (omega x r) */
            x[n] = times(turning->velocity[i], turning->velocity[j]);
            if (i == j) x[n] = minus(x[n], square);
            else x[n] = plus(x[n], scaled(sign[i][j], turning->acceleration[3 - i - j]));
            break;
        case DRIVER: x[n] = driver(u, seed, i, 0); break;
        case REACH: x[n] = reach(u, seed, i, j); break;
        case OVER:
            length = driver(u, seed, section_paths[i], 0);
            x[n] = chained(length, 1.0 / length.value, -1.0 / (length.value * length.value),
                           2.0 / (length.value * length.value * length.value));
        }
    }
}

/* The sum of products with that number. */
static Number amplitude(const Number *x, int number, int what)
{
    Number sum = none;
    int n;
    for (n = first_product[number]; n < first_product[number + 1]; n++) {
        const int *of = products[n];
        if (what == VALUES) sum.value += factors[n] * x[of[0]].value * x[of[1]].value * x[of[2]].value;
        else sum = plus(sum, scaled(factors[n], product(x[of[0]], x[of[1]], x[of[2]])));
    }
    return sum;
}

/* Where the tip is from the pivot, along axes of the ground; `along` are how all variables change along the seed. */
static void find_tip(const Body *body, const double *seed, const double *along, Number *tip)
{
    const double *u = body->memory.variables;
    Number r[3];
    int i, k;
    for (k = 0; k < 3; k++) {
        int n = tip_outputs[k];
        r[k] = k == 0 ? reach(u, seed, TIP_SECTION, 0) : none;
        r[k].value += tip_place[k];
        if (n < 0) continue;
        r[k].value += u[DISPLACEMENTS + n];
        r[k].rate += u[VELOCITIES + n];
        if (seed) r[k].along += along[DISPLACEMENTS + n];
        if (seed) r[k].both += along[VELOCITIES + n];
    }
    for (i = 0; i < 3; i++) {
        tip[i] = none;
        for (k = 0; k < 3; k++) tip[i] = plus(tip[i], times(body->drive.turned[i][k], r[k]));
    }
}

#if LUFFING
static int luffing_number(int source) { return source < 0 ? FORCES - 1 - source : DISPLACEMENTS + source; }

/* Force of the cylinder that raises the boom: the moment about the pivot over what its length grows by for each radian; its
   direction from foot to lug, x and z in the axes of the boom. */
static Number find_luffing(const double *u, const double *seed, const double *found, Number direction[2])
{
    const double *foot = luffing_hinges, *lug = luffing_hinges + 2;
    Number phi = driver(u, seed, angle_drivers[0], 0), s = sine(phi), c = cosine(phi), moment = none, square, turned, inverse, arm;
    Number at[2], own[2];
    int k, p;
    at[0] = minus(scaled(lug[0], c), scaled(lug[1], s));
    at[1] = plus(scaled(lug[0], s), scaled(lug[1], c));
    for (k = 0; k < 2; k++) own[k] = minus(at[k], scaled(foot[k], one));
    square = plus(times(own[0], own[0]), times(own[1], own[1]));
    turned = minus(times(own[1], at[0]), times(own[0], at[1]));
    inverse = chained(square, pow(square.value, -0.5), -0.5 * pow(square.value, -1.5), 0.75 * pow(square.value, -2.5));
    arm = times(turned, inverse);
    direction[0] = times(inverse, plus(times(own[0], c), times(own[1], s)));
    direction[1] = times(inverse, minus(times(own[1], c), times(own[0], s)));
    for (k = 0; k < LUFFING; k++) {
        int number = luffing_number(luffing_sources[k]);
        Number force = none, lever = scaled(luffing_moments[k][0], one);
        force.value = u[number];
        if (seed) force.along = found[number];
        for (p = 0; p < PATHS; p++) lever = plus(lever, scaled(luffing_moments[k][1 + p], driver(u, seed, p, 0)));
        moment = plus(moment, times(force, lever));
    }
    return times(moment, chained(arm, 1.0 / arm.value, -1.0 / (arm.value * arm.value), 0.0));
}
#endif
#endif

#if TERMS
static void add_terms(const double *c, double T[PUSHED][2 * MODES])
{
    int k, n;
    memset(T, 0, PUSHED * 2 * MODES * sizeof(double));
    for (k = 0; k < TERMS; k++)
        if (c[k] != 0.0)
            for (n = first_entry[k]; n < first_entry[k + 1]; n++) T[entries[n][0]][entries[n][1]] += c[k] * entry_values[n];
}
#endif

void find_drive(Body *body, int what, const double *seed)
{
    Drive *drive = &body->drive;
    const double *u = body->memory.variables;
    int l;
    if (!seed && drive->known >= what) return;
    drive->known = seed ? RATES : what;
#if FRAME
    {
        Number x[QUANTITIES];
        Turning turning;
        double c[TERMS + 1], c_along[TERMS + 1];
        turn(u, seed, &turning);
        memcpy(drive->turned, turning.R, sizeof turning.R);
        find_quantities(u, seed, &turning, x);
        for (l = 0; l < INPUTS; l++) {
            Number f = amplitude(x, l, what);
            drive->f[l] = f.value;
            drive->f_rate[l] = f.rate;
            drive->f_along[l] = f.along;
            drive->f_both[l] = f.both;
        }
        for (l = 0; l < TERMS; l++) {
            Number amplitudes = amplitude(x, INPUTS + l, what);
            c[l] = amplitudes.value;
            c_along[l] = amplitudes.along;
        }
#if TERMS
        add_terms(c, drive->T);
        if (seed) add_terms(c_along, drive->T_along);
#else
        (void)c, (void)c_along;
#endif
    }
#else
    for (l = 0; l < INPUTS; l++) {
        drive->f[l] = u[LOADS + l];
        drive->f_rate[l] = u[LOADS + DRIVERS + l];
        drive->f_along[l] = seed ? seed[LOADS + l] : 0.0;
        drive->f_both[l] = seed ? seed[LOADS + DRIVERS + l] : 0.0;
    }
#endif
}

void subtract_terms(double T[PUSHED][2 * MODES], const double *x, double *forces)
{
    int k, n;
    for (k = 0; k < PUSHED; k++) {
        double sum = 0.0;
        for (n = 0; n < 2 * MODES; n++) sum += T[k][n] * x[n];
        forces[k] -= sum;
    }
}

void add_outputs(const Body *body, const double *seed, const double *v, const double *pushed, double *found)
{
    int k, n;
    (void)seed;
    for (k = 0; k < REACTIONS; k++) {
        double *reaction = found + DISPLACEMENTS + reaction_outputs[k];
        *reaction += pushed[MODES + k];
        for (n = 0; n < MODES; n++) *reaction += reaction_rates[k][n] * v[n];
    }
#if FRAME
    {
        Number tip[3];
        find_tip(body, seed, found, tip);
        for (k = 0; k < 3; k++) found[DISPLACEMENTS + TIP + k] += seed ? tip[k].along : tip[k].value;
#if LUFFING
        {
            Number direction[2], force = find_luffing(body->memory.variables, seed, found, direction);
            found[DISPLACEMENTS + TIP + 3] += seed ? force.along : force.value;
            for (k = 0; k < 2 && luffing_pin[k] >= 0; k++) {
                Number more = times(force, direction[k]);
                found[DISPLACEMENTS + luffing_pin[k]] += seed ? more.along : more.value;
                if (k) found[DISPLACEMENTS + luffing_pin[k]] += found[luffing_number(luffing_pin[2])];
            }
        }
#endif
    }
#else
    (void)body;
#endif
}

void add_output_rates(const Body *body, const double *seed, double *found)
{
#if FRAME
    Number tip[3];
    int k;
    find_tip(body, seed, found, tip);
    for (k = 0; k < 3; k++) found[VELOCITIES + TIP + k] += seed ? tip[k].both : tip[k].rate;
#else
    (void)body, (void)seed, (void)found;
#endif
}
