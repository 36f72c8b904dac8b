/* Functions of the C interface that FMI 2.0 and 3.0 have alike, for a file that defines

       FMI(name), FMU_STATE(verb)   names of its functions, with fmi2 or fmi3 before them
       Status, OK, WARNING, ERROR   what they return
       Flag                         the type of a truth value
       Byte, Whole                  the types of a saved state's bytes, and of whole numbers
       SIZE, OF_SIZE                a parameter behind arrays of values, how many there are, and that it is not used
       STATE_SIZE, DESERIALIZE, DERIVATIVES  names that differ
       Instance, tell               an instance, with its `unit`, and what writes a message to its log */
#include <stdlib.h>
#include <string.h>

/* The status of a call that failed or not, with the reason for the master's log. */
static Status status_of(Instance *instance, int failed)
{
    if (failed) tell(instance, ERROR, "logStatusError", instance->unit->message);
    return failed ? ERROR : OK;
}

static void warn(void *instance, const char *warning) { tell(instance, WARNING, "logStatusWarning", warning); }

/* Log the warnings of an instance's unit. */
static void log_warnings(Instance *instance)
{
    instance->unit->warn = warn;
    instance->unit->instance = instance;
}

static Status refused(Instance *instance, const char *why)
{
    return status_of(instance, refuse(instance->unit, why));
}

EXPORT Status FMI(SetDebugLogging)(void *c, Flag on, size_t count, const char *const categories[])
{
    (void)c, (void)on, (void)count, (void)categories; /* there is nothing to log but errors and warnings */
    return OK;
}

EXPORT void FMI(FreeInstance)(void *c)
{
    Instance *instance = c;
    if (!instance) return;
    unit_close(instance->unit);
    free(instance);
}

EXPORT Status FMI(SetTime)(void *c, double time)
{
    ((Instance *)c)->unit->variables[TIME] = time;
    return OK;
}

EXPORT Status FMI(ExitInitializationMode)(void *c) { return status_of(c, unit_start(((Instance *)c)->unit)); }

EXPORT Status FMI(Reset)(void *c) { return status_of(c, unit_reset(((Instance *)c)->unit)); }

/* Modes between which nothing happens: all is continuous, and no event is ever indicated. */
#define NOTHING_HAPPENS(NAME)                                                                                          \
    EXPORT Status FMI(NAME)(void *c)                                                                                   \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        return OK;                                                                                                     \
    }
NOTHING_HAPPENS(Terminate)
NOTHING_HAPPENS(EnterEventMode)
NOTHING_HAPPENS(EnterContinuousTimeMode)

/* ---- variables ---- */

/* Whole numbers: the kind of start is the only one. */
static Status get_start(Instance *instance, const Reference *references, size_t count, Whole *values)
{
    size_t n;
    for (n = 0; n < count; n++) {
        if (references[n] != instance->unit->at.start)
            return refused(instance, "the only integer is the kind of start");
        values[n] = (Whole)instance->unit->variables[instance->unit->at.start];
    }
    return OK;
}

static Status set_start(Instance *instance, const Reference *references, size_t count, const Whole *values)
{
    size_t n;
    for (n = 0; n < count; n++) {
        double value = (double)values[n];
        if (references[n] != instance->unit->at.start || values[n] < 0 || values[n] > 2)
            return refused(instance, "the only integer is the kind of start: 0 at rest, 1 static, 2 as given");
        if (set_variables(instance->unit, references + n, 1, &value)) return status_of(instance, 1);
    }
    return OK;
}

#define NO_VARIABLES_OF(KIND, VALUE)                                                                                   \
    EXPORT Status FMI(Get##KIND)(void *c, const Reference *references, size_t count, VALUE *values SIZE)               \
    {                                                                                                                  \
        (void)references, (void)values, OF_SIZE;                                                                 \
        return count ? refused(c, "there are no variables of this type") : OK;                                         \
    }                                                                                                                  \
    EXPORT Status FMI(Set##KIND)(void *c, const Reference *references, size_t count, const VALUE *values SIZE)         \
    {                                                                                                                  \
        (void)references, (void)values, OF_SIZE;                                                                 \
        return count ? refused(c, "there are no variables of this type") : OK;                                         \
    }
NO_VARIABLES_OF(Boolean, Flag)
NO_VARIABLES_OF(String, char *)

static Status get_output_rates(Instance *instance, const Reference *references, size_t count, const int32_t *orders,
                               double *values)
{
    size_t n;
    for (n = 0; n < count; n++) {
        Reference rate = references[n] + instance->unit->outputs;
        if (orders[n] != 1 || references[n] < instance->unit->at.outputs || references[n] >= instance->unit->at.rates)
            return refused(instance, "first derivatives of displacements are known");
        if (get_variables(instance->unit, &rate, 1, values + n)) return status_of(instance, 1);
    }
    return OK;
}

/* ---- saved states ---- */

EXPORT Status FMU_STATE(Get)(void *c, void **state) { return status_of(c, unit_save(((Instance *)c)->unit, state)); }

EXPORT Status FMU_STATE(Set)(void *c, void *state)
{
    if (!state) return refused(c, "there is no state to return to");
    return status_of(c, unit_restore(((Instance *)c)->unit, state));
}

EXPORT Status FMU_STATE(Free)(void *c, void **state)
{
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return OK;
}

EXPORT Status STATE_SIZE(void *c, void *state, size_t *size)
{
    (void)state;
    *size = unit_bytes(((Instance *)c)->unit);
    return OK;
}

EXPORT Status FMU_STATE(Serialize)(void *c, void *state, Byte *bytes, size_t size)
{
    Instance *instance = c;
    if (!state || size < unit_bytes(instance->unit)) return refused(instance, "bytes are too few for a state");
    memcpy(bytes, state, unit_bytes(instance->unit));
    return OK;
}

EXPORT Status FMU_STATE(DESERIALIZE)(void *c, const Byte *bytes, size_t size, void **state)
{
    Instance *instance = c;
    *state = NULL;
    if (!unit_is_state(instance->unit, bytes, size)) return status_of(instance, 1);
    *state = malloc(size);
    if (!*state) return refused(instance, "no memory is left");
    memcpy(*state, bytes, size);
    return OK;
}

/* ---- Model Exchange ---- */

EXPORT Status FMI(CompletedIntegratorStep)(void *c, Flag no_return, Flag *enter_event_mode, Flag *terminate)
{
    (void)c, (void)no_return;
    *enter_event_mode = *terminate = 0;
    return OK;
}

EXPORT Status FMI(SetContinuousStates)(void *c, const double *states, size_t count)
{
    return status_of(c, set_states(((Instance *)c)->unit, states, count));
}

EXPORT Status FMI(GetContinuousStates)(void *c, double *states, size_t count)
{
    return status_of(c, get_states(((Instance *)c)->unit, states, count));
}

EXPORT Status DERIVATIVES(void *c, double *derivatives, size_t count)
{
    return status_of(c, get_derivatives(((Instance *)c)->unit, derivatives, count));
}

EXPORT Status FMI(GetNominalsOfContinuousStates)(void *c, double *nominals, size_t count)
{
    return status_of(c, get_nominals(((Instance *)c)->unit, nominals, count));
}

EXPORT Status FMI(GetEventIndicators)(void *c, double *indicators, size_t count)
{
    (void)indicators;
    return count ? refused(c, "there are no event indicators") : OK;
}
