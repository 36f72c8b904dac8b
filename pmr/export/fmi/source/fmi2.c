/* The unit behind the C interface of FMI 2.0 (Functional Mock-up Interface for Model Exchange and Co-Simulation). */
#include "unit.h"

typedef enum { OK, WARNING, DISCARD, ERROR, FATAL, PENDING } Status;
typedef int Flag, Whole;
typedef char Byte;
typedef enum { fmi2ModelExchange, fmi2CoSimulation } fmi2Type;
typedef enum { fmi2DoStepStatus, fmi2PendingStatus, fmi2LastSuccessfulTime, fmi2Terminated } fmi2StatusKind;
typedef unsigned Reference;

typedef struct {
    void (*logger)(void *environment, const char *instance, Status status, const char *category,
                   const char *message, ...);
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *object);
    void (*step_finished)(void *environment, Status status);
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

static void tell(const Instance *instance, Status status, const char *category, const char *message)
{
    if (instance->callbacks.logger)
        instance->callbacks.logger(instance->callbacks.environment, instance->name, status, category, message);
}

#define FMI(name) fmi2##name
#define FMU_STATE_OF(verb) fmi2##verb##FMUstate
#define FMU_STATE(verb) FMU_STATE_OF(verb)
#define STATE_SIZE fmi2SerializedFMUstateSize
#define DESERIALIZE DeSerialize
#define DERIVATIVES fmi2GetDerivatives
#define SIZE
#define OF_SIZE (void)0
#include "versions.h"

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }

EXPORT void *fmi2Instantiate(const char *name, fmi2Type type, const char *guid, const char *resources,
                             const Callbacks *callbacks, int visible, int logging)
{
    char why[400] = "no memory is left";
    Instance *instance = calloc(1, sizeof *instance + strlen(name ? name : "") + 1);
    (void)visible, (void)logging;
    if (instance) instance->unit = unit_open(guid, resources, type == fmi2ModelExchange, why);
    if (!instance || !instance->unit) {
        if (callbacks && callbacks->logger)
            callbacks->logger(callbacks->environment, name, ERROR, "logStatusError", why);
        free(instance);
        return NULL;
    }
    if (callbacks) instance->callbacks = *callbacks;
    strcpy(instance->name, name ? name : "");
    log_warnings(instance);
    return instance;
}

EXPORT Status fmi2SetupExperiment(void *c, int tolerance_defined, double tolerance, double start, int stop_defined,
                                      double stop)
{
    (void)tolerance_defined, (void)tolerance, (void)stop_defined, (void)stop;
    return fmi2SetTime(c, start);
}

EXPORT Status fmi2EnterInitializationMode(void *c)
{
    Instance *instance = c;
    return instance->unit->started ? refused(instance, "initialisation is over: fmi2Reset first") : OK;
}

EXPORT Status fmi2GetReal(void *c, const Reference *references, size_t count, double *values)
{
    return status_of(c, get_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT Status fmi2SetReal(void *c, const Reference *references, size_t count, const double *values)
{
    return status_of(c, set_variables(((Instance *)c)->unit, references, count, values));
}

EXPORT Status fmi2GetInteger(void *c, const Reference *references, size_t count, int *values)
{
    return get_start(c, references, count, values);
}

EXPORT Status fmi2SetInteger(void *c, const Reference *references, size_t count, const int *values)
{
    return set_start(c, references, count, values);
}

EXPORT Status fmi2GetDirectionalDerivative(void *c, const Reference *unknowns, size_t unknown_count,
                                               const Reference *knowns, size_t known_count, const double *seed,
                                               double *answer)
{
    return status_of(c,
                     differentiate(((Instance *)c)->unit, unknowns, unknown_count, knowns, known_count, seed, answer));
}

EXPORT Status fmi2NewDiscreteStates(void *c, EventInfo *info)
{
    (void)c;
    memset(info, 0, sizeof *info);
    return OK;
}

/* Co-Simulation */

EXPORT Status fmi2SetRealInputDerivatives(void *c, const Reference *references, size_t count, const int *orders,
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
    return OK;
}

EXPORT Status fmi2GetRealOutputDerivatives(void *c, const Reference *references, size_t count, const int *orders,
                                               double *values)
{
    return get_output_rates(c, references, count, orders, values);
}

EXPORT Status fmi2DoStep(void *c, double time, double step, int no_return)
{
    Instance *instance = c;
    (void)no_return;
    return status_of(instance, unit_advance(instance->unit, time, step));
}

EXPORT Status fmi2CancelStep(void *c) { return refused(c, "no step is ever pending"); }

EXPORT Status fmi2GetStatus(void *c, fmi2StatusKind kind, Status *value)
{
    (void)kind, (void)value;
    return refused(c, "no step is ever pending");
}

EXPORT Status fmi2GetRealStatus(void *c, fmi2StatusKind kind, double *value)
{
    Instance *instance = c;
    if (kind != fmi2LastSuccessfulTime) return refused(instance, "the last successful time is known");
    *value = instance->unit->variables[TIME];
    return OK;
}

EXPORT Status fmi2GetIntegerStatus(void *c, fmi2StatusKind kind, int *value)
{
    (void)kind, (void)value;
    return refused(c, "there is no such status");
}

EXPORT Status fmi2GetBooleanStatus(void *c, fmi2StatusKind kind, int *value)
{
    if (kind != fmi2Terminated) return refused(c, "there is no such status");
    *value = 0;
    return OK;
}

EXPORT Status fmi2GetStringStatus(void *c, fmi2StatusKind kind, const char **value)
{
    (void)kind, (void)value;
    return refused(c, "there is no such status");
}
