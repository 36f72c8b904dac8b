#include "variables.h"
#include "drive.h"

#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum { TAG = 64, SUM = 8 }; /* bytes before a serialised state: a tag, at the end of which a checksum stands */

/* FNV-1a of the tag and the state, which any damage within eight bytes changes for certain, and other damage but for 2^-64. */
static uint64_t checksum(const unsigned char *bytes)
{
    uint64_t sum = UINT64_C(14695981039346656037);
    size_t n;
    for (n = 0; n < TAG + sizeof(Memory); n++)
        if (n < TAG - SUM || n >= TAG) sum = (sum ^ bytes[n]) * UINT64_C(1099511628211);
    return sum;
}

static int refuse(Body *body, const char *what, unsigned reference)
{
    snprintf(body->message, sizeof body->message, "value reference %u: %s", reference, what);
    return 1;
}

/* While nothing has begun, states and outputs are those with which it would. */
static int prepared(Body *body) { return !body->memory.started && !body->fresh ? body_start(body) : 0; }

int get_variables(Body *body, const unsigned *references, size_t count, double *values)
{
    size_t n;
    for (n = 0; n < count; n++) {
        unsigned reference = references[n];
        if (reference >= VARIABLES) return refuse(body, "no such variable", reference);
        if (reference >= STATES) {
            if (prepared(body)) return 1;
            if (reference >= VELOCITIES && reference < FORCES ? body_velocities(body)
                                                              : reference >= DERIVATIVES && body_evaluate(body))
                return 1;
        }
        values[n] = body->memory.variables[reference];
    }
    return 0;
}

/* Why a variable can't have a value, or NULL. */
static const char *impossible(unsigned reference, double value)
{
    if (!isfinite(value)) return "a finite number is allowed";
#if FRAME
    {
        int k;
        for (k = 0; k < ANGLES; k++) /* slewing goes on and on */
            if (k != 1 && angle_drivers[k] >= 0 && reference == (unsigned)(DRIVEN + angle_drivers[k]) && fabs(value) > WHOLE_TURN)
                return "an angle of at most one turn is allowed, in rad";
    }
#endif
    (void)reference;
    return NULL;
}

int set_variables(Body *body, const unsigned *references, size_t count, const double *values)
{
    const char *why;
    size_t n;
    for (n = 0; n < count; n++) {
        unsigned reference = references[n];
        int is_parameter = reference == INTERNAL_STEP || reference == RHO_INF || reference == START;
        int is_state = reference >= STATES && reference < DERIVATIVES;
        if (reference == TIME || reference >= DERIVATIVES) return refuse(body, "it can be read only", reference);
        if ((is_parameter || is_state) && body->memory.started)
            return refuse(body, "parameters and states are fixed once the start is made", reference);
        if ((why = impossible(reference, values[n]))) return refuse(body, why, reference);
        if (reference >= DRIVEN && reference < DRIVEN + DRIVERS) {
            double *off = body->off + (reference - DRIVEN);
            *off = fmax(*off, fabs(values[n] - body->memory.variables[reference]));
        }
        if (is_state)
            body->memory.given[reference - STATES] = values[n];
        else
            body->memory.variables[reference] = values[n];
    }
    body_changed(body);
    return 0;
}

int get_states(Body *body, double *states, size_t count)
{
    if (count != 2 * MODES) return refuse(body, "number of states", (unsigned)count);
    if (prepared(body)) return 1;
    memcpy(states, body->memory.variables + STATES, count * sizeof(double));
    return 0;
}

int set_states(Body *body, const double *states, size_t count)
{
    if (count != 2 * MODES) return refuse(body, "number of states", (unsigned)count);
    memcpy(body->memory.variables + STATES, states, count * sizeof(double));
    body_changed(body);
    return 0;
}

int get_derivatives(Body *body, double *derivatives, size_t count)
{
    if (count != 2 * MODES) return refuse(body, "number of states", (unsigned)count);
    if (body_evaluate(body)) return 1;
    memcpy(derivatives, body->memory.variables + DERIVATIVES, count * sizeof(double));
    return 0;
}

int set_time(Body *body, double time)
{
    body->memory.variables[TIME] = time;
    return 0;
}

int differentiate(Body *body, const unsigned *unknowns, size_t unknown_count, const unsigned *knowns,
                  size_t known_count, const double *seed, double *answer)
{
    double of[VARIABLES] = {0.0}, found[VARIABLES] = {0.0};
    size_t n;
    for (n = 0; n < known_count; n++) {
        int is_input = knowns[n] >= DRIVEN && knowns[n] < INTERNAL_STEP;
        if (!is_input && !(knowns[n] >= STATES && knowns[n] < DERIVATIVES))
            return refuse(body, "derivatives with respect to states and inputs are known", knowns[n]);
        of[knowns[n]] += seed[n];
    }
    for (n = 0; n < unknown_count; n++)
        if (unknowns[n] < DERIVATIVES || unknowns[n] >= VARIABLES)
            return refuse(body, "derivatives of outputs and of the states' rates are known", unknowns[n]);
    if (prepared(body) || body_differentiate(body, of, found)) return 1;
    for (n = 0; n < unknown_count; n++) answer[n] = found[unknowns[n]];
    return 0;
}

int finish_initialisation(Body *body)
{
    if (body_start(body)) return 1;
    body->memory.started = 1;
    memset(body->off, 0, sizeof body->off);
    return 0;
}

Memory *saved(const Body *body)
{
    Memory *memory = malloc(sizeof *memory);
    if (memory) *memory = body->memory;
    return memory;
}

void restore(Body *body, const Memory *memory)
{
    body->memory = *memory;
    body->place.known = 0;
    memset(body->off, 0, sizeof body->off);
    body_changed(body);
}

size_t serialized_size(void) { return TAG + sizeof(Memory); }

int serialize(Body *body, const Memory *memory, void *bytes, size_t size)
{
    char *target = bytes;
    uint64_t sum;
    if (!memory || size < serialized_size()) return refuse(body, "bytes are too few for a state", (unsigned)size);
    memset(target, 0, TAG);
    snprintf(target, TAG - SUM, "%s", model_token);
    memcpy(target + TAG, memory, sizeof *memory);
    sum = checksum(bytes);
    memcpy(target + TAG - SUM, &sum, SUM);
    return 0;
}

Memory *deserialized(Body *body, const void *bytes, size_t size)
{
    const char *source = bytes;
    Memory *memory;
    uint64_t sum = 0;
    if (bytes && size == serialized_size()) memcpy(&sum, source + TAG - SUM, SUM);
    if (!bytes || size != serialized_size() || strncmp(source, model_token, TAG - SUM - 1) != 0 || sum != checksum(bytes)) {
        snprintf(body->message, sizeof body->message, "the bytes are no state of this model, or a damaged one");
        return NULL;
    }
    memory = malloc(sizeof *memory);
    if (memory) memcpy(memory, source + TAG, sizeof *memory);
    return memory;
}

int same_text(const char *a, const char *b) { return a && b && strcmp(a, b) == 0; }
