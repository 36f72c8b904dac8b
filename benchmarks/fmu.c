/* Seconds of the processor that a communication step takes through the C interface of an FMU of FMI 2.0:
   timing LIBRARY GUID STEPS STEP FIRST COUNT INPUTS PATHS RESOURCES takes so many steps, sets all inputs but rates, of which the path coordinates
   move, before each, and reads COUNT variables from value reference FIRST on after it. */
#define _POSIX_C_SOURCE 200809L
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

typedef void *(*Instantiate)(const char *, int, const char *, const char *, const void *, int, int);
typedef int (*Setup)(void *, int, double, double, int, double);
typedef int (*Mode)(void *);
typedef int (*Access)(void *, const unsigned *, size_t, double *);
typedef int (*Step)(void *, double, double, int);

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return t.tv_sec + 1e-9 * t.tv_nsec;
}

int main(int count, char **arguments)
{
    static const struct { void *callbacks[5]; } none;
    void *library = count == 10 ? dlopen(arguments[1], RTLD_NOW) : NULL, *c;
    int steps = atoi(arguments[3]), first = atoi(arguments[5]), outputs = atoi(arguments[6]), inputs = atoi(arguments[7]), paths = atoi(arguments[8]), k, n;
    double h = atof(arguments[4]), *values = calloc(outputs + inputs, sizeof *values), begun, sum = 0.0;
    unsigned *seen = calloc(outputs, sizeof *seen), *given = calloc(inputs, sizeof *given);
    if (!library) return 1;
    c = ((Instantiate)dlsym(library, "fmi2Instantiate"))("timed", 1, arguments[2], arguments[9], &none, 0, 0);
    if (!c) return 1;
    ((Setup)dlsym(library, "fmi2SetupExperiment"))(c, 0, 0.0, 0.0, 0, 0.0);
    ((Mode)dlsym(library, "fmi2EnterInitializationMode"))(c);
    if (((Mode)dlsym(library, "fmi2ExitInitializationMode"))(c)) return 1;
    {
        Access get = (Access)dlsym(library, "fmi2GetReal"), set = (Access)dlsym(library, "fmi2SetReal");
        Step step = (Step)dlsym(library, "fmi2DoStep");
        double *u = values + outputs;
        for (n = 0; n < outputs; n++) seen[n] = first + n;
        for (n = 0; n < inputs; n++) given[n] = 1 + n;
        get(c, given, inputs, u);
        begun = now();
        for (k = 0; k < steps; k++) {
            for (n = 0; n < paths; n++) u[n] += 1e-6; /* the rows move in every step */
            for (n = paths; n < inputs; n++) u[n] *= 1.0 + 1e-9 * k; /* no pad opens, which would divide steps */
            if (set(c, given, inputs, u) || step(c, k * h, h, 1) || get(c, seen, outputs, values)) return 1;
            sum += values[0];
        }
        printf("%.9g\n", (now() - begun) / steps);
    }
    return sum != sum;
}
