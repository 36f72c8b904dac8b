/* The unit behind the C interface of FMI 3.0. */
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "unit.h"

typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*Logger)(void *environment, fmi3Status status, const char *category, const char *message);
typedef uint32_t Reference;

typedef struct {
    Unit *unit;
    void *environment;
    Logger logger;
} Instance;

static fmi3Status status_of(Instance *instance, int failed)
{
    if (failed && instance->logger)
        instance->logger(instance->environment, fmi3Error, "logStatusError", instance->unit->message);
    if (!failed && instance->unit->warning[0] && instance->logger)
        instance->logger(instance->environment, fmi3Warning, "logStatusWarning", instance->unit->warning);
    instance->unit->warning[0] = 0;
    return failed ? fmi3Error : fmi3OK;
}

static fmi3Status refused(Instance *instance, const char *why)
{
    return status_of(instance, refuse(instance->unit, why));
}

static Instance *instance_of(const char *token, const char *resources, int model_exchange, void *environment,
                             Logger logger)
{
    char why[400] = "no memory is left";
    Instance *instance = calloc(1, sizeof *instance);
    if (instance) instance->unit = unit_open(token, resources, model_exchange, why);
    if (!instance || !instance->unit) {
        if (logger) logger(environment, fmi3Error, "logStatusError", why);
        free(instance);
        return NULL;
    }
    instance->environment = environment;
    instance->logger = logger;
    return instance;
}

static fmi3Status time_is(Instance *instance, double time)
{
    instance->unit->variables[TIME] = time;
    return fmi3OK;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

EXPORT fmi3Status fmi3SetDebugLogging(void *c, bool on, size_t count, const char *const categories[])
{
    (void)c, (void)on, (void)count,
        (void)categories; /* errors and warnings are logged, and there is nothing else to log */
    return fmi3OK;
}

EXPORT void *fmi3InstantiateModelExchange(const char *name, const char *token, const char *resources, bool visible,
                                          bool logging, void *environment, Logger logger)
{
    (void)name, (void)visible, (void)logging;
    return instance_of(token, resources, 1, environment, logger);
}

EXPORT void *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible,
                                         bool logging, bool event_mode, bool early_return,
                                         const Reference *intermediate, size_t intermediate_count, void *environment,
                                         Logger logger, void *intermediate_update)
{
    (void)name, (void)visible, (void)logging, (void)event_mode, (void)early_return;
    (void)intermediate, (void)intermediate_count, (void)intermediate_update;
    return instance_of(token, resources, 0, environment, logger);
}

EXPORT void *fmi3InstantiateScheduledExecution(const char *name, const char *token, const char *resources, bool visible,
                                               bool logging, void *environment, Logger logger, void *clock_update,
                                               void *lock, void *unlock)
{
    (void)name, (void)token, (void)resources, (void)visible, (void)logging, (void)clock_update, (void)lock,
        (void)unlock;
    if (logger) logger(environment, fmi3Error, "logStatusError", "Co-Simulation and Model Exchange are allowed");
    return NULL;
}

EXPORT void fmi3FreeInstance(void *c)
{
    Instance *instance = c;
    if (!instance) return;
    unit_close(instance->unit);
    free(instance);
}

EXPORT fmi3Status fmi3EnterInitializationMode(void *c, bool tolerance_defined, double tolerance, double start,
                                              bool stop_defined, double stop)
{
    Instance *instance = c;
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (instance->unit->started) return refused(instance, "initialisation is over: fmi3Reset first");
    return time_is(instance, start);
}

EXPORT fmi3Status fmi3ExitInitializationMode(void *c) { return status_of(c, unit_start(((Instance *)c)->unit)); }

/* Modes between which nothing happens: all is continuous, and no event is ever indicated. */
#define NOTHING_HAPPENS(NAME)                                                                                          \
    EXPORT fmi3Status fmi3##NAME(void *c)                                                                              \
    {                                                                                                                  \
        (void)c;                                                                                                       \
        return fmi3OK;                                                                                                 \
    }
NOTHING_HAPPENS(EnterEventMode)
NOTHING_HAPPENS(Terminate)
NOTHING_HAPPENS(EnterConfigurationMode)
NOTHING_HAPPENS(ExitConfigurationMode)
NOTHING_HAPPENS(EvaluateDiscreteStates)
NOTHING_HAPPENS(EnterContinuousTimeMode)
NOTHING_HAPPENS(EnterStepMode)

EXPORT fmi3Status fmi3Reset(void *c) { return status_of(c, unit_reset(((Instance *)c)->unit)); }

EXPORT fmi3Status fmi3GetFloat64(void *c, const Reference *references, size_t count, double *values, size_t size)
{
    if (size != count) return refused(c, "all variables are scalars");
    return status_of(c, get_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT fmi3Status fmi3SetFloat64(void *c, const Reference *references, size_t count, const double *values, size_t size)
{
    if (size != count) return refused(c, "all variables are scalars");
    return status_of(c, set_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT fmi3Status fmi3GetInt64(void *c, const Reference *references, size_t count, int64_t *values, size_t size)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        if (references[n] != instance->unit->at.start || size != count)
            return refused(instance, "the only integer is the kind of start");
        values[n] = (int64_t)instance->unit->variables[instance->unit->at.start];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetInt64(void *c, const Reference *references, size_t count, const int64_t *values, size_t size)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        double value = (double)values[n];
        if (references[n] != instance->unit->at.start || size != count || values[n] < 0 || values[n] > 2)
            return refused(instance, "the only integer is the kind of start: 0 at rest, 1 static, 2 as given");
        if (set_variables(instance->unit, references + n, 1, &value)) return status_of(instance, 1);
    }
    return fmi3OK;
}

#define NO_VARIABLES_OF(KIND, VALUE)                                                                                   \
    EXPORT fmi3Status fmi3Get##KIND(void *c, const Reference *references, size_t count, VALUE *values, size_t size)    \
    {                                                                                                                  \
        (void)references, (void)values, (void)size;                                                                    \
        return count ? refused(c, "there are no variables of this type") : fmi3OK;                                     \
    }                                                                                                                  \
    EXPORT fmi3Status fmi3Set##KIND(void *c, const Reference *references, size_t count, const VALUE *values,           \
                                    size_t size)                                                                       \
    {                                                                                                                  \
        (void)references, (void)values, (void)size;                                                                    \
        return count ? refused(c, "there are no variables of this type") : fmi3OK;                                     \
    }
NO_VARIABLES_OF(Float32, float)
NO_VARIABLES_OF(Int8, int8_t)
NO_VARIABLES_OF(UInt8, uint8_t)
NO_VARIABLES_OF(Int16, int16_t)
NO_VARIABLES_OF(UInt16, uint16_t)
NO_VARIABLES_OF(Int32, int32_t)
NO_VARIABLES_OF(UInt32, uint32_t)
NO_VARIABLES_OF(UInt64, uint64_t)
NO_VARIABLES_OF(Boolean, bool)
NO_VARIABLES_OF(String, char *)

EXPORT fmi3Status fmi3GetBinary(void *c, const Reference *references, size_t count, size_t *sizes,
                                const uint8_t **values, size_t size)
{
    (void)references, (void)sizes, (void)values, (void)size;
    return count ? refused(c, "there are no variables of this type") : fmi3OK;
}

EXPORT fmi3Status fmi3SetBinary(void *c, const Reference *references, size_t count, const size_t *sizes,
                                const uint8_t *const *values, size_t size)
{
    (void)references, (void)sizes, (void)values, (void)size;
    return count ? refused(c, "there are no variables of this type") : fmi3OK;
}

EXPORT fmi3Status fmi3GetClock(void *c, const Reference *references, size_t count, bool *values)
{
    (void)references, (void)values;
    return count ? refused(c, "there are no clocks") : fmi3OK;
}

EXPORT fmi3Status fmi3SetClock(void *c, const Reference *references, size_t count, const bool *values)
{
    (void)references, (void)values;
    return count ? refused(c, "there are no clocks") : fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfVariableDependencies(void *c, Reference reference, size_t *count)
{
    (void)reference, (void)count;
    return refused(c, "the model description has the dependencies");
}

EXPORT fmi3Status fmi3GetVariableDependencies(void *c, Reference dependent, size_t *elements, Reference *independents,
                                              size_t *of_independents, int *kinds, size_t count)
{
    (void)dependent, (void)elements, (void)independents, (void)of_independents, (void)kinds, (void)count;
    return refused(c, "the model description has the dependencies");
}

EXPORT fmi3Status fmi3GetFMUState(void *c, void **state)
{
    Instance *instance = c;
    return status_of(instance, unit_save(instance->unit, state));
}

EXPORT fmi3Status fmi3SetFMUState(void *c, void *state)
{
    Instance *instance = c;
    if (!state) return refused(instance, "there is no state to return to");
    return status_of(instance, unit_restore(instance->unit, state));
}

EXPORT fmi3Status fmi3FreeFMUState(void *c, void **state)
{
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(void *c, void *state, size_t *size)
{
    (void)state;
    *size = unit_bytes(((Instance *)c)->unit);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(void *c, void *state, uint8_t *bytes, size_t size)
{
    Instance *instance = c;
    if (!state || size < unit_bytes(instance->unit)) return refused(instance, "bytes are too few for a state");
    memcpy(bytes, state, unit_bytes(instance->unit));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(void *c, const uint8_t *bytes, size_t size, void **state)
{
    Instance *instance = c;
    *state = NULL;
    if (!unit_is_state(instance->unit, bytes, size)) return status_of(instance, 1);
    *state = malloc(size);
    if (!*state) return refused(instance, "no memory is left");
    memcpy(*state, bytes, size);
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetDirectionalDerivative(void *c, const Reference *unknowns, size_t unknown_count,
                                               const Reference *knowns, size_t known_count, const double *seed,
                                               size_t seed_size, double *answer, size_t answer_size)
{
    if (seed_size != known_count || answer_size != unknown_count) return refused(c, "all variables are scalars");
    return status_of(c,
                     differentiate(((Instance *)c)->unit, unknowns, unknown_count, knowns, known_count, seed, answer));
}

EXPORT fmi3Status fmi3GetAdjointDerivative(void *c, const Reference *unknowns, size_t unknown_count,
                                           const Reference *knowns, size_t known_count, const double *seed,
                                           size_t seed_size, double *answer, size_t answer_size)
{
    (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count;
    (void)seed, (void)seed_size, (void)answer, (void)answer_size;
    return refused(c, "directional derivatives are provided, adjoint ones are not");
}

/* Clocks: there are none. */
#define NO_CLOCKS_1(NAME, TYPE_0)                                                                                      \
    EXPORT fmi3Status fmi3##NAME(void *c, const Reference *references, size_t count, TYPE_0 *value_0)                  \
    {                                                                                                                  \
        (void)references, (void)value_0;                                                                               \
        return count ? refused(c, "there are no clocks") : fmi3OK;                                                     \
    }
#define NO_CLOCKS_2(NAME, TYPE_0, TYPE_1)                                                                              \
    EXPORT fmi3Status fmi3##NAME(void *c, const Reference *references, size_t count, TYPE_0 *value_0, TYPE_1 *value_1) \
    {                                                                                                                  \
        (void)references, (void)value_0, (void)value_1;                                                                \
        return count ? refused(c, "there are no clocks") : fmi3OK;                                                     \
    }
#define NO_CLOCKS_3(NAME, TYPE_0, TYPE_1, TYPE_2)                                                                      \
    EXPORT fmi3Status fmi3##NAME(void *c, const Reference *references, size_t count, TYPE_0 *value_0, TYPE_1 *value_1, \
                                 TYPE_2 *value_2)                                                                      \
    {                                                                                                                  \
        (void)references, (void)value_0, (void)value_1, (void)value_2;                                                 \
        return count ? refused(c, "there are no clocks") : fmi3OK;                                                     \
    }
NO_CLOCKS_3(GetIntervalFraction, uint64_t, uint64_t, int)
NO_CLOCKS_2(GetIntervalDecimal, double, int)
NO_CLOCKS_2(GetShiftFraction, uint64_t, uint64_t)
NO_CLOCKS_2(SetIntervalFraction, const uint64_t, const uint64_t)
NO_CLOCKS_2(SetShiftFraction, const uint64_t, const uint64_t)
NO_CLOCKS_1(GetShiftDecimal, double)
NO_CLOCKS_1(SetIntervalDecimal, const double)
NO_CLOCKS_1(SetShiftDecimal, const double)

EXPORT fmi3Status fmi3UpdateDiscreteStates(void *c, bool *again, bool *terminate, bool *nominals_changed,
                                           bool *values_changed, bool *next_event_defined, double *next_event)
{
    (void)c;
    *again = *terminate = *nominals_changed = *values_changed = *next_event_defined = false;
    *next_event = 0.0;
    return fmi3OK;
}

/* Model Exchange */

EXPORT fmi3Status fmi3CompletedIntegratorStep(void *c, bool no_return, bool *enter_event_mode, bool *terminate)
{
    (void)c, (void)no_return;
    *enter_event_mode = *terminate = false;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetTime(void *c, double time) { return time_is(c, time); }

EXPORT fmi3Status fmi3SetContinuousStates(void *c, const double *states, size_t count)
{
    return status_of(c, set_states(((Instance *)c)->unit, states, count));
}

EXPORT fmi3Status fmi3GetContinuousStateDerivatives(void *c, double *derivatives, size_t count)
{
    return status_of(c, get_derivatives(((Instance *)c)->unit, derivatives, count));
}

EXPORT fmi3Status fmi3GetEventIndicators(void *c, double *indicators, size_t count)
{
    (void)indicators;
    return count ? refused(c, "there are no event indicators") : fmi3OK;
}

EXPORT fmi3Status fmi3GetContinuousStates(void *c, double *states, size_t count)
{
    return status_of(c, get_states(((Instance *)c)->unit, states, count));
}

EXPORT fmi3Status fmi3GetNominalsOfContinuousStates(void *c, double *nominals, size_t count)
{
    return status_of(c, get_nominals(((Instance *)c)->unit, nominals, count));
}

EXPORT fmi3Status fmi3GetNumberOfEventIndicators(void *c, size_t *count)
{
    (void)c;
    *count = 0;
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetNumberOfContinuousStates(void *c, size_t *count)
{
    *count = 2 * (size_t)((Instance *)c)->unit->modes;
    return fmi3OK;
}

/* Co-Simulation */

EXPORT fmi3Status fmi3GetOutputDerivatives(void *c, const Reference *references, size_t count, const int32_t *orders,
                                           double *values, size_t size)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        Reference rate = references[n] + instance->unit->outputs;
        if (orders[n] != 1 || references[n] < instance->unit->at.outputs || references[n] >= instance->unit->at.rates ||
            size != count)
            return refused(instance, "first derivatives of displacements are known");
        if (get_variables(instance->unit, &rate, 1, values + n)) return status_of(instance, 1);
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(void *c, double time, double step, bool no_return, bool *event_needed, bool *terminate,
                             bool *early_return, double *last_time)
{
    Instance *instance = c;
    fmi3Status status;
    (void)no_return;
    status = status_of(instance, unit_advance(instance->unit, time, step));
    *event_needed = *terminate = *early_return = false;
    *last_time = instance->unit->variables[TIME];
    return status;
}

EXPORT fmi3Status fmi3ActivateModelPartition(void *c, Reference clock, double time)
{
    (void)clock, (void)time;
    return refused(c, "there are no clocks");
}
