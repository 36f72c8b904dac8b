/* A unit: its system, its start, steps and saved states. */
#include "unit.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* Inputs that a step leaves farther than this share of their range, or of a turn, jump; and a motion in a frame that goes
   on by so much, m or rad, without second rates has no inertia. */
#define JUMP 0.1
/* Share of its range that an input goes before it is compared with its rates. */
#define COMPARED 0.01
#define LEFT_OUT 1e-6

enum { OMEGA, TOLERANCE, RESOLVED, MOST_PARTS, BEYOND_ENDS };

int refuse(Unit *unit, const char *why)
{
    snprintf(unit->message, sizeof unit->message, "%s", why);
    return 1;
}

/* Line `number` of names, as plain text. */
static void line_of(const Unit *unit, const char *list, int number, char *text, size_t room)
{
    size_t count, used = 0;
    const char *names = pmr_system_names(unit->system, list, &count), *end = names + count;
    for (; names && names < end && number > 0; names++) number -= *names == '\n';
    for (; names && names < end && *names != '\n' && used + 1 < room; names++)
        text[used++] = *names < ' ' || *names > '~' || strchr("\"\\%#?", *names) ? '_' : *names;
    text[used] = 0;
}

void name_of(const Unit *unit, unsigned reference, char *text, size_t room)
{
    line_of(unit, "variables", (int)reference, text, room);
    if (!*text) snprintf(text, room, "value reference %u", reference);
}

/* ---- opening ---- */

/* Whether the limits of sums of outputs are there, and their numbers are in range. */
static int read_limits(Unit *unit)
{
    const pmr_sizes *sizes = &unit->sizes;
    const int known =
        sizes->outputs + sizes->forces + sizes->hoist + sizes->computed + sizes->ground + sizes->motions;
    pmr_limits *w = &unit->watched;
    int64_t counts[9];
    const int32_t *often = pmr_system_integers(unit->system, "unit_limits_often", counts + 7);
    int k;
    w->first = pmr_system_integers(unit->system, "unit_limits_first", counts);
    w->numbers = pmr_system_integers(unit->system, "unit_limits_numbers", counts + 1);
    w->shares = pmr_system_numbers(unit->system, "unit_limits_shares", counts + 2);
    w->limits = pmr_system_numbers(unit->system, "unit_limits_limits", counts + 3);
    w->groups = pmr_system_integers(unit->system, "unit_limits_groups", counts + 4);
    w->family = pmr_system_integers(unit->system, "unit_limits_family", counts + 5);
    w->law = pmr_system_numbers(unit->system, "unit_limits_law", counts + 6);
    w->until = pmr_system_integers(unit->system, "unit_limits_until", counts + 8);
    if (!w->first || counts[0] < 1 || w->first[0] != 0 || counts[1] != counts[2] || counts[3] != 2 * (counts[0] - 1) ||
        counts[4] != counts[0] - 1 || counts[5] != counts[0] - 1 || counts[8] != counts[0] - 1 || !w->law || counts[6] != 2 || !often || counts[7] != 1)
        return 0;
    w->count = (int)counts[0] - 1;
    w->often = *often;
    if (w->often < 0 || w->often > w->count) return 0;
    for (k = 0; k < w->count; k++)
        if (w->first[k + 1] < w->first[k] || w->groups[k] < 0 || w->groups[k] >= w->count || w->family[k] < -1 ||
            w->family[k] >= w->count || w->until[k] < -1 || w->until[k] >= w->count)
            return 0;
    if (w->first[w->count] != counts[1]) return 0;
    for (k = 0; k < (int)counts[1]; k++)
        if (w->numbers[k] < 0 || w->numbers[k] >= known) return 0;
    return 1;
}

/* Whether the arrays that are read here are there, and as long as they have to be. */
static int is_sound(Unit *unit)
{
    int64_t counts[6], ends;
    double kind;
    int k;
    unit->first = pmr_system_numbers(unit->system, "unit_start", counts);
    unit->nominal = pmr_system_numbers(unit->system, "unit_nominal", counts + 1);
    unit->limits = pmr_system_numbers(unit->system, "unit_settings", counts + 2);
    unit->where = pmr_system_integers(unit->system, "unit_modes", counts + 3);
    unit->kinds = pmr_system_integers(unit->system, "unit_kinds", counts + 4);
    unit->exchange = pmr_system_integers(unit->system, "unit_exchange", counts + 5);
    unit->ends = pmr_system_numbers(unit->system, "path_ends", &ends);
    if (!unit->first || !unit->nominal || !unit->limits || !unit->where || !unit->kinds || !unit->exchange) return 0;
    pmr_system_sizes(unit->system, &unit->sizes);
    unit->drivers = unit->sizes.motions ? unit->sizes.motions : unit->sizes.drivers;
    unit->modes = (int)counts[3];
    unit->outputs = unit->sizes.outputs + unit->sizes.further;
    if (counts[0] != 4 + 4 * (int64_t)unit->drivers || counts[1] != 2 * counts[3] || counts[2] != 5 ||
        counts[4] != unit->drivers || counts[5] != 1)
        return 0;
    if (!read_limits(unit)) return 0;
    for (k = 0; k < unit->modes; k++)
        if (unit->where[k] < 0 || unit->where[k] >= unit->sizes.modes) return 0;
    for (k = 0; k < unit->drivers; k++)
        if (unit->kinds[k] < OTHER || unit->kinds[k] > FREE_PATH ||
            ((unit->kinds[k] == PATH || unit->kinds[k] == FREE_PATH) && k != unit->paths++))
            return 0;
    /* beside them the luffing angle is the path of a cylinder that gives way */
    if (unit->paths != unit->sizes.paths && !(unit->sizes.motions && unit->paths == unit->sizes.paths - 1)) return 0;
    kind = unit->first[counts[0] - 1];
    return kind == 0.0 || kind == 1.0 || kind == 2.0;
}

/* Equal parts of a step as a run makes them: powers of two, up to what resolves an impact (pmr.simulation.contact_step). */
static int count_levels(const double *settings, double step)
{
    const double needed =
        fmin(fmax(ceil(step * settings[OMEGA] / settings[RESOLVED] - 1e-9), 1.0), settings[MOST_PARTS]);
    int levels = 1;
    while ((1 << (levels - 1)) < needed && levels < 16) levels++;
    return levels;
}

/* Set length and levels of a step, s, and rho_inf; the kernel takes them up in `adjust`. */
static void set_settings(Unit *unit, double step, double rho_inf)
{
    const double *settings = unit->limits;
    unit->settings.step = step;
    unit->settings.rho_inf = rho_inf;
    unit->settings.levels = count_levels(settings, step);
}

/* Open the kernel's state, with room for all parts that a step may have; 1 with the reason in `why`. */
static int open_state(Unit *unit, char *why, size_t room)
{
    const double *settings = unit->limits, *start = unit->first;
    char reason[PMR_MESSAGE];
    int k;
    for (k = 0; k < 16; k++) unit->parts[k] = 1 << k;
    unit->settings.parts = unit->parts;
    unit->settings.contact_omega = settings[OMEGA];
    unit->settings.tolerance = settings[TOLERANCE];
    set_settings(unit, start[unit->at.internal_step], start[unit->at.rho_inf]);
    unit->settings.levels = count_levels(settings, 1e9); /* any step may be asked for */
    if (pmr_state_open(unit->system, &unit->settings, &unit->state, reason)) {
        snprintf(why, room, "%s", reason);
        return 1;
    }
    pmr_state_view(unit->state, &unit->view);
    return 0;
}

/* Number the variables and allocate what a unit needs beside the kernel's state; 1 if there is no memory. */
static int open_memory(Unit *unit)
{
    const int n = unit->drivers, r = unit->modes;
    pmr_limits *watched = &unit->watched;
    Numbers *at = &unit->at;
    double *next;
    size_t count;
    at->internal_step = DRIVEN + 4 * n;
    at->rho_inf = at->internal_step + 1;
    at->start = at->internal_step + 2;
    at->states = at->internal_step + 3;
    at->derivatives = at->states + 2 * r;
    at->outputs = at->derivatives + 2 * r;
    at->rates = at->outputs + unit->outputs;
    at->forces = at->rates + unit->outputs;
    at->all = at->forces + unit->sizes.forces;
    count = 3 * (size_t)at->all + 2 * (size_t)r + 11 * (size_t)n + 8 * (size_t)unit->sizes.modes +
            (size_t)watched->first[watched->count] + 2 * (size_t)watched->count;
    unit->memory = next = calloc(count, sizeof(double));
    unit->warned = calloc((size_t)n + watched->count + unit->sizes.contacts + 1, sizeof(int32_t));
    if (!unit->memory || !unit->warned) return 1;
    watched->warned = unit->warned + n;
    unit->closed = watched->warned + watched->count;
    unit->variables = next;
    unit->given = next += at->all;
    unit->off = next += 2 * r;
    unit->second = next += n;
    unit->rates = next += n;
    watched->values = next += 5 * n;
    watched->largest = next += watched->first[watched->count];
    unit->work = next + 2 * watched->count;
    return 0;
}

Unit *unit_open(const char *token, const char *folder, int model_exchange, char *why)
{
    Unit *unit;
    Shared *shared = token ? shared_open(token, folder, why, 400) : NULL;
    if (!shared) {
        if (!token) snprintf(why, 400, "the token is that of another model");
        return NULL;
    }
    unit = calloc(1, sizeof *unit);
    if (!unit) {
        shared_close(shared);
        snprintf(why, 400, "no memory is left");
        return NULL;
    }
    unit->shared = shared;
    unit->system = shared_system(shared);
    snprintf(why, 400, "no memory is left");
    if (!is_sound(unit))
        snprintf(why, 400, "resources/system.pmr: variables of a unit are missing or damaged");
    else if (model_exchange && !unit->exchange[0])
        snprintf(why, 400, "%s leave no differential equation: Co-Simulation is allowed",
                 unit->sizes.hoist || unit->sizes.computed ? "a hoist and a free motion" : "rigid rows or friction");
    else if (!open_memory(unit) && !open_state(unit, why, 400)) {
        if (!estimator_open(unit)) {
            unit_reset(unit);
            return unit;
        }
        snprintf(why, 400, "resources/system.pmr: arrays of an observer are damaged, or no memory is left");
    }
    unit_close(unit);
    return NULL;
}

void unit_close(Unit *unit)
{
    if (!unit) return;
    estimator_close(unit);
    pmr_state_close(unit->state);
    shared_close(unit->shared);
    free(unit->memory);
    free(unit->warned);
    free(unit);
}

/* ---- where it stands ---- */

void unit_changed(Unit *unit)
{
    unit->stands = unit->known_outputs = unit->known_further = unit->known_rates = unit->known_derivatives = 0;
}

int unit_reset(Unit *unit)
{
    memset(unit->variables, 0, unit->at.all * sizeof(double));
    memcpy(unit->variables, unit->first, unit->at.states * sizeof(double));
    memset(unit->given, 0, 2 * (size_t)unit->modes * sizeof(double));
    memset(unit->off, 0, (size_t)unit->drivers * sizeof(double));
    memset(unit->second, 0, (size_t)unit->drivers * sizeof(double));
    memset(unit->rates, 0, 4 * (size_t)unit->drivers * sizeof(double));
    memset(unit->warned, 0, ((size_t)unit->drivers + unit->watched.count) * sizeof(int32_t));
    memset(unit->watched.largest, 0, 2 * (size_t)unit->watched.count * sizeof(double));
    unit->started = 0;
    unit_changed(unit);
    estimator_reset(unit);
    return 0;
}

/* Modes among all that the kernel has, which are zero where they are no modes, and back. */
void fill_modes(const Unit *unit, const double *from, double *to)
{
    int k;
    for (k = 0; k < unit->modes; k++) to[unit->where[k]] = from[k];
}

void pick_modes(const Unit *unit, const double *from, double *to)
{
    int k;
    for (k = 0; k < unit->modes; k++) to[k] = from[unit->where[k]];
}

/* Take the kernel's modes and their rates over into the variables. */
static void read_states(Unit *unit)
{
    pick_modes(unit, unit->view.z, unit->variables + unit->at.states);
    pick_modes(unit, unit->view.v, unit->variables + unit->at.states + unit->modes);
}

/* Why the kernel failed, with the paths. */
int unit_failed(Unit *unit, int failed)
{
    char where[160] = "", row[80] = "";
    size_t used = 0;
    int p;
    for (p = 0; p < unit->paths && used < sizeof where; p++) {
        char name[40];
        name_of(unit, (unsigned)(DRIVEN + p), name, sizeof name);
        used += (size_t)snprintf(where + used, sizeof where - used, "%s%s = %g m", p ? ", " : "", name,
                                 unit->variables[DRIVEN + p]);
    }
    switch (failed) {
    case PMR_DEPENDENT:
        if (pmr_state_trouble(unit->state) >= 0) line_of(unit, "contacts", pmr_state_trouble(unit->state), row, 80);
        snprintf(unit->message, sizeof unit->message, "at %s %s%s depends on others, or nothing holds it", where,
                 row[0] ? "the row " : "a row", row);
        return 1;
    case PMR_UNSETTLED:
        snprintf(unit->message, sizeof unit->message, "at %s it was not settled which pads are closed", where);
        return 1;
    case PMR_UNCONVERGED:
        return refuse(unit, unit->sizes.pads
                                ? "friction, or forces of second order, do not converge: pads stick and slide, close "
                                  "and open again and again within a step, or it is too long"
                                : "the forces of second order do not converge: shorter steps help where tension, "
                                  "pressure or spin change the stiffness of a step as much as it is");
    case PMR_NOT_FINITE: return refuse(unit, "the state, or a force on the ground, is not finite: loads may have been none");
    case PMR_BLOCKED: return refuse(unit, "the hook is at its head sheaves: its rope is too short");
    case PMR_LIFTED: return refuse(unit, "which outriggers lift off is not found");
    case PMR_LOST: return refuse(unit, "the luffing angle or extension is not found: shorter steps are needed");
    case PMR_BEYOND: return refuse(unit, "the extension has left its stroke and stop_travel beyond it");
    case PMR_STROKE:
        return refuse(unit, "luffing_start: the length of the luffing cylinder is needed within its stroke");
    case PMR_UPRIGHT:
        return refuse(unit, "foot, lug and pivot of the luffing cylinder come in line; without a cylinder, the boom has "
                            "swung by 90 degrees");
    default: return refuse(unit, "what drives the system is not finite");
    }
}

/* Paths may lie a little beyond their ends. */
static int check_paths(Unit *unit, const double *drivers)
{
    const double *ends = unit->ends, share = unit->limits[BEYOND_ENDS];
    int p;
    for (p = 0; p < unit->paths; p++) {
        const double low = ends[2 * p], high = ends[2 * p + 1], beyond = share * (high - low);
        char name[80];
        if (drivers[p] >= low - beyond && drivers[p] <= high + beyond) continue;
        name_of(unit, (unsigned)(DRIVEN + p), name, sizeof name);
        snprintf(unit->message, sizeof unit->message, "%s = %.9g m lies off the path: %.9g to %.9g m is allowed", name,
                 drivers[p], low, high);
        return 1;
    }
    return 0;
}

/* Give the kernel another length of a step, s, or rho_inf, if it has not got them already. */
static int adjust(Unit *unit, double step, double rho_inf)
{
    char why[PMR_MESSAGE];
    const pmr_settings *now = &unit->settings;
    if (now->step == step && now->rho_inf == rho_inf && now->levels == count_levels(unit->limits, step)) return 0;
    set_settings(unit, step, rho_inf);
    return pmr_state_adjust(unit->state, &unit->settings, why) ? refuse(unit, why) : 0;
}

/* Warn of outputs beyond their limits after the start or a step, once each. */
static void check_outputs(Unit *unit)
{
    char what[400], warning[440];
    int k;
    while ((k = pmr_watch(unit->state, &unit->watched)) >= 0) {
        line_of(unit, "limits", k, what, sizeof what);
        snprintf(warning, sizeof warning, "t = %.9g s: %s", unit->variables[TIME], what);
        unit->warn(unit->instance, warning);
    }
}

/* ---- start ---- */

/* Start the kernel as the parameters say, and read states and outputs; may be called again until `unit_start`. */
static int begin(Unit *unit)
{
    static const int kinds[] = {PMR_AT_REST, PMR_IN_EQUILIBRIUM, PMR_GIVEN};
    const double *u = unit->variables, *driven = u + DRIVEN;
    const int kind = (int)u[unit->at.start], r = unit->sizes.modes;
    double *z = unit->work, *v = z + r;
    char why[PMR_MESSAGE];
    int failed, k;
    if (!(u[unit->at.internal_step] > 0.0)) return refuse(unit, "internal_step: more than 0 s is allowed");
    if (!(u[unit->at.rho_inf] >= 0.0 && u[unit->at.rho_inf] <= 1.0)) return refuse(unit, "rho_inf: 0 to 1 is allowed");
    for (k = 0; k < 2 * unit->modes; k++)
        if (kind != 2 && unit->given[k] != 0.0) return refuse(unit, "modes were set, which start = 2 alone takes");
    if (check_paths(unit, driven) || adjust(unit, u[unit->at.internal_step], u[unit->at.rho_inf])) return 1;
    memset(z, 0, 2 * (size_t)r * sizeof(double));
    fill_modes(unit, unit->given, z);
    fill_modes(unit, unit->given + unit->modes, v);
    if (kind == 2 && pmr_check_start(unit->state, driven, driven + unit->drivers, z, v, why) == PMR_REFUSED)
        return refuse(unit, why);
    failed = unit->sizes.motions ? pmr_start_in_frame(unit->state, kinds[kind], driven, NULL, z, v)
             : kind == 1         ? pmr_start_moving(unit->state, kinds[kind], driven, driven + unit->drivers, z, v)
                                 : pmr_start(unit->state, kinds[kind], driven, z, v);
    if (failed && kind == 1 && failed != PMR_BLOCKED && failed != PMR_LOST && failed != PMR_UPRIGHT &&
        failed != PMR_STROKE)
        return refuse(unit, "no static start: nothing holds the body against the loads, or rows depend on each other");
    if (failed) return unit_failed(unit, failed);
    unit_changed(unit);
    unit->stands = 1;
    read_states(unit);
    return 0;
}

/* Length of the range of an input, or a turn; 0 of one that has neither. */
static double range_of(const Unit *unit, int n)
{
    const int kind = unit->kinds[n];
    if (kind == OTHER || only_starts(kind)) return 0.0;
    return kind == PATH ? unit->ends[2 * n + 1] - unit->ends[2 * n] : WHOLE_TURN;
}

int unit_start(Unit *unit)
{
    int k;
    if (begin(unit)) return 1;
    unit->started = 1;
    check_outputs(unit);
    memset(unit->off, 0, (size_t)unit->drivers * sizeof(double));
    for (k = 0; k < unit->drivers; k++) unit->rates[4 * unit->drivers + k] = COMPARED * range_of(unit, k);
    return 0;
}

/* While nothing has begun, states and outputs are those with which it would. */
int unit_prepare(Unit *unit) { return !unit->started && !unit->stands ? begin(unit) : 0; }

/* ---- steps ---- */

/* Warn of inputs before a step, once each. */
static void check_inputs(Unit *unit)
{
    const double *u = unit->variables + DRIVEN;
    int n;
    pmr_compare_rates(unit->drivers, unit->last, u, unit->rates);
    for (n = 0; n < unit->drivers; n++) {
        const double second = fabs(u[2 * unit->drivers + n]) + fabs(u[3 * unit->drivers + n]), off = unit->off[n];
        const double range = range_of(unit, n);
        const char *what = NULL;
        char name[80], warning[400];
        if (range > 0.0 && off > JUMP * range)
            what = "it jumps, which excites what no boom does: set it at the end of each step, in m or rad";
        else if (unit->sizes.motions && range > 0.0 && off > LEFT_OUT && second == 0.0 && unit->second[n] == 0.0)
            what =
                "it moves without a second rate, so the inertia of what moves is left out: set its rates of order one "
                "and two";
        else if (unit->rates[4 * unit->drivers + n] < 0.0)
            what = "its rates do not lead from one value to the next: set those of the same motion, in m/s or rad/s";
        if (what && !unit->warned[n]) {
            name_of(unit, (unsigned)(DRIVEN + n), name, sizeof name);
            snprintf(warning, sizeof warning, "%s: %s", name, what);
            unit->warn(unit->instance, warning);
            unit->warned[n] = 1;
        }
        unit->second[n] = second;
        unit->off[n] = 0.0;
    }
}

/* Drivers `since` the inputs `led` (4, N) were set; a start stays as it was. */
static void lead_drivers(Unit *unit, const double *led, double since)
{
    double *driven = unit->variables + DRIVEN;
    int k;
    pmr_lead_on(led, unit->drivers, since, 3, driven);
    for (k = 0; k < 2 * unit->drivers; k++)
        if (only_starts(unit->kinds[k % unit->drivers])) driven[k] = led[k];
}

int unit_advance(Unit *unit, double time, double duration)
{
    double *u = unit->variables, *driven = u + DRIVEN, *led = unit->work, step = u[unit->at.internal_step];
    const double count = ceil(duration / step * (1.0 - 1e-9));
    const int n = unit->drivers;
    int failed, k;
    u[TIME] = time;
    if (!unit->started) return refuse(unit, "a step comes after the initialisation");
    if (!(duration >= 0.0)) return refuse(unit, "a communication step of 0 s or more is allowed");
    if (duration == 0.0) return 0;
    if (!(count < 1e9)) return refuse(unit, "a communication step of less than 1e9 internal steps is allowed");
    check_inputs(unit);
    if (!(fabs(duration / count - step) <= 1e-9 * step))
        step = duration / count; /* else it is round-off of the times */
    if (unit->estimator && !(fabs(step - unit->estimator_step) <= 1e-9 * step)) {
        snprintf(unit->message, sizeof unit->message, "the observer's step of %.9g s, or a multiple of it, is allowed",
                 unit->estimator_step);
        return 1;
    }
    if (adjust(unit, step, u[unit->at.rho_inf]) || check_paths(unit, driven)) return 1;
    memcpy(led, driven, 4 * (size_t)n * sizeof(double));
    for (k = 0; k < (int)count; k++) {
        const double since = k * step;
        lead_drivers(unit, led, since + step);
        unit_changed(unit);
        if (check_paths(unit, driven)) return 1;
        failed = unit->estimator ? estimator_prepare(unit, driven) : 0;
        if (!failed) failed = pmr_step_led(unit->state, led, since);
        if (!failed && unit->estimator) failed = estimator_take(unit, driven, k == (int)count - 1);
        if (failed) return unit_failed(unit, failed);
        u[TIME] = time + (k + 1) * step;
        check_outputs(unit);
    }
    unit->last = duration;
    unit->stands = 1;
    read_states(unit);
    return 0;
}

/* ---- saved states ---- */

typedef struct {
    char magic[8];
    uint64_t checksum; /* of what follows */
    char token[48];
    int64_t started, stands;
    double step, rho_inf;
} Head;

size_t unit_bytes(const Unit *unit)
{
    return sizeof(Head) + (unit->at.states + 2 * (size_t)unit->modes) * sizeof(double) + estimator_bytes(unit) +
           pmr_state_bytes(unit->state);
}

/* The model's token, filled up with zeros. */
static void name_model(const Unit *unit, char token[48])
{
    memset(token, 0, 48);
    line_of(unit, "token", 0, token, 48);
}

int unit_save(Unit *unit, void **state)
{
    Head head = {.started = unit->started, .stands = unit->stands};
    const size_t own = unit->at.states * sizeof(double), given = 2 * (size_t)unit->modes * sizeof(double);
    char *at;
    if (!*state && !(*state = malloc(unit_bytes(unit)))) return refuse(unit, "no memory is left");
    memcpy(head.magic, "PMRUNIT2", 8);
    name_model(unit, head.token);
    head.step = unit->settings.step;
    head.rho_inf = unit->settings.rho_inf;
    at = *state;
    memcpy(at + sizeof head, unit->variables, own);
    memcpy(at + sizeof head + own, unit->given, given);
    estimator_save(unit, at + sizeof head + own + given);
    pmr_state_save(unit->state, at + sizeof head + own + given + estimator_bytes(unit));
    memcpy(at, &head, sizeof head);
    head.checksum = pmr_checksum(at + 16, unit_bytes(unit) - 16);
    memcpy(at, &head, sizeof head);
    return 0;
}

int unit_is_state(Unit *unit, const void *bytes, size_t count)
{
    Head head;
    char token[48];
    name_model(unit, token);
    if (bytes && count == unit_bytes(unit)) {
        memcpy(&head, bytes, sizeof head);
        if (!memcmp(head.magic, "PMRUNIT2", 8) && !memcmp(head.token, token, 48) &&
            head.checksum == pmr_checksum((const char *)bytes + 16, count - 16))
            return 1;
    }
    refuse(unit, "the bytes are no state of this model, or a damaged one");
    return 0;
}

int unit_restore(Unit *unit, const void *state)
{
    const size_t own = unit->at.states * sizeof(double), given = 2 * (size_t)unit->modes * sizeof(double);
    const char *at = state, *of_kernel = at + sizeof(Head) + own + given + estimator_bytes(unit);
    char why[PMR_MESSAGE] = "the state can't be taken up";
    Head head;
    memcpy(&head, at, sizeof head);
    if (adjust(unit, head.step, head.rho_inf)) return 1;
    memcpy(unit->variables, at + sizeof head, own);
    memcpy(unit->given, at + sizeof head + own, given);
    memset(unit->off, 0, (size_t)unit->drivers * sizeof(double));
    memset(unit->rates + unit->drivers, 0, (size_t)unit->drivers * sizeof(double)); /* steps before count no more */
    unit_changed(unit);
    unit->started = (int)head.started;
    estimator_restore(unit, at + sizeof head + own + given);
    if (!unit->started) return 0;
    if (pmr_state_restore(unit->state, of_kernel, pmr_state_bytes(unit->state), why)) return refuse(unit, why);
    unit->stands = (int)head.stands;
    read_states(unit);
    return 0;
}
