/* Estimates of a unit with an observer: the kernel's filter (filter.c) on linear models of the unit's own steps.

   A rate of an output needs the step before and the one behind it, so estimates are those of one step ago. */
#include "unit.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { SLOTS = 3 }; /* steps that are remembered */

struct Estimator {
    pmr_filter filter;
    pmr_chosen chosen;
    pmr_filter_counts counts;
    const double *x, *P, *square, *felt; /* the first state; what accelerometers feel at rest */
    int32_t *use;
    int unknowns, count;
    size_t slot, saved; /* doubles of a remembered step, and of all that a state is */
    /* saved: steps taken, remembered steps with their measurements, variables, and of the filter what stays */
    double *memory, *taken, *filtered, *slots, *variables;
};

/* ---- opening ---- */

/* An array of the system's file with `count` entries; NULL with `*sound` 0 if there is none. */
static const double *numbers(const Unit *unit, const char *name, int64_t count, int *sound)
{
    int64_t entries = 0;
    const double *array = pmr_system_numbers(unit->system, name, &entries);
    if (count && (!array || entries != count)) *sound = 0;
    return array;
}

/* The same of integers, which are `least` or more and less than `end`. */
static const int32_t *integers(const Unit *unit, const char *name, int64_t count, int32_t least, int32_t end, int *sound)
{
    int64_t entries = 0, k;
    const int32_t *array = pmr_system_integers(unit->system, name, &entries);
    if (count && (!array || entries != count)) return *sound = 0, NULL;
    for (k = 0; k < count; k++)
        if (array[k] < least || array[k] >= end) *sound = 0;
    return array;
}

static int read_arrays(Unit *unit, Estimator *e)
{
    enum { STATES, OUTPUTS, SENSORS, INPUTS, LOADS, PARAMETERS, BIASED, SCALED, OFF, PAYLOAD, ACCELERATION, UNKNOWNS, SIZES };
    pmr_filter *f = &e->filter;
    int sound = 1, forces = unit->sizes.forces;
    const int32_t *s = integers(unit, "observer_sizes", SIZES, -1, 1 << 20, &sound);
    const double *numbers_of = numbers(unit, "observer_numbers", 7, &sound);
    if (!sound || s[STATES] != 3 * unit->modes || s[OUTPUTS] < 1 || s[SENSORS] < 1 || s[PAYLOAD] >= s[INPUTS] ||
        s[ACCELERATION] < 0 || s[ACCELERATION] >= s[OUTPUTS] || s[PARAMETERS] || s[LOADS] < 0 || s[UNKNOWNS] < 0)
        return 1;
    f->states = s[STATES], f->outputs = s[OUTPUTS], f->sensors = s[SENSORS], f->inputs = s[INPUTS], f->loads = s[LOADS];
    f->biased = s[BIASED], f->scaled = s[SCALED], f->off = s[OFF];
    f->payload = s[PAYLOAD], f->acceleration = s[ACCELERATION];
    f->gravity = numbers_of[0], f->gate = numbers_of[1], f->refused = numbers_of[2], f->alarm = numbers_of[3];
    f->share = numbers_of[4], f->following = numbers_of[5];
    unit->estimator_step = numbers_of[6];
    e->unknowns = s[UNKNOWNS];
    f->sensor_outputs = integers(unit, "observer_sensor_outputs", f->sensors, 0, f->outputs, &sound);
    f->load_inputs = integers(unit, "observer_load_inputs", f->loads, 0, f->inputs, &sound);
    f->biased_sensors = integers(unit, "observer_biased_sensors", f->biased, 0, f->sensors, &sound);
    f->scaled_sensors = integers(unit, "observer_scaled_sensors", f->scaled, 0, f->sensors, &sound);
    f->off_sensors = integers(unit, "observer_off_sensors", f->off, 0, f->sensors, &sound);
    f->noise = numbers(unit, "observer_noise", f->sensors, &sound);
    f->errors = numbers(unit, "observer_errors", f->outputs, &sound);
    f->rough = numbers(unit, "observer_rough", f->loads, &sound);
    f->courses = numbers(unit, "observer_courses", 20 * (int64_t)unit->modes, &sound);
    pmr_filter_sizes(f, &e->counts);
    f->decay = numbers(unit, "observer_decay", (int64_t)e->counts.states, &sound);
    f->added = numbers(unit, "observer_added", (int64_t)e->counts.states, &sound);
    e->x = numbers(unit, "observer_x", (int64_t)e->counts.states, &sound);
    e->P = numbers(unit, "observer_P", (int64_t)(e->counts.states * e->counts.states), &sound);
    e->square = numbers(unit, "observer_square", f->outputs, &sound);
    e->felt = numbers(unit, "observer_felt", f->outputs, &sound);
    e->chosen = (pmr_chosen){.outputs = f->outputs, .inputs = f->inputs, .modes = unit->modes, .at_modes = unit->where};
    e->chosen.columns = integers(unit, "observer_columns", f->outputs, 0, unit->sizes.outputs + forces, &sound);
    e->chosen.orders = integers(unit, "observer_orders", f->outputs, 0, 3, &sound);
    e->chosen.loads = integers(unit, "observer_loads", f->inputs, unit->sizes.paths, unit->sizes.drivers, &sound);
    return !sound || f->states + e->unknowns > (int64_t)e->counts.states;
}

/* Arrays of a remembered step, the number of which counts from 0; behind them its measurements. */
static pmr_linear_step step_of(const Estimator *e, int64_t number, double **measured)
{
    const size_t q = e->filter.outputs, i = e->filter.inputs, r = e->chosen.modes;
    double *at = e->slots + (size_t)(number % SLOTS) * e->slot;
    pmr_linear_step to = {.reference = at};
    to.R = at + q, to.G = to.R + 2 * r * r, to.C = to.G + r * i, to.D = to.C + 2 * q * r;
    to.shapes = to.D + q * i, to.loaded = to.shapes + q * r, to.motion = to.loaded + q;
    *measured = to.motion + 3 * r;
    return to;
}

int estimator_open(Unit *unit)
{
    int64_t entries;
    Estimator *e;
    size_t q, p, r, i;
    if (!pmr_system_integers(unit->system, "observer_sizes", &entries)) return 0;
    e = unit->estimator = calloc(1, sizeof *e);
    if (!e || read_arrays(unit, e)) return 1;
    q = e->filter.outputs, p = e->filter.sensors, r = e->chosen.modes, i = e->filter.inputs;
    e->slot = 2 * q + 2 * r * r + r * i + 3 * q * r + q * i + 3 * r + p;
    e->count = (int)(3 * p + 2 * (q + e->unknowns));
    e->saved = 1 + e->counts.kept + SLOTS * e->slot + e->count;
    e->memory = calloc(1 + e->counts.memory + SLOTS * e->slot + e->count, sizeof(double));
    e->use = calloc(p, sizeof *e->use);
    if (!e->memory || !e->use) return 1;
    e->taken = e->memory;
    e->slots = e->taken + 1;
    e->variables = e->slots + SLOTS * e->slot;
    e->filtered = e->variables + e->count;
    for (i = 0; i < p; i++) e->use[i] = PMR_IF_NEAR;
    return 0;
}

void estimator_close(Unit *unit)
{
    if (!unit->estimator) return;
    free(unit->estimator->memory);
    free(unit->estimator->use);
    free(unit->estimator);
}

void estimator_reset(Unit *unit)
{
    Estimator *e = unit->estimator;
    int k;
    if (!e) return;
    *e->taken = 0.0;
    memset(e->slots, 0, SLOTS * e->slot * sizeof(double));
    for (k = 0; k < e->count; k++) e->variables[k] = NAN;
    pmr_filter_start(&e->filter, e->filtered, e->x, e->P, e->square);
}

/* ---- steps ---- */

int estimator_prepare(Unit *unit, const double *u)
{
    Estimator *e = unit->estimator;
    double *measured;
    const pmr_linear_step step = step_of(e, (int64_t)*e->taken, &measured);
    return pmr_linear_matrices(unit->state, &e->chosen, u, &step);
}

/* Estimates of the step before the last one, whose rates are known now. */
static int estimate(Estimator *e, double step)
{
    const int64_t last = (int64_t)*e->taken - 1;
    const int p = e->filter.sensors, q = e->filter.outputs, n = e->filter.states;
    double *measured, *mean = e->variables + p, *deviation = mean + q, *unknown = deviation + q,
                      *unknown_deviation = unknown + e->unknowns, *innovations = unknown_deviation + e->unknowns;
    const pmr_linear_step after = step_of(e, last, &measured), before = step_of(e, last + 1, &measured);
    const pmr_linear_step now = step_of(e, last - 1, &measured);
    const pmr_filter_step linear = {.reference = now.reference,
                                    .R = now.R, .G = now.G, .C = now.C, .D = now.D};
    const double *x = e->filtered, *P = x + e->counts.stride, *level = x + e->counts.kept - p;
    int k, failed;
    pmr_output_rates(&e->chosen, e->filter.courses, step, last > 1 ? &before : NULL, &now, &after);
    for (k = 0; k < q; k++) now.reference[k] += e->felt[k];
    failed = pmr_filter_update(&e->filter, e->filtered, &linear, measured, e->use, innovations);
    if (failed) return failed;
    pmr_filter_outputs(&e->filter, e->filtered, &linear, mean, deviation);
    for (k = 0; k < q; k++) deviation[k] = sqrt(deviation[k]);
    for (k = 0; k < e->unknowns; k++) {
        unknown[k] = x[n + k];
        unknown_deviation[k] = sqrt(fmax(P[(n + k) * (e->counts.stride + 1)], 0.0));
    }
    for (k = 0; k < p; k++) innovations[p + k] = level[k] > e->filter.alarm;
    pmr_filter_predict(&e->filter, e->filtered, &linear);
    return 0;
}

int estimator_take(Unit *unit, const double *u, int measures)
{
    Estimator *e = unit->estimator;
    double *measured;
    const pmr_linear_step step = step_of(e, (int64_t)*e->taken, &measured);
    const int failed = pmr_linear_outputs(unit->state, &e->chosen, u, &step);
    int k;
    if (failed) return failed;
    for (k = 0; k < e->filter.sensors; k++) measured[k] = measures ? e->variables[k] : NAN;
    *e->taken += 1.0;
    return *e->taken > 1.0 ? estimate(e, unit->estimator_step) : 0;
}

/* ---- variables and saved states ---- */

double *estimator_variable(const Unit *unit, unsigned reference, int is_set)
{
    const Estimator *e = unit->estimator;
    if (!e || reference < unit->at.all || reference - unit->at.all >= (unsigned)(is_set ? e->filter.sensors : e->count))
        return NULL;
    return e->variables + (reference - unit->at.all);
}

size_t estimator_bytes(const Unit *unit) { return unit->estimator ? unit->estimator->saved * sizeof(double) : 0; }

void estimator_save(const Unit *unit, void *bytes)
{
    if (unit->estimator) memcpy(bytes, unit->estimator->memory, estimator_bytes(unit));
}

void estimator_restore(Unit *unit, const void *bytes)
{
    if (unit->estimator) memcpy(unit->estimator->memory, bytes, estimator_bytes(unit));
}
