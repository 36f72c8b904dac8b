/* A functional mock-up unit of a system of the kernel (../../../kernel/src/pmr_kernel.h), as both versions of the
   interface see it: variables by their value references.

   The system is read from resources/system.pmr once, and shared by all instances of a process.  Beside what the kernel
   reads that file holds, of N drivers (or motions of a frame), r modes and P paths,

       unit_start (1 + 4 N + 3)  start values of the variables up to the kind of start
       unit_nominal (2 r)        sizes of the states
       unit_modes (r)            where modes stand among all that the kernel has
       unit_kinds (N)            what a driver is: OTHER, PATH, ANGLE, SLEWING, which may go on and on, or START, an
                                 angle of which value and rate at the start alone count, or FREE_PATH, a path that
                                 is computed likewise
       unit_settings (5)         of contacts that push: omega, tolerance, the resolved share of 1 / omega, most parts;
                                 share of a path by which s may lie beyond its ends
       unit_exchange (1)         whether there is a differential equation
       unit_limits_...           sums of outputs with limits (pmr_limits): first, numbers, shares, limits, groups,
                                 until, family, law, often
       names_token, names_variables, names_limits (warnings)

   and with an observer the arrays of its filter, observer_... (estimator.c).  */
#ifndef UNIT_H
#define UNIT_H

#include <stddef.h>

#include "pmr_kernel.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#elif defined __GNUC__
#define EXPORT __attribute__((visibility("default")))
#else
#define EXPORT
#endif

enum { OTHER, PATH, ANGLE, SLEWING, START, FREE_PATH };

static inline int only_starts(int kind) { return kind == START || kind == FREE_PATH; }
/* Angles but that of slewing turn once at most, rad. */
#define WHOLE_TURN 6.283185307179586

/* Value references. */
enum { TIME = 0, DRIVEN = 1 }; /* all drivers, then their rates of order one to three */
typedef struct {
    unsigned internal_step, rho_inf, start, states, derivatives, outputs, rates, forces, all;
} Numbers;

#include "shared.h"

typedef struct Estimator Estimator;

typedef struct {
    Shared *shared;
    const pmr_system *system;
    pmr_state *state;
    pmr_view view;
    pmr_sizes sizes;
    pmr_settings settings;
    const double *first, *nominal, *limits,
        *ends;                               /* arrays of the system's file: start, nominal, settings, path_ends */
    const int32_t *where, *kinds, *exchange; /* modes, kinds, exchange */
    Numbers at;
    int32_t parts[16];           /* of steps, ascending */
    int drivers, modes, outputs; /* N, r, and outputs with further ones */
    int paths;                   /* how many of the drivers are paths, the first ones */
    int started;                 /* initialisation is over */
    int stands;                  /* states and inputs are those that the last step or start has led to */
    int known_outputs, known_further, known_rates, known_derivatives;
    pmr_limits watched;     /* sums of outputs */
    double *memory, *variables, *given, *off, *second, *rates, *work; /* rates: of `pmr_compare_rates` */
    double last;                  /* s: length of the last step */
    int32_t *warned, *closed;
    Estimator *estimator; /* NULL without an observer */
    double estimator_step; /* s */
    char message[400];
    void (*warn)(void *instance, const char *warning); /* warnings are logged where they arise */
    void *instance;
} Unit;

/* NULL with the reason in `why` (400); `folder`: where the resources are, as a path or a URI. */
Unit *unit_open(const char *token, const char *folder, int model_exchange, char *why);
void unit_close(Unit *unit);

/* All return 0, or 1 with the reason in the unit's `message`. */
int unit_reset(Unit *unit);
int unit_start(Unit *unit); /* ends the initialisation */
int unit_advance(Unit *unit, double time, double duration);
int get_variables(Unit *unit, const unsigned *references, size_t count, double *values);
int set_variables(Unit *unit, const unsigned *references, size_t count, const double *values);
int get_states(Unit *unit, double *states, size_t count);
int set_states(Unit *unit, const double *states, size_t count);
int get_derivatives(Unit *unit, double *derivatives, size_t count);
int get_nominals(Unit *unit, double *nominals, size_t count);
int differentiate(Unit *unit, const unsigned *unknowns, size_t unknown_count, const unsigned *knowns,
                  size_t known_count, const double *seed, double *answer);

/* A state as `unit_bytes` bytes; `unit_save` fills memory of its own where `*state` is NULL. */
size_t unit_bytes(const Unit *unit);
int unit_save(Unit *unit, void **state);
int unit_restore(Unit *unit, const void *state);
int unit_is_state(Unit *unit, const void *bytes, size_t count);

/* What an observer adds, nothing without one: 1 if its arrays are damaged; before and after each step to drivers u, what
   the kernel returns; variables behind all others, those of measurements first, NULL without such a variable. */
int estimator_open(Unit *unit);
void estimator_close(Unit *unit);
void estimator_reset(Unit *unit);
int estimator_prepare(Unit *unit, const double *u);
int estimator_take(Unit *unit, const double *u, int measures);
double *estimator_variable(const Unit *unit, unsigned reference, int is_set);
size_t estimator_bytes(const Unit *unit);
void estimator_save(const Unit *unit, void *bytes);
void estimator_restore(Unit *unit, const void *bytes);

/* Parts of these. */
int refuse(Unit *unit, const char *why);
/* Name of a variable in the description, for messages; where none is there, its value reference. */
void name_of(const Unit *unit, unsigned reference, char *text, size_t room);
int unit_failed(Unit *unit, int failed); /* with why the kernel failed */
int unit_prepare(Unit *unit);            /* while nothing has begun, states and outputs are those with which it would */
int find_outputs(Unit *unit, int further); /* outputs and forces, or further outputs, as variables */
void unit_changed(Unit *unit);           /* states or inputs were set */
/* Modes among all that the kernel has, which are zero where they are no modes, and back. */
void fill_modes(const Unit *unit, const double *from, double *to);
void pick_modes(const Unit *unit, const double *from, double *to);

#endif
