/* Variables of a unit by their value references, and how they change along others. */
#include "unit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Changes over which derivatives of rates are differences: of paths and angles in m and rad; of all else, in which
   rates are linear. */
#define SMALL 1e-5
#define LARGE 1e6

/* `refuse`, with the variable's name before the reason. */
static int refuse_reference(Unit *unit, const char *why, unsigned reference)
{
    char name[80];
    name_of(unit, reference, name, sizeof name);
    snprintf(unit->message, sizeof unit->message, "%s: %s", name, why);
    return 1;
}

/* Outputs and forces, or with `further` the further outputs: of a step as it found them, else by the inputs and states
   that were set. */
int find_outputs(Unit *unit, int further)
{
    double *u = unit->variables, *outputs = u + unit->at.outputs, *others = outputs + unit->sizes.outputs;
    const pmr_values values = {
        .outputs = outputs, .further = others, .forces = u + unit->at.forces, .closed = unit->closed};
    int failed;
    if (further ? unit->known_further : unit->known_outputs) return 0;
    if (!unit->stands) {
        failed = pmr_evaluate(unit->state, u + DRIVEN, 0, &values);
        if (failed) return unit_failed(unit, failed);
        unit->known_further = unit->known_outputs = 1;
    } else if (further) {
        failed = pmr_further(unit->state, others);
        if (failed) return unit_failed(unit, failed);
        unit->known_further = 1;
    } else {
        pmr_outputs(unit->state, outputs, u + unit->at.forces);
        unit->known_outputs = 1;
    }
    return 0;
}

/* Derivatives of the states by the inputs and states that are set, as variables. */
static int find_derivatives(Unit *unit)
{
    double *u = unit->variables, *to = u + unit->at.derivatives;
    const pmr_values values = {.accelerations = unit->work, .closed = unit->closed};
    int failed;
    if (unit->known_derivatives) return 0;
    failed = pmr_evaluate(unit->state, u + DRIVEN, 0, &values);
    if (failed) return unit_failed(unit, failed);
    memcpy(to, u + unit->at.states + unit->modes, (size_t)unit->modes * sizeof(double));
    pick_modes(unit, unit->work, to + unit->modes);
    unit->known_derivatives = 1;
    return 0;
}

/* Rates of outputs and further ones with drivers (4 N), whose rates are the seed, and v as the rate of z, in `rates`; of
   forces, which have none, they are zero. */
static int find_rates(Unit *unit, const double *driven, int hold, double *rates)
{
    double *v = unit->work + 6 * (size_t)unit->sizes.modes, *nothing = v + unit->sizes.modes;
    const pmr_values values = {.outputs = rates, .further = rates + unit->sizes.outputs, .closed = unit->closed};
    int failed;
    memcpy(v, unit->view.v, (size_t)unit->sizes.modes * sizeof(double));
    memset(nothing, 0, (size_t)unit->sizes.modes * sizeof(double));
    failed = pmr_evaluate_along(unit->state, driven, driven + unit->drivers, v, nothing, hold, &values);
    return failed ? unit_failed(unit, failed) : 0;
}

/* Rates of all outputs and further ones by the inputs and states that are set, as variables. */
static int find_all_rates(Unit *unit)
{
    if (unit->known_rates) return 0;
    if (find_rates(unit, unit->variables + DRIVEN, 0, unit->variables + unit->at.rates)) return 1;
    unit->known_rates = 1;
    return 0;
}

/* Find the variables among which a value reference is, which are those from `*first` to before `*end`. */
static int find_group(Unit *unit, unsigned reference, unsigned *first, unsigned *end)
{
    enum { INPUTS, STATES, DERIVATIVES, OUTPUTS, FURTHER, RATES, FORCES, GROUPS };
    const Numbers *at = &unit->at;
    const unsigned ends[GROUPS] = {at->states, at->derivatives, at->outputs, at->outputs + (unsigned)unit->sizes.outputs,
                                   at->rates,  at->forces,      at->all};
    int group = INPUTS;
    while (group < GROUPS && reference >= ends[group]) group++;
    if (group == GROUPS) return refuse_reference(unit, "no such variable", reference);
    *first = group == INPUTS ? 0 : ends[group - 1];
    *end = ends[group];
    if (group == INPUTS) return 0;
    if (unit_prepare(unit)) return 1;
    switch (group) {
    case STATES: return 0;
    case DERIVATIVES: return find_derivatives(unit);
    case RATES: return find_all_rates(unit);
    default: return find_outputs(unit, group == FURTHER);
    }
}

int get_variables(Unit *unit, const unsigned *references, size_t count, double *values)
{
    unsigned first = 0, end = 0;
    size_t n;
    for (n = 0; n < count; n++) {
        const unsigned reference = references[n];
        const double *estimate = estimator_variable(unit, reference, 0);
        if (estimate) {
            values[n] = *estimate;
            continue;
        }
        if ((reference < first || reference >= end) && find_group(unit, reference, &first, &end)) return 1;
        values[n] = unit->variables[reference];
    }
    return 0;
}

/* Why a variable can't have a value, or NULL. */
static const char *impossible(const Unit *unit, unsigned reference, double value)
{
    if (!isfinite(value)) return "a finite number is allowed";
    if (reference >= DRIVEN && reference < DRIVEN + (unsigned)unit->drivers &&
        (unit->kinds[reference - DRIVEN] == ANGLE || unit->kinds[reference - DRIVEN] == START) &&
        fabs(value) > WHOLE_TURN)
        return "an angle of at most one turn is allowed, in rad";
    if (reference == unit->at.start && value != 0.0 && value != 1.0 && value != 2.0)
        return "0, 1 or 2 is allowed: at rest, static, as given";
    return NULL;
}

int set_variables(Unit *unit, const unsigned *references, size_t count, const double *values)
{
    const Numbers *at = &unit->at;
    size_t n;
    for (n = 0; n < count; n++) {
        const unsigned reference = references[n];
        const int is_parameter = (reference >= at->internal_step && reference < at->states) ||
                                 (reference < at->internal_step && reference != TIME &&
                                  only_starts(unit->kinds[(reference - DRIVEN) % (unsigned)unit->drivers]));
        const int is_state = reference >= at->states && reference < at->derivatives;
        const char *why;
        double *measured = estimator_variable(unit, reference, 1);
        if (measured) {
            *measured = values[n];
            continue;
        }
        if (reference == TIME || reference >= at->derivatives)
            return refuse_reference(unit, "it can be read only", reference);
        if ((is_parameter || is_state) && unit->started)
            return refuse_reference(unit, "parameters and states are fixed once the start is made", reference);
        if ((why = impossible(unit, reference, values[n]))) return refuse_reference(unit, why, reference);
        if (reference < DRIVEN + (unsigned)unit->drivers) {
            double *off = unit->off + (reference - DRIVEN);
            *off = fmax(*off, fabs(values[n] - unit->variables[reference]));
        }
        if (is_state) {
            unit->given[reference - at->states] = values[n];
            unit_changed(unit);
        } else if (unit->variables[reference] != values[n]) {
            unit->variables[reference] = values[n];
            unit_changed(unit);
        }
    }
    return 0;
}

/* Refuse a `count` of states other than 2 r. */
static int check_count(Unit *unit, size_t count)
{
    return count == 2 * (size_t)unit->modes ? 0 : refuse(unit, "another number of states is asked for than there is");
}

int get_states(Unit *unit, double *states, size_t count)
{
    if (check_count(unit, count) || unit_prepare(unit)) return 1;
    memcpy(states, unit->variables + unit->at.states, count * sizeof(double));
    return 0;
}

int set_states(Unit *unit, const double *states, size_t count)
{
    if (check_count(unit, count)) return 1;
    memcpy(unit->variables + unit->at.states, states, count * sizeof(double));
    fill_modes(unit, states, unit->view.z);
    fill_modes(unit, states + unit->modes, unit->view.v);
    unit_changed(unit);
    return 0;
}

int get_derivatives(Unit *unit, double *derivatives, size_t count)
{
    if (check_count(unit, count) || unit_prepare(unit) || find_derivatives(unit)) return 1;
    memcpy(derivatives, unit->variables + unit->at.derivatives, count * sizeof(double));
    return 0;
}

int get_nominals(Unit *unit, double *nominals, size_t count)
{
    if (check_count(unit, count)) return 1;
    memcpy(nominals, unit->nominal, count * sizeof(double));
    return 0;
}

/* ---- derivatives along a seed ---- */

/* Rates change along a seed (4 N, and 2 r' of z and v) of drivers of one kind, and z and v, as differences say. */
static int add_rate_changes(Unit *unit, const double *seed, const double *z, const double *v, int moving,
                            double *answer)
{
    const int n = 4 * unit->drivers, r = unit->sizes.modes, o = unit->outputs;
    const int32_t *kinds = unit->kinds;
    double *old = unit->work + 2 * r, *driven = unit->work + 8 * (size_t)r, *rates = driven + n, largest = 0.0, h;
    int side, k, failed = 0;
    for (k = 0; k < n; k++)
        if ((kinds[k % unit->drivers] != OTHER) == moving) largest = fmax(largest, fabs(seed[k]));
    for (k = 0; k < r && !moving; k++) largest = fmax(largest, fmax(fabs(z[k]), fabs(v[k])));
    if (largest == 0.0) return 0;
    h = (moving ? SMALL : LARGE) / largest;
    memcpy(old, unit->view.z, (size_t)r * sizeof(double));
    memcpy(old + r, unit->view.v, (size_t)r * sizeof(double));
    for (side = -1; side <= 1 && !failed; side += 2) {
        for (k = 0; k < n; k++)
            driven[k] = unit->variables[DRIVEN + k] +
                        ((kinds[k % unit->drivers] != OTHER) == moving ? side * h * seed[k] : 0.0);
        for (k = 0; k < r && !moving; k++) {
            unit->view.z[k] = old[k] + side * h * z[k];
            unit->view.v[k] = old[r + k] + side * h * v[k];
        }
        failed = find_rates(unit, driven, 1, rates);
        for (k = 0; k < o; k++) answer[k] += side * rates[k] / (2.0 * h);
    }
    memcpy(unit->view.z, old, (size_t)r * sizeof(double));
    memcpy(unit->view.v, old + r, (size_t)r * sizeof(double));
    return failed;
}

/* All that changes along a seed (variables), in `answer` (variables). */
static int differentiate_all(Unit *unit, const double *seed, int rates, double *answer)
{
    const Numbers *at = &unit->at;
    const int r = unit->sizes.modes;
    double *z = unit->work, *v = z + r, *accelerations = v + 4 * r;
    const pmr_values values = {.accelerations = accelerations,
                               .outputs = answer + at->outputs,
                               .further = answer + at->outputs + unit->sizes.outputs,
                               .forces = answer + at->forces,
                               .closed = unit->closed};
    int failed;
    memset(z, 0, 2 * (size_t)r * sizeof(double));
    fill_modes(unit, seed + at->states, z);
    fill_modes(unit, seed + at->states + unit->modes, v);
    failed = pmr_evaluate_along(unit->state, unit->variables + DRIVEN, seed + DRIVEN, z, v, 0, &values);
    if (failed) return unit_failed(unit, failed);
    memcpy(answer + at->derivatives, seed + at->states + unit->modes, (size_t)unit->modes * sizeof(double));
    pick_modes(unit, accelerations, answer + at->derivatives + unit->modes);
    if (!rates) return 0;
    return add_rate_changes(unit, seed + DRIVEN, z, v, 0, answer + at->rates) ||
           add_rate_changes(unit, seed + DRIVEN, z, v, 1, answer + at->rates);
}

int differentiate(Unit *unit, const unsigned *unknowns, size_t unknown_count, const unsigned *knowns,
                  size_t known_count, const double *seed, double *answer)
{
    const Numbers *at = &unit->at;
    double *of, *to;
    int rates = 0, failed;
    size_t n;
    for (n = 0; n < known_count; n++) {
        const int is_input = knowns[n] >= DRIVEN && knowns[n] < at->internal_step;
        if (!is_input && !(knowns[n] >= at->states && knowns[n] < at->derivatives))
            return refuse_reference(unit, "derivatives with respect to states and inputs are known", knowns[n]);
    }
    for (n = 0; n < unknown_count; n++) {
        if (unknowns[n] < at->derivatives || unknowns[n] >= at->all)
            return refuse_reference(unit, "derivatives of outputs and of the states' rates are known", unknowns[n]);
        rates |= unknowns[n] >= at->rates && unknowns[n] < at->forces;
    }
    if (unit->sizes.hoist || unit->sizes.computed)
        return refuse(unit, "derivatives with a hoist or a free motion are not known");
    if (unit_prepare(unit)) return 1;
    of = calloc(2 * (size_t)at->all, sizeof(double));
    if (!of) return refuse(unit, "no memory is left");
    to = of + at->all;
    for (n = 0; n < known_count; n++) of[knowns[n]] += seed[n];
    failed = differentiate_all(unit, of, rates, to);
    for (n = 0; n < unknown_count && !failed; n++) answer[n] = to[unknowns[n]];
    free(of);
    return failed;
}
