/* The unit behind the C interface of FMI 3.0. */
#include <stdbool.h>
#include <stdint.h>

#include "unit.h"

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL } Status;
typedef void (*Logger)(void *environment, Status status, const char *category, const char *message);
typedef uint32_t Reference;
typedef bool Flag;
typedef int64_t Whole;
typedef uint8_t Byte;

typedef struct {
    Unit *unit;
    void *environment;
    Logger logger;
} Instance;

static void tell(const Instance *instance, Status status, const char *category, const char *message)
{
    if (instance->logger) instance->logger(instance->environment, status, category, message);
}

#define FMI(name) fmi3##name
#define FMU_STATE_OF(verb) fmi3##verb##FMUState
#define FMU_STATE(verb) FMU_STATE_OF(verb)
#define STATE_SIZE fmi3SerializedFMUStateSize
#define DESERIALIZE Deserialize
#define DERIVATIVES fmi3GetContinuousStateDerivatives
#define SIZE , size_t size
#define OF_SIZE (void)size
#include "versions.h"

static Instance *instance_of(const char *token, const char *resources, int model_exchange, void *environment,
                             Logger logger)
{
    char why[400] = "no memory is left";
    Instance *instance = calloc(1, sizeof *instance);
    if (instance) instance->unit = unit_open(token, resources, model_exchange, why);
    if (!instance || !instance->unit) {
        if (logger) logger(environment, ERROR, "logStatusError", why);
        free(instance);
        return NULL;
    }
    instance->environment = environment;
    instance->logger = logger;
    log_warnings(instance);
    return instance;
}

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }

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
    if (logger) logger(environment, ERROR, "logStatusError", "Co-Simulation and Model Exchange are allowed");
    return NULL;
}

EXPORT Status fmi3EnterInitializationMode(void *c, bool tolerance_defined, double tolerance, double start,
                                              bool stop_defined, double stop)
{
    Instance *instance = c;
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    if (instance->unit->started) return refused(instance, "initialisation is over: fmi3Reset first");
    return fmi3SetTime(c, start);
}

NOTHING_HAPPENS(EnterConfigurationMode)
NOTHING_HAPPENS(ExitConfigurationMode)
NOTHING_HAPPENS(EvaluateDiscreteStates)
NOTHING_HAPPENS(EnterStepMode)

EXPORT Status fmi3GetFloat64(void *c, const Reference *references, size_t count, double *values, size_t size)
{
    if (size != count) return refused(c, "all variables are scalars");
    return status_of(c, get_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT Status fmi3SetFloat64(void *c, const Reference *references, size_t count, const double *values, size_t size)
{
    if (size != count) return refused(c, "all variables are scalars");
    return status_of(c, set_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT Status fmi3GetInt64(void *c, const Reference *references, size_t count, int64_t *values, size_t size)
{
    return size == count ? get_start(c, references, count, values) : refused(c, "all variables are scalars");
}

EXPORT Status fmi3SetInt64(void *c, const Reference *references, size_t count, const int64_t *values, size_t size)
{
    return size == count ? set_start(c, references, count, values) : refused(c, "all variables are scalars");
}

NO_VARIABLES_OF(Float32, float)
NO_VARIABLES_OF(Int8, int8_t)
NO_VARIABLES_OF(UInt8, uint8_t)
NO_VARIABLES_OF(Int16, int16_t)
NO_VARIABLES_OF(UInt16, uint16_t)
NO_VARIABLES_OF(Int32, int32_t)
NO_VARIABLES_OF(UInt32, uint32_t)
NO_VARIABLES_OF(UInt64, uint64_t)

EXPORT Status fmi3GetBinary(void *c, const Reference *references, size_t count, size_t *sizes,
                                const uint8_t **values, size_t size)
{
    (void)references, (void)sizes, (void)values, (void)size;
    return count ? refused(c, "there are no variables of this type") : OK;
}

EXPORT Status fmi3SetBinary(void *c, const Reference *references, size_t count, const size_t *sizes,
                                const uint8_t *const *values, size_t size)
{
    (void)references, (void)sizes, (void)values, (void)size;
    return count ? refused(c, "there are no variables of this type") : OK;
}

EXPORT Status fmi3GetClock(void *c, const Reference *references, size_t count, bool *values)
{
    (void)references, (void)values;
    return count ? refused(c, "there are no clocks") : OK;
}

EXPORT Status fmi3SetClock(void *c, const Reference *references, size_t count, const bool *values)
{
    (void)references, (void)values;
    return count ? refused(c, "there are no clocks") : OK;
}

EXPORT Status fmi3GetNumberOfVariableDependencies(void *c, Reference reference, size_t *count)
{
    (void)reference, (void)count;
    return refused(c, "the model description has the dependencies");
}

EXPORT Status fmi3GetVariableDependencies(void *c, Reference dependent, size_t *elements, Reference *independents,
                                              size_t *of_independents, int *kinds, size_t count)
{
    (void)dependent, (void)elements, (void)independents, (void)of_independents, (void)kinds, (void)count;
    return refused(c, "the model description has the dependencies");
}

EXPORT Status fmi3GetDirectionalDerivative(void *c, const Reference *unknowns, size_t unknown_count,
                                               const Reference *knowns, size_t known_count, const double *seed,
                                               size_t seed_size, double *answer, size_t answer_size)
{
    if (seed_size != known_count || answer_size != unknown_count) return refused(c, "all variables are scalars");
    return status_of(c,
                     differentiate(((Instance *)c)->unit, unknowns, unknown_count, knowns, known_count, seed, answer));
}

EXPORT Status fmi3GetAdjointDerivative(void *c, const Reference *unknowns, size_t unknown_count,
                                           const Reference *knowns, size_t known_count, const double *seed,
                                           size_t seed_size, double *answer, size_t answer_size)
{
    (void)unknowns, (void)unknown_count, (void)knowns, (void)known_count;
    (void)seed, (void)seed_size, (void)answer, (void)answer_size;
    return refused(c, "directional derivatives are provided, adjoint ones are not");
}

/* Clocks: there are none. */
#define NO_CLOCKS_1(NAME, TYPE_0)                                                                                      \
    EXPORT Status fmi3##NAME(void *c, const Reference *references, size_t count, TYPE_0 *value_0)                  \
    {                                                                                                                  \
        (void)references, (void)value_0;                                                                               \
        return count ? refused(c, "there are no clocks") : OK;                                                     \
    }
#define NO_CLOCKS_2(NAME, TYPE_0, TYPE_1)                                                                              \
    EXPORT Status fmi3##NAME(void *c, const Reference *references, size_t count, TYPE_0 *value_0, TYPE_1 *value_1) \
    {                                                                                                                  \
        (void)references, (void)value_0, (void)value_1;                                                                \
        return count ? refused(c, "there are no clocks") : OK;                                                     \
    }
#define NO_CLOCKS_3(NAME, TYPE_0, TYPE_1, TYPE_2)                                                                      \
    EXPORT Status fmi3##NAME(void *c, const Reference *references, size_t count, TYPE_0 *value_0, TYPE_1 *value_1, \
                                 TYPE_2 *value_2)                                                                      \
    {                                                                                                                  \
        (void)references, (void)value_0, (void)value_1, (void)value_2;                                                 \
        return count ? refused(c, "there are no clocks") : OK;                                                     \
    }
NO_CLOCKS_3(GetIntervalFraction, uint64_t, uint64_t, int)
NO_CLOCKS_2(GetIntervalDecimal, double, int)
NO_CLOCKS_2(GetShiftFraction, uint64_t, uint64_t)
NO_CLOCKS_2(SetIntervalFraction, const uint64_t, const uint64_t)
NO_CLOCKS_2(SetShiftFraction, const uint64_t, const uint64_t)
NO_CLOCKS_1(GetShiftDecimal, double)
NO_CLOCKS_1(SetIntervalDecimal, const double)
NO_CLOCKS_1(SetShiftDecimal, const double)

EXPORT Status fmi3UpdateDiscreteStates(void *c, bool *again, bool *terminate, bool *nominals_changed,
                                           bool *values_changed, bool *next_event_defined, double *next_event)
{
    (void)c;
    *again = *terminate = *nominals_changed = *values_changed = *next_event_defined = false;
    *next_event = 0.0;
    return OK;
}

/* Model Exchange */

EXPORT Status fmi3GetNumberOfEventIndicators(void *c, size_t *count)
{
    (void)c;
    *count = 0;
    return OK;
}

EXPORT Status fmi3GetNumberOfContinuousStates(void *c, size_t *count)
{
    *count = 2 * (size_t)((Instance *)c)->unit->modes;
    return OK;
}

/* Co-Simulation */

EXPORT Status fmi3GetOutputDerivatives(void *c, const Reference *references, size_t count, const int32_t *orders,
                                           double *values, size_t size)
{
    return size == count ? get_output_rates(c, references, count, orders, values)
                         : refused(c, "all variables are scalars");
}

EXPORT Status fmi3DoStep(void *c, double time, double step, bool no_return, bool *event_needed, bool *terminate,
                             bool *early_return, double *last_time)
{
    Instance *instance = c;
    Status status;
    (void)no_return;
    status = status_of(instance, unit_advance(instance->unit, time, step));
    *event_needed = *terminate = *early_return = false;
    *last_time = instance->unit->variables[TIME];
    return status;
}

EXPORT Status fmi3ActivateModelPartition(void *c, Reference clock, double time)
{
    (void)clock, (void)time;
    return refused(c, "there are no clocks");
}
