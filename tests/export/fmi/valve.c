/* A second unit for a crane's: a PID of its angle and tip, a valve, and a cylinder whose oil gives way to its force, as
   Luffing of loop.py.  FMI 2.0, Co-Simulation; what a master of reals needs.  Compiled with the constants of loop.py. */
#include <stdlib.h>
#include <string.h>

enum { WANTED, START, TIP, FORCE, ANGLE, RATE, SECOND, THIRD, VARIABLES };

typedef struct {
    double variables[VARIABLES]; /* the angle and its rates in the last step, at its beginning */
    double angle[3];             /* at its end */
    double turned, summed, before[2]; /* tip before, and the force at the start */
    int stepped;
} Valve;

const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }

int fmi2Reset(void *instance)
{
    Valve *valve = instance;
    memset(valve, 0, sizeof *valve);
    valve->variables[WANTED] = WANTED_ANGLE;
    return 0;
}

void *fmi2Instantiate(const char *name, int type, const char *token, const char *resources, const void *callbacks,
                      int visible, int logging)
{
    Valve *valve = malloc(sizeof *valve);
    (void)name, (void)type, (void)token, (void)resources, (void)callbacks, (void)visible, (void)logging;
    if (valve) fmi2Reset(valve);
    return valve;
}

void fmi2FreeInstance(void *instance) { free(instance); }
int fmi2SetupExperiment(void *instance, int defined, double tolerance, double start, int ends, double stop)
{
    return (void)instance, (void)defined, (void)tolerance, (void)start, (void)ends, (void)stop, 0;
}
int fmi2EnterInitializationMode(void *instance) { return (void)instance, 0; }

int fmi2ExitInitializationMode(void *instance)
{
    Valve *valve = instance;
    valve->turned = valve->angle[0] = valve->variables[ANGLE] = valve->variables[START];
    return 0;
}

int fmi2Terminate(void *instance) { return (void)instance, 0; }

int fmi2GetReal(void *instance, const unsigned *references, size_t count, double *values)
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (references[k] >= VARIABLES) return 3;
        values[k] = ((Valve *)instance)->variables[references[k]];
    }
    return 0;
}

int fmi2SetReal(void *instance, const unsigned *references, size_t count, const double *values)
{
    size_t k;
    for (k = 0; k < count; k++) {
        if (references[k] >= ANGLE) return 3;
        ((Valve *)instance)->variables[references[k]] = values[k];
    }
    return 0;
}

int fmi2DoStep(void *instance, double t, double h, int final)
{
    Valve *valve = instance;
    double *u = valve->variables, *angle = valve->angle, flow, asked;
    (void)t, (void)final;
    if (!valve->stepped) memcpy(valve->before, u + TIP, sizeof valve->before);
    valve->stepped = 1;
    memcpy(u + ANGLE, angle, sizeof valve->angle);
    valve->summed += KI * (u[WANTED] - angle[0]) * h;
    flow = KP * (u[WANTED] - angle[0]) + valve->summed - KD * (u[TIP] - valve->before[0]) / h;
    valve->turned += flow * h;
    asked = valve->turned + OIL * (u[FORCE] - valve->before[1]);
    u[THIRD] = (LINES * LINES * (asked - angle[0]) - 2.0 * LINES * angle[1] - angle[2]) / h;
    valve->before[0] = u[TIP];
    angle[0] += h * (angle[1] + h / 2.0 * (angle[2] + h / 3.0 * u[THIRD]));
    angle[1] += h * (angle[2] + h / 2.0 * u[THIRD]);
    angle[2] += h * u[THIRD];
    return 0;
}

/* What an importer looks for, and what this unit does not have. */
#define REFUSED(function) \
    int function(void) { return 3; }
REFUSED(fmi2SetDebugLogging)
REFUSED(fmi2GetInteger)
REFUSED(fmi2GetBoolean)
REFUSED(fmi2GetString)
REFUSED(fmi2SetInteger)
REFUSED(fmi2SetBoolean)
REFUSED(fmi2SetString)
REFUSED(fmi2GetFMUstate)
REFUSED(fmi2SetFMUstate)
REFUSED(fmi2FreeFMUstate)
REFUSED(fmi2SerializedFMUstateSize)
REFUSED(fmi2SerializeFMUstate)
REFUSED(fmi2DeSerializeFMUstate)
REFUSED(fmi2GetDirectionalDerivative)
REFUSED(fmi2SetRealInputDerivatives)
REFUSED(fmi2GetRealOutputDerivatives)
REFUSED(fmi2CancelStep)
REFUSED(fmi2GetStatus)
REFUSED(fmi2GetRealStatus)
REFUSED(fmi2GetIntegerStatus)
REFUSED(fmi2GetBooleanStatus)
REFUSED(fmi2GetStringStatus)
