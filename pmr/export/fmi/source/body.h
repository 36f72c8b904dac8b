/* Reduced bodies and the contacts that move along paths: modal equations of motion, a step of generalized-alpha, outputs.

       z'' + D z' + Omega^2 z + C(s)^T lambda = B f,     C z + H f - F lambda = 0,     F = G(s) + 1/k
       y = O z + W f - X(s) lambda

   z are coordinates of modes with a modal mass of 1 kg, in m, one body after the other; s are the path coordinates; each
   contact is a row of C, and behind these each pad that rubs has one, C' of it, on which its moment acts (friction.h).
   Where a frame moves, forces -T(t) (z, z') of terms that vary in time stand on the right too. */
#ifndef BODY_H
#define BODY_H

#include <stddef.h>

/* MODES, CONTACTS, INPUTS, OUTPUTS, PATHS, 1 where there is none; ROWS: contacts and PADS that rub, in JOINTS; BLOCKS and
   PAIRS of rows.h.  BEYOND_ENDS: share of a path by
   which s may lie beyond its ends, where it is taken then.  DRIVERS: inputs of the unit, the paths and the loads first.
   FRAME: a frame moves, and the outputs from TIP on are the place of the tip of TIP_SECTION in space and, of
   LUFFING forces, that of the cylinder that raises the boom; TERMS that vary in time; REACTIONS of rigid supports. */
#include "model.h"

/* Constants of the model (model.c); rows.h has those of the rows. */
extern const double omega2[MODES];
extern const double damping[DAMPING_SIZE]; /* the diagonal of D, or all of it where damping couples the modes */
extern const double inputs[INPUTS][MODES];
extern const double shapes[MODES][OUTPUTS];
extern const double direct[INPUTS][OUTPUTS];
extern const double clearance[ROWS];  /* of rows that only push */
extern const int pushes[ROWS];
extern const int gives_way[ROWS]; /* F has entries there; other contacts are rigid */
extern const double nominal[2 * MODES];
extern const double start_values[1 + 4 * DRIVERS + 3]; /* of the variables up to START */
extern const int quasi_static[MODES]; /* modes without inertia, which a step lets follow at once */
extern const int reaction_outputs[REACTIONS + 1];
extern const double reaction_rates[REACTIONS + 1][MODES]; /* what reactions have of the modes' rates */
extern const char *const row_names[ROWS];
extern const char *const model_token;

/* Numbers of the variables, which are their value references. */
enum {
    TIME = 0,
    DRIVEN, /* all inputs, then their rates of order one to three */
    PATH = DRIVEN,
    LOADS = PATH + PATHS,
    PATH_RATE = DRIVEN + DRIVERS,
    INTERNAL_STEP = DRIVEN + 4 * DRIVERS,
    RHO_INF,
    START, /* 0: at rest, undeformed; 1: static under the loads; 2: in the states that were set */
    STATES,
    DERIVATIVES = STATES + 2 * MODES,
    DISPLACEMENTS = DERIVATIVES + 2 * MODES,
    VELOCITIES = DISPLACEMENTS + OUTPUTS,
    FORCES = VELOCITIES + OUTPUTS,
    VARIABLES = FORCES + CONTACTS
};
enum { PUSHED = MODES + REACTIONS };

/* Change of what is iterated in a step, forces of terms and friction, over the largest so far, that counts as none, and that is
   accepted after the last of the times that they are found. */
#define CONVERGED 1e-11
#define ACCEPTED 1e-8
#define MOST_TIMES 100

/* All that a simulation remembers: copied as it is to save and restore one. */
typedef struct {
    int started; /* initialisation is over */
    double variables[VARIABLES];
    double given[2 * MODES];    /* states that were set before the start */
    double acceleration[MODES]; /* z'' at the end of the last step */
    double alike[MODES];        /* and the acceleration-like variable of generalized-alpha */
    double multipliers[ROWS];   /* of the last step */
    double force[ROWS];         /* of rows that push, in the last step, and their share in `alike` */
    double share[ROWS];
    double closed[ROWS]; /* 1 where a row holds; 0 of moments, which are known */
    double pushed[4][MODES]; /* forces of terms at the ends of the last steps, the last one first */
    double largest;          /* square of the largest of these so far */
    double accelerated[MODES]; /* z'' before the next part, and the largest multiplier so far (parts.c) */
    double largest_force;
    double friction[PADS + 1];  /* of pads, N; forces of their cylinders with it, and paths, at the end of the last step */
    double drives[JOINTS + 1], travelled[JOINTS + 1];
    double largest_friction;
    double length; /* of the last part, s; 0 at the start */
    int level;     /* how often the next step is halved */
} Memory;

/* A number, its rate in time, how it changes along a seed, and how its rate does. */
typedef struct {
    double value, rate, along, both;
} Number;

/* What drives a body (drive.h). */
typedef struct {
    int known;                         /* VALUES, RATES, or 0: nothing is */
    double f[INPUTS], f_rate[INPUTS];  /* loads and their rates */
    double f_along[INPUTS], f_both[INPUTS];
    double T[PUSHED][2 * MODES];       /* terms: forces -T (z, z') on modes and supports */
    double T_along[PUSHED][2 * MODES];
    Number turned[3][3];               /* from axes of the frame into those of the ground */
} Drive;

/* The rows, or how they change. */
typedef struct {
    double C[ROWS][MODES];
    double F[ROWS][ROWS];
    double H[ROWS][INPUTS];
} Rows;

/* The rows at one place. */
typedef struct {
    int known; /* 0: nothing is */
    double s[PATHS];
    int interval[BLOCKS];
    double x[BLOCKS]; /* m into the interval */
    Rows rows;
} Place;

/* Steps of a communication are halved up to seven times, and the communication may have another length. */
enum { SCHEMES = 10 };

/* Generalized-alpha with one step size. */
typedef struct {
    double step, rho_inf;
    double alpha_m, alpha_f, gamma, beta, gain; /* gain: what an acceleration adds to `alike` */
    double dz, dv;                              /* and to displacement and velocity within its step */
    double inverse[DAMPING_SIZE];               /* of 1 + D dv + Omega^2 dz; of quasi-static modes dz (Omega^2 + D / h) */
} Scheme;

typedef struct {
    Memory memory;
    Place place;
    Drive drive;
    Scheme schemes[SCHEMES]; /* of the last lengths of steps, the next one to be replaced, and that of now */
    int next_scheme;
    Scheme *scheme;
    double A[ROWS][ROWS]; /* of the last step: F + dz C S^-1 C^T */
    int fresh;   /* derivatives and displacements belong to states and inputs */
    int moving;  /* velocities do */
    double multipliers[ROWS], rates[ROWS];
    double friction[PADS + 1]; /* within a step */
    double off[DRIVERS];    /* how far inputs were set from where they had gone on to since the last step */
    double second[DRIVERS]; /* second and third rates that they had in the last step */
    int warned[DRIVERS];
    char message[400], warning[400];
} Body;

/* All return 0, or 1 with the reason in `message`. */
void body_reset(Body *body);
int body_start(Body *body);
int body_advance(Body *body, double duration);
int body_evaluate(Body *body);
int body_velocities(Body *body);
int body_differentiate(Body *body, const double *seed, double *answer); /* both VARIABLES long */
void body_changed(Body *body); /* states, inputs or time were set */

/* Parts of these: failing with a reason, and sums over rows and modes. */
int fail(Body *body, const char *why);
void add(const double *T, int width, const double *x, double factor, double *result);
void add_motion(const Rows *rows, const double *z, const double *f, const double *multipliers, double *motion);
void subtract_rows(const double *C, const double *multipliers, double *forces);
void free_forces(const double *f, const double *z, const double *v, double *forces);
int find_multipliers(Body *body);
int set_scheme(Body *body, double step, double rho_inf);
int take_step(Body *body); /* to the inputs among the variables */

#endif
