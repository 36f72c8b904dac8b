/* The unit behind the C interface of FMI 2.0 (Functional Mock-up Interface for Model Exchange and Co-Simulation). */
#include <stdlib.h>
#include <string.h>

#include "unit.h"

typedef enum { fmi2OK, fmi2Warning, fmi2Discard, fmi2Error, fmi2Fatal, fmi2Pending } fmi2Status;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef unsigned Reference;

typedef struct {
    void (*logger)(void *environment, const char *instance, fmi2Status status, const char *category,
                   const char *message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *object);
    void (*step_finished)(void *environment, fmi2Status status);
    void *environment;
} Callbacks;

typedef struct {
    int new_discrete_states_needed, terminate_simulation, nominals_changed, values_changed, next_event_time_defined;
    double next_event_time;
} EventInfo;

typedef struct {
    Unit *unit;
    Callbacks callbacks;
    char name[];
} Instance;

/* The status of a call that failed or not, with the reason for the master's log. */
static fmi2Status status_of(Instance *instance, int failed)
{
    if (failed && instance->callbacks.logger)
        instance->callbacks.logger(instance->callbacks.environment, instance->name, fmi2Error, "logStatusError",
                                   instance->unit->message);
    if (!failed && instance->unit->warning[0] && instance->callbacks.logger)
        instance->callbacks.logger(instance->callbacks.environment, instance->name, fmi2Warning, "logStatusWarning",
                                   instance->unit->warning);
    instance->unit->warning[0] = 0;
    return failed ? fmi2Error : fmi2OK;
}

static fmi2Status refused(Instance *instance, const char *why)
{
    return status_of(instance, refuse(instance->unit, why));
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT fmi2Status fmi2SetDebugLogging(void *c, int on, size_t count, const char *const categories[])
{
    (void)c, (void)on, (void)count,
        (void)categories; /* errors and warnings are logged, and there is nothing else to log */
    return fmi2OK;
}

EXPORT void *fmi2Instantiate(const char *name, fmi2Type type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logging)
{
    char why[400] = "no memory is left";
    Instance *instance = calloc(1, sizeof *instance + strlen(name ? name : "") + 1);
    (void)visible, (void)logging;
    if (instance) instance->unit = unit_open(guid, resources, type == fmi2ModelExchange, why);
    if (!instance || !instance->unit) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->environment, name, fmi2Error, "logStatusError", why);
        free(instance);
        return NULL;
    }
    if (callbacks) instance->callbacks = *callbacks;
    strcpy(instance->name, name ? name : "");
    return instance;
}

EXPORT void fmi2FreeInstance(void *c)
{
    Instance *instance = c;
    if (!instance) return;
    unit_close(instance->unit);
    free(instance);
}

static fmi2Status time_is(Instance *instance, double time)
{
    instance->unit->variables[TIME] = time;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetupExperiment(void *c, int tolerance_defined, double tolerance, double start, int stop_defined,
                                      double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    return time_is(c, start);
}

EXPORT fmi2Status fmi2EnterInitializationMode(void *c)
{
    Instance *instance = c;
    return instance->unit->started ? refused(instance, "initialisation is over: fmi2Reset first") : fmi2OK;
}

EXPORT fmi2Status fmi2ExitInitializationMode(void *c)
{
    Instance *instance = c;
    return status_of(instance, unit_start(instance->unit));
}

EXPORT fmi2Status fmi2Terminate(void *c)
{
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2Reset(void *c) { return status_of(c, unit_reset(((Instance *)c)->unit)); }

EXPORT fmi2Status fmi2GetReal(void *c, const Reference *references, size_t count, double *values)
{
    return status_of(c, get_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT fmi2Status fmi2SetReal(void *c, const Reference *references, size_t count, const double *values)
{
    return status_of(c, set_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT fmi2Status fmi2GetInteger(void *c, const Reference *references, size_t count, int *values)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        if (references[n] != instance->unit->at.start)
            return refused(instance, "the only integer is the kind of start");
        values[n] = (int)instance->unit->variables[instance->unit->at.start];
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetInteger(void *c, const Reference *references, size_t count, const int *values)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        double value = values[n];
        if (references[n] != instance->unit->at.start || values[n] < 0 || values[n] > 2)
            return refused(instance, "the only integer is the kind of start: 0 at rest, 1 static, 2 as given");
        if (set_variables(instance->unit, references + n, 1, &value)) return status_of(instance, 1);
    }
    return fmi2OK;
}

#define NO_VARIABLES_OF(KIND, VALUE)                                                                                   \
    EXPORT fmi2Status fmi2Get##KIND(void *c, const Reference *references, size_t count, VALUE *values)                 \
    {                                                                                                                  \
        (void)references, (void)values;                                                                                \
        return count ? refused(c, "there are no variables of this type") : fmi2OK;                                     \
    }                                                                                                                  \
    EXPORT fmi2Status fmi2Set##KIND(void *c, const Reference *references, size_t count, const VALUE *values)           \
    {                                                                                                                  \
        (void)references, (void)values;                                                                                \
        return count ? refused(c, "there are no variables of this type") : fmi2OK;                                     \
    }
NO_VARIABLES_OF(Boolean, int)
NO_VARIABLES_OF(String, char *)

EXPORT fmi2Status fmi2GetFMUstate(void *c, void **state)
{
    Instance *instance = c;
    return status_of(instance, unit_save(instance->unit, state));
}

EXPORT fmi2Status fmi2SetFMUstate(void *c, void *state)
{
    Instance *instance = c;
    if (!state) return refused(instance, "there is no state to return to");
    return status_of(instance, unit_restore(instance->unit, state));
}

EXPORT fmi2Status fmi2FreeFMUstate(void *c, void **state)
{
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializedFMUstateSize(void *c, void *state, size_t *size)
{
    (void)state;
    *size = unit_bytes(((Instance *)c)->unit);
    return fmi2OK;
}

EXPORT fmi2Status fmi2SerializeFMUstate(void *c, void *state, char *bytes, size_t size)
{
    Instance *instance = c;
    if (!state || size < unit_bytes(instance->unit)) return refused(instance, "bytes are too few for a state");
    memcpy(bytes, state, unit_bytes(instance->unit));
    return fmi2OK;
}

EXPORT fmi2Status fmi2DeSerializeFMUstate(void *c, const char *bytes, size_t size, void **state)
{
    Instance *instance = c;
    *state = NULL;
    if (!unit_is_state(instance->unit, bytes, size)) return status_of(instance, 1);
    *state = malloc(size);
    if (!*state) return refused(instance, "no memory is left");
    memcpy(*state, bytes, size);
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetDirectionalDerivative(void *c, const Reference *unknowns, size_t unknown_count,
                                               const Reference *knowns, size_t known_count, const double *seed,
                                               double *answer)
{
    return status_of(c,
                     differentiate(((Instance *)c)->unit, unknowns, unknown_count, knowns, known_count, seed, answer));
}

/* Model Exchange: continuous throughout, no event is ever indicated. */

EXPORT fmi2Status fmi2EnterEventMode(void *c)
{
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2NewDiscreteStates(void *c, EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return fmi2OK;
}

EXPORT fmi2Status fmi2EnterContinuousTimeMode(void *c)
{
    (void)c;
    return fmi2OK;
}

EXPORT fmi2Status fmi2CompletedIntegratorStep(void *c, int no_return, int *enter_event_mode, int *terminate)
{
    (void)c, (void)no_return;
    *enter_event_mode = *terminate = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2SetTime(void *c, double time) { return time_is(c, time); }

EXPORT fmi2Status fmi2SetContinuousStates(void *c, const double *states, size_t count)
{
    return status_of(c, set_states(((Instance *)c)->unit, states, count));
}

EXPORT fmi2Status fmi2GetDerivatives(void *c, double *derivatives, size_t count)
{
    return status_of(c, get_derivatives(((Instance *)c)->unit, derivatives, count));
}

EXPORT fmi2Status fmi2GetEventIndicators(void *c, double *indicators, size_t count)
{
    (void)indicators;
    return count ? refused(c, "there are no event indicators") : fmi2OK;
}

EXPORT fmi2Status fmi2GetContinuousStates(void *c, double *states, size_t count)
{
    return status_of(c, get_states(((Instance *)c)->unit, states, count));
}

EXPORT fmi2Status fmi2GetNominalsOfContinuousStates(void *c, double *nominals, size_t count)
{
    return status_of(c, get_nominals(((Instance *)c)->unit, nominals, count));
}

/* Co-Simulation */

EXPORT fmi2Status fmi2SetRealInputDerivatives(void *c, const Reference *references, size_t count, const int *orders,
                                              const double *values)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        int is_input = references[n] >= DRIVEN && references[n] < DRIVEN + (Reference)instance->unit->drivers;
        Reference rate = references[n] + (is_input ? orders[n] * instance->unit->drivers : 0);
        if (orders[n] < 1 || orders[n] > 3 || !is_input)
            return refused(instance, "first to third derivatives of inputs are allowed");
        if (set_variables(instance->unit, &rate, 1, values + n)) return status_of(instance, 1);
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetRealOutputDerivatives(void *c, const Reference *references, size_t count, const int *orders,
                                               double *values)
{
    Instance *instance = c;
    size_t n;
    for (n = 0; n < count; n++) {
        Reference rate = references[n] + instance->unit->outputs;
        if (orders[n] != 1 || references[n] < instance->unit->at.outputs || references[n] >= instance->unit->at.rates)
            return refused(instance, "first derivatives of displacements are known");
        if (get_variables(instance->unit, &rate, 1, values + n)) return status_of(instance, 1);
    }
    return fmi2OK;
}

EXPORT fmi2Status fmi2DoStep(void *c, double time, double step, int no_return)
{
    Instance *instance = c;
    (void)no_return;
    return status_of(instance, unit_advance(instance->unit, time, step));
}

EXPORT fmi2Status fmi2CancelStep(void *c) { return refused(c, "no step is ever pending"); }

EXPORT fmi2Status fmi2GetStatus(void *c, fmi2StatusKind kind, fmi2Status *value)
{
    (void)kind, (void)value;
    return refused(c, "no step is ever pending");
}

EXPORT fmi2Status fmi2GetRealStatus(void *c, fmi2StatusKind kind, double *value)
{
    Instance *instance = c;
    if (kind != fmi2LastSuccessfulTime) return refused(instance, "the last successful time is known");
    *value = instance->unit->variables[TIME];
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetIntegerStatus(void *c, fmi2StatusKind kind, int *value)
{
    (void)kind, (void)value;
    return refused(c, "there is no such status");
}

EXPORT fmi2Status fmi2GetBooleanStatus(void *c, fmi2StatusKind kind, int *value)
{
    if (kind != fmi2Terminated) return refused(c, "there is no such status");
    *value = 0;
    return fmi2OK;
}

EXPORT fmi2Status fmi2GetStringStatus(void *c, fmi2StatusKind kind, const char **value)
{
    (void)kind, (void)value;
    return refused(c, "there is no such status");
}
