/* The compiled step of pmr: reduced bodies, the contacts between them that travel along paths, and what drives them.

   Equations.  With modal coordinates z of all bodies (M = 1), multipliers lambda of the contacts, loads f and paths s,

       I z'' + D z' + Omega^2 z + C(s)^T lambda = B f + w,        I = 1, or 0 of a mode without inertia
       C z + H f - F lambda = g,                                  F = G(s) + A(s)   (m/N)
       y = O z + W f - X(s) lambda

   lambda > 0 pushes.  A contact that only pushes has a clearance c and obeys 0 <= lambda, 0 <= c + F lambda - C z - H
   f, one of them zero.  G is what the bodies' residual flexibility gives, A what pads, supports and ropes give; w are
   forces of terms that vary in time, w = -sum_k c_k (V_k z' + G_k z), and g what cylinders give way to the friction
   of pads.

   Scheme.  Generalized-alpha of constant step (Chung and Hulbert 1993, eq. 25; Arnold and Bruels 2007, eq. 5 to 7),
   contacts at position level at the end of each step.  A step of contacts that only push is made in 1, 2, 4, ...
   equal parts, as many as keep their forces to a tolerance.

   Units are SI: m, N, N m, s, rad.  Modal coordinates are in m kg^(1/2).

   Data.  `pmr_system` is read only: any number of states, in any number of threads, share one.  It is made from one
   block of bytes that is the same in a file, in memory and in an FMU's resources.  `pmr_state` is one simulation, and
   belongs to one thread at a time.  No function but `pmr_system_open` and `pmr_state_open` allocates.

   Numbers without a name stand in the order of the system's names (`pmr_system_names`).  Arrays are of doubles in
   row-major order. Modes stand body after body, each body filled up with zeros to a multiple of four: `modes` counts
   those too. */
#ifndef PMR_KERNEL_H
#define PMR_KERNEL_H

#include <stddef.h>
#include <stdint.h>

#include "law.h"

#ifdef __cplusplus
extern "C" {
#endif

/* ---- from here on cffi reads this file: declarations only ---- */

typedef struct pmr_system pmr_system;
typedef struct pmr_state pmr_state;

/* What a function returns.  PMR_DONE: all is well.  The others leave the state where the last whole step ended, but for
   PMR_NOT_FINITE of a step, after which only `pmr_start` and `pmr_state_restore` go on. */
enum {
    PMR_DONE = 0,
    PMR_REFUSED = 1,     /* an argument or a block of bytes is wrong */
    PMR_DEPENDENT = 2,   /* a contact depends on those before it: `pmr_state_trouble` tells which */
    PMR_UNSETTLED = 3,   /* which contacts are closed was not found in 1000 solves */
    PMR_UNCONVERGED = 4, /* forces of terms or friction do not converge within a step */
    PMR_NOT_FINITE = 5,  /* a coordinate, or a force on the ground, is infinite or no number */
    PMR_NO_MEMORY = 6,
    PMR_LOST = 7,        /* a computed motion is not found */
    PMR_BLOCKED = 9,     /* a hook is at its sheaves: its rope is too short */
    PMR_UPRIGHT = 8,     /* a machine pitches by 90 degrees, where roll and yaw turn about one axis */
    PMR_LIFTED = 10,     /* which outriggers lift off is not found */
    PMR_BEYOND = 11,     /* a free extension leaves what the rows are known for */
    PMR_STROKE = 12      /* a free luffing angle starts where its cylinder is outside of its stroke */
};

/* Room for a message, with the zero at its end. */
enum { PMR_MESSAGE = 160 };

/* Sizes of a system. */
typedef struct {
    int32_t modes;     /* r': all bodies' modes, filled up */
    int32_t contacts;  /* m: multipliers */
    int32_t forces;    /* contacts as the user names them: rings of pads are solved for as fewer multipliers */
    int32_t inputs;    /* i: loads on the bodies */
    int32_t outputs;   /* o */
    int32_t paths;     /* P */
    int32_t terms;     /* K: terms that vary in time */
    int32_t pads;      /* n: pads that rub */
    int32_t drivers;   /* N: what drives the system from outside, `u`: paths, then loads, then what else it asks for */
    int32_t motions;   /* n: what a frame that moves is driven by; 0 without one */
    int32_t pushing;   /* contacts that only push */
    int32_t further;   /* further outputs: reactions of rigid supports; in a frame the tip, and the luffing cylinder; then
                          those of `ground`, `hoist` and `computed` */
    int32_t hoist;     /* outputs of a hoist, 0 without one */
    int32_t computed;  /* outputs of a luffing angle or an extension that is free, behind those of a hoist; 0 without one */
    int32_t ground;    /* outputs of outriggers, before those of a hoist; 0 without any */
} pmr_sizes;

/* ---- systems ---- */

/* Make a system from a block of `bytes` bytes, which begins on a multiple of 64 and has to stay as it is as long as
   the system lives.  PMR_REFUSED with a reason in `why` (PMR_MESSAGE) if it is not one that this kernel wrote, or is
   damaged. */
int pmr_system_open(const void *block, size_t bytes, pmr_system **system, char *why);
void pmr_system_close(pmr_system *system);
void pmr_system_sizes(const pmr_system *system, pmr_sizes *sizes);
/* Names of "drivers", "motions", "outputs", "further", "contacts" or "forces", one a line, in `*count` bytes; NULL where there is no such
   list. */
const char *pmr_system_names(const pmr_system *system, const char *list, size_t *count);
/* An array of the block, which may hold more than the kernel asks for, and how many entries it has; NULL without one. */
const double *pmr_system_numbers(const pmr_system *system, const char *name, int64_t *count);
const int32_t *pmr_system_integers(const pmr_system *system, const char *name, int64_t *count);
/* Checksum that a block is written with: of the bytes behind its first 64. */
uint64_t pmr_checksum(const void *bytes, size_t count);
/* Which code runs: "avx2", "sse2", "vectors" or "plain". */
const char *pmr_variant(void);

/* ---- states ---- */

/* How a system is stepped. */
typedef struct {
    double step;          /* s */
    double rho_inf;       /* spectral radius at infinite frequency, 0 to 1 */
    double contact_omega; /* rad/s: of the contacts that only push; 0: their forces are not judged */
    double tolerance;     /* what a part may err in the forces of closed contacts, over the largest so far */
    int32_t levels;       /* lengths of steps, 1 to 64 */
    int32_t energy;       /* whether energy and work are added up */
    const int32_t *parts; /* (levels,): of how many equal parts a step is made, ascending; NULL: of one */
} pmr_settings;

int pmr_state_open(const pmr_system *system, const pmr_settings *settings, pmr_state **state, char *why);
/* Go on with other settings, of as many levels as those that the state was opened with at most: the next step begins
   from the accelerations of where the state stands. */
int pmr_state_adjust(pmr_state *state, const pmr_settings *settings, char *why);
void pmr_state_close(pmr_state *state);
/* Bytes that a state is saved as, and bytes of memory that it takes. */
size_t pmr_state_bytes(const pmr_state *state);
size_t pmr_state_memory(const pmr_state *state);
/* Write a state as `pmr_state_bytes` bytes; restored into a state of the same system and settings it goes on bit for
   bit. */
void pmr_state_save(const pmr_state *state, void *bytes);
/* PMR_REFUSED with a reason, the state as it was, if these are not bytes of such a state, or are damaged. */
int pmr_state_restore(pmr_state *state, const void *bytes, size_t count, char *why);
/* Number of the contact that PMR_DEPENDENT is about, else -1. */
int pmr_state_trouble(const pmr_state *state);

/* Where a state stands.  Pointers lead into the state and stay the same as long as it lives. */
typedef struct {
    double *z, *v;       /* (r'): modal coordinates and their rates */
    double *multipliers; /* (m,) N */
    double *impulses;    /* (m,) N s: of each contact in the last step */
    double *energy;      /* (2,) J: stored, and work done on the system since the start */
    double *friction;    /* (n,) N: of the pads that rub, along the boom */
    double *drivers;     /* (N,): u where it stands */
    int64_t *step;       /* number of the last step */
    int32_t *parts;      /* of how many parts that was made */
} pmr_view;

void pmr_state_view(pmr_state *state, pmr_view *view);

/* ---- start ---- */

enum { PMR_AT_REST = 0, PMR_GIVEN = 1, PMR_IN_EQUILIBRIUM = 2 };

/* Bring a state to t = 0 under drivers u (N,).  PMR_AT_REST: z = v = 0.  PMR_GIVEN: z (r',) and v (r',).
   PMR_IN_EQUILIBRIUM: at rest under the loads, v = 0.  Multipliers of contacts that give way follow from the
   position, those of rigid ones from the accelerations.  PMR_REFUSED, the state as it was, where a number is not
   finite. */
int pmr_start(pmr_state *state, int kind, const double *u, const double *z, const double *v);
/* The same where paths move by `rates` (P,) m/s: rates v that violate rigid contacts are corrected by the change of
   least kinetic energy, those of bodies at rest and in equilibrium too. */
int pmr_start_moving(pmr_state *state, int kind, const double *u, const double *rates, const double *z,
                     const double *v);

/* ---- a frame that moves ---- */

/* Where a system has a frame, its loads and amplitudes of terms follow from n motions with their rates and second
   rates, `motions` (3, n): paths in m; loads in N as a user names them, gravity in m/s^2 among them; angles of the
   frame and of its base in rad; accelerations of its base in m/s^2.  Of loads and accelerations the value alone counts.

   Drivers u (N,) of motions, with `work` of `pmr_frame_work` doubles.  PMR_REFUSED without a frame. */
size_t pmr_frame_work(const pmr_system *system);
int pmr_frame(const pmr_system *system, const double *motions, double *u, double *work);
/* As `pmr_start` and `pmr_step`.  Of a system with a free luffing angle (luffing.c) or extension (extension.c) this motion
   counts at the start alone, and its cylinder begins with what holds the boom.  `rows` (n,) or NULL: of each motion 1, 2
   or 3 rows count; parts of a step follow lines, cubics by rates, or cubics by second rates between what counts at both
   ends.  `pmr_advance` of such a system takes signals of its motions. */
int pmr_start_in_frame(pmr_state *state, int kind, const double *motions, const int32_t *rows, const double *z,
                       const double *v);
int pmr_step_in_frame(pmr_state *state, const double *motions, const int32_t *rows);

/* ---- a machine that carries the frame ---- */

/* What drives a cylinder. */
enum { PMR_NO_CYLINDER = 0, PMR_CYLINDER_FORCE = 1, PMR_CYLINDER_LENGTH = 2, PMR_CYLINDER_OIL = 3 };

/* A cylinder that drives a luffing angle, which is the `level` of a machine less its pitch, or an extension, which is its
   length (cylinder.c).  Pairs are of the bore and of the rod side, or x and z. */
typedef struct {
    int32_t kind;
    double foot[2], lug[2];                /* m from the pivot, the lug where the boom lies level; not of an extension */
    double spring, damping;                /* N/m over the length, N s/m */
    double stroke[2], stop_stiffness, stop_damping; /* m, N/m, s/m */
    double friction[LAW_CONSTANTS], shear_stiffness; /* law of a pad that presses with 1 N (law.h); N/m where it sticks */
    double areas[2], volumes[2];           /* m^2; m^3 at the ends of the stroke, hoses included */
    double bulk_modulus, leakage;          /* Pa, m^3/s/Pa */
    double supply, tank, back_pressure;    /* Pa; the last one at the start in the chamber that the load does not press on */
    double gain[2], dead_band, laminar;    /* m^3/s/Pa^0.5 of the valve's edges, 1, Pa */
    double setting, ratio, range, counterbalance; /* Pa, 1, Pa, m^3/s/Pa^0.5: 0 without such a valve */
} pmr_actuator;

/* Columns of what a cylinder is recorded by: m, m/s and N, pushing; Pa and flows into the chambers in m^3/s; volumes in
   m^3 that have flowed into them since the start; m^3/s out of the supply. */
enum { PMR_CYLINDER_COLUMNS = 10 };

/* A machine below the boom of a system with a frame, whose motion is found with the boom's (machine.c).  Its directions
   are x, y, z of the pivot along the ground's axes in m, and roll, pitch and yaw in rad.  A machine that `luffs` stands for
   a boom's free luffing angle: it has no mass and is free to pitch alone, on a base that may turn; its yaw is the slewing
   angle, its pitch `level` less the luffing angle.  Arrays stay as long as what is opened with them; those over T steps,
   t = 0 the first, say what drives it. */
typedef struct {
    int32_t sections;        /* S, the base first */
    int32_t shortened_count; /* G: moments that are quadratic in the modes */
    int32_t inertial_count;  /* inputs by which the frame accelerates the boom */
    int32_t axes[3];         /* motions that are accelerations of the pivot along the ground's axes, less than 0: none */
    int32_t free[6];         /* directions that it moves in by itself */
    int32_t luffs;           /* whether it is a boom's free luffing angle */
    double level;            /* rad: luffing angle where a machine that luffs does not pitch */
    double mass, center[3], inertia[3]; /* kg, m from the pivot, kg m^2 about it along its own axes */
    double stiffness[6], damping[6];
    double boom_mass, largest_weight;   /* kg, m/s^2 */
    double place[3], section_inertia[9]; /* m: the base's tail from the pivot; kg m^2: the sum about the tails */
    const int32_t *section_paths;  /* (S,): motions by which sections move along, less than 0: none */
    const int32_t *fields;         /* (S, 4, 3): inputs of acceleration fields over 1, x, y, z along x, y, z, or -1 */
    const int32_t *inertial;       /* (inertial_count,) inputs */
    const double *masses, *first_moments; /* (S,) kg, (S, 3) kg m from each tail */
    const double *loads;           /* (S, 6, i): forces and moments about the tails of all inputs */
    const double *rotating;        /* (3, r', r') kg: moments of momentum z^T R_j z' */
    const double *second_moments;  /* (3, 3, r', r') kg: int rho u_i u_j = z^T A_ij z */
    const int32_t *of_shortened;   /* (G, 3): section, over 1 or x, section over whose extension it is or -1 */
    const double *shortened;       /* (G, r', r') */
    const double *motions;         /* (T, 3, n): of the frame, those of the machine left out */
    const double *rates;           /* (T, n) m/s: of the motions that are paths; at kinks the mean of both sides */
    const double *base_motion;     /* (T, 3, 6): directions that are held, and what springs stand on */
    const double *external;        /* (T, 6) N and N m: forces and moments on the pivot, along the ground's axes */
    const double *weight;          /* (T,) m/s^2 */
    pmr_actuator cylinder;
    const double *drive;           /* (T, 2): of the cylinder a force in N, a length in m or an opening, and its rate */
} pmr_machine;

typedef struct pmr_machine_run pmr_machine_run;

/* Where steps of a machine are recorded, one row each. */
typedef struct {
    double *motion;  /* (., 3, 6): directions with rates and second rates */
    double *held;    /* (., 6) N, N m: what holds directions that are not free */
    double *springs; /* (., 6): of springs and dampers, by the directions */
    double *momenta; /* (., 6): linear and angular momentum about the ground's origin */
    double *inertia; /* (., inertial_count): inputs by which the frame accelerates the boom */
    double *cylinder; /* (., PMR_CYLINDER_COLUMNS) */
} pmr_machine_record;

/* PMR_REFUSED for a system whose frame does not move so or whose contacts push, and for steps in parts or with
   energy, which a boom that moves with its machine has none of by itself. */
int pmr_machine_run_open(pmr_state *state, const pmr_machine *machine, pmr_machine_run **run);
void pmr_machine_run_close(pmr_machine_run *run);
/* What has to hold the machine (6,), by its directions, at t = 0 where it moves as b (3, 6) and the boom as z, v, a
   (r',). */
int pmr_machine_run_holding_forces(pmr_machine_run *run, const double *b, const double *z, const double *v,
                                   const double *a, double *forces);
/* Let the luffing cylinder begin with what holds the boom, with modes at z (r',), at rest at the place b (6,): with the
   force of a length's spring, or the pressures of oil. */
int pmr_machine_run_load_cylinder(pmr_machine_run *run, const double *b, const double *z);
/* Begin at t = 0 with b (3, 6), whose second rates of free directions are found, and the boom at z and v (r',); row 0
   is recorded. */
int pmr_machine_run_start(pmr_machine_run *run, const double *b, const double *z, const double *v,
                          const pmr_machine_record *record);
/* Take `count` steps, the first of which is number `first`, 1 or more; row 0 is that step.  `*taken` were taken. */
int pmr_machine_run_advance(pmr_machine_run *run, int64_t first, int64_t count, const pmr_machine_record *record,
                            int64_t *taken);

/* ---- signals ---- */

/* Drivers over time as sums of pieces; piece j of driver n counts on breaks[j] <= t < breaks[j + 1], with x = t -
   breaks[j],

       u_n(t) = sum over its strands of  p(x) + a sin(q(x)),    p with `powers` coefficients, q quadratic.

   The first piece of a strand goes on before its first break, the last one behind its last.  A strand with spread h >
   0 counts by how fast its rate grows within h, (u'(t + h/2) - u'(t - h/2)) / h, which has no kinks of u in it, and
   from t = 0 on only; its second rate is left out.  A strand with spread less than 0 counts by its second rate, and
   has no rates. */
typedef struct {
    int32_t drivers;              /* N */
    int32_t powers;               /* of p, 1 or more */
    const int32_t *first_strand;  /* (N + 1,): strands of each driver */
    const int32_t *first_piece;   /* (strands + 1,): pieces of each strand */
    const double *spread;         /* (strands,) s, or NULL: of none */
    const double *breaks;         /* (pieces,) s: where each begins */
    const double *pieces;         /* (pieces, powers + 4): p highest power first, a, q highest power first */
} pmr_signals;

/* u (N,) at t; with rates not NULL also their first and second rates (2, N). */
void pmr_signals_at(const pmr_signals *signals, double t, double *u, double *rates);

/* ---- steps ---- */

/* One step to drivers u (N,) at its end, which parts in between follow along straight lines, or along Hermite's cubics
   with rates at both ends, `rates` (2, N) at its beginning and its end.  PMR_REFUSED if a luffing angle or an extension is
   free: `pmr_step_in_frame` moves them. */
int pmr_step(pmr_state *state, const double *u, const double *rates);

/* The course of n numbers from their values and first three rates at a time, `led` (4, n): with rows up to `rows` at t
   later, to (rows, n), their values, rates and second rates. */
void pmr_lead_on(const double *led, int n, double t, int rows, double *to);
/* One step from `since` on, along the course of drivers, or of motions of a frame, from their values and rates `led`
   (4, .).  What they were before the step need not be where this course begins. */
int pmr_step_led(pmr_state *state, const double *led, double since);

/* Where steps are recorded, one row each; NULL: they are not.  Row 0 is the first step recorded. */
typedef struct {
    double *z, *v;       /* (., r') */
    double *multipliers; /* (., m) N */
    double *impulses;    /* (., m) N s */
    double *peaks;       /* (., m) N: largest multiplier within the step */
    double *energy;      /* (., 2) J */
    double *friction;    /* (., n) N */
    double *outputs;     /* (., o) */
    double *drivers;     /* (., N) */
    double *hoist;       /* (., 10): as `pmr_further` has them */
    int32_t *parts;      /* (.,) */
    double *ends;        /* (parts of a step, 3 + N): of the last step, not a row each; at the end of each of its parts a
                            free extension with its rates, and the drivers */
} pmr_record;

/* `count` steps with drivers from `signals`, every `every`-th of them recorded; `parts` (count,) or NULL: of how many
   parts each is made, one of the settings' numbers.  `*taken` were taken: fewer than `count` if one failed. */
int pmr_advance(pmr_state *state, const pmr_signals *signals, int64_t count, int64_t every, const int32_t *parts,
                const pmr_record *record, int64_t *taken);
/* The same with samples u (count * per + 1, N) at `per` equal parts of each step, the first where the step before
   ended. It stops before a step that needs more parts than it has samples of; `*needed` is their number, else 0. */
int pmr_advance_sampled(pmr_state *state, const double *u, int per, int64_t count, int64_t every, const int32_t *parts,
                        const pmr_record *record, int64_t *taken, int *needed);

/* Take `given` as motions (3, n) of a frame for a step if each is finite and within limits (5, n): its value from the first to
   the second, its change up to the third, its rate up to the fourth, and up to the fifth what it goes on without a second
   rate.  The number of the first that is not, and none is taken; -1: all are.  A motion whose limits are NaN stays. */
int pmr_take_motions(int n, double step, const double *given, const double *limits, double *motions);
/* Compares n motions (values, rates) at the end of a step with their rates.  In book (5, n): value and rate at the end of
   the step before, sum of changes, integral of the rates, and the distance at which these two are compared: 0 then, or -1 if
   they differ.  Returns how many differ in this step. */
int pmr_compare_rates(int n, double step, const double *motions, double *book);

/* Outputs y (o,) and forces (forces,) of all contacts, either NULL, where the state stands. */
void pmr_outputs(pmr_state *state, double *y, double *forces);
/* Some of them, by their numbers (count,): of outputs, behind these of forces, and behind these of outputs of a hoist, of
   a free luffing angle and of outriggers, and behind these of motions of a frame; PMR_LIFTED or PMR_NOT_FINITE where
   those of outriggers are not found. */
int pmr_observe(pmr_state *state, int count, const int32_t *numbers, double *values);

#define PMR_SELDOM 16
/* Sums with limits: sum k adds up the entries from first[k] to before first[k + 1], values times `shares`.  It has to stay
   between two limits.  A sum that belongs to a family, such as the forces of pads, may also be negative by law[0] times
   what it was at most so far, or by law[0] times law[1] times the largest size of the family's sums so far. */
typedef struct {
    int32_t count, often;    /* the first `often` sums are looked at in each step, all in each `PMR_SELDOM`-th one */
    const int32_t *first;    /* (count + 1,) */
    const int32_t *numbers;  /* (entries,): of the values, as in `pmr_observe` */
    const double *shares;    /* (entries,) */
    const double *limits;    /* (count, 2) */
    const int32_t *groups;   /* (count,): a group has one warning */
    const int32_t *until;    /* (count,): group whose warning ends the look at the sum, -1: none */
    const int32_t *family;   /* (count,), -1: none */
    const double *law;       /* (2,) */
    double *values;          /* (entries,) */
    double *largest;         /* (2 count,): so far, of sums, and behind these of the sizes in families */
    int32_t *warned;         /* (groups,): whether a sum of the group was beyond its limits */
} pmr_limits;

/* The first of `count` sums of `values` beyond its limits whose group had no warning, which then counts as given; -1
   without one. */
int pmr_beyond(const pmr_limits *limits, int count);
/* The same of those values of a state that are looked at in its step; -1, too, where those of outriggers are not found. */
int pmr_watch(pmr_state *state, const pmr_limits *limits);
/* `pmr_observe`, or where `numbers` is NULL all outputs, and then `pmr_watch`, whose number k is returned as -1 - k. */
int pmr_observe_and_watch(pmr_state *state, int count, const int32_t *numbers, double *values, const pmr_limits *limits);
/* Further outputs (further,) where the state stands: in N and N m what a body presses on its rigid supports; in a frame
   the place of the tip from the pivot along axes of the ground in m, and the force of the luffing cylinder in N; the
   columns of `pmr_stand_columns` for outriggers; of a hoist the height of the hook, its place along axes of the ground in
   m, its swing along and across the boom's plane in rad, the force of the rope in N, and its pull on the winch along axes
   of the ground; those of a luffing angle or an extension that is free.  In a frame the motions are those of the last
   start or step that was told them.  Errors as `pmr_observe`. */
int pmr_further(pmr_state *state, double *further);

/* ---- continuous time ---- */

/* Values, or how they change; each may be NULL.  `closed` is told where it is found, and given where it is held:
   PMR_REFUSED without it. */
typedef struct {
    double *accelerations;              /* (r'), of modes without inertia as if they had it */
    double *outputs, *further, *forces; /* (o), (further), (forces) */
    int32_t *closed;                    /* (m) */
} pmr_values;

/* Values at z and v of the state under drivers u (N,), or motions (3, n) of a frame; errors as `pmr_observe`.  Multipliers of contacts that give
   way follow from the position; those of rigid ones, and friction, are those of the last step.  The state stays where
   it is. */
int pmr_evaluate(pmr_state *state, const double *at, int hold, const pmr_values *values);
/* How they change along a seed of drivers or motions, z and v, with the contacts that are closed staying so. */
int pmr_evaluate_along(pmr_state *state, const double *at, const double *seed, const double *z, const double *v,
                       int hold, const pmr_values *values);
/* Whether z (r',) and v (r',) leave rigid contacts where they are while the paths move at `rates` (P,): PMR_REFUSED with
   a reason in `why`. */
int pmr_check_start(pmr_state *state, const double *at, const double *rates, const double *z, const double *v,
                    char *why);

/* ---- laws alone, for statics, charts and other simulators ---- */

/* ---- a machine on outriggers (ground.c), along its axes: X, Y, and Z at a right angle to the ground ---- */

enum { PMR_MOST_OUTRIGGERS = 32 };
/* n outriggers, of which e are corners of the support polygon; the pivot is `height` m above the ground. */
typedef struct {
    int32_t outriggers, corners;
    double height;
    const double *places, *stiffness; /* (n, 2) m from the pivot, (n) N/m */
    const double *edges;              /* (e, 6): a wrench's moment about the edge from each corner on that tips the machine */
    const int32_t *at_corners;        /* (e): numbers of outriggers, anticlockwise */
} pmr_stand;
/* Forces (count, n) in N whose sums, and sums with x and y, are loads (count, 3) that act within the polygon. */
int pmr_stand_forces(const pmr_stand *stand, int64_t count, const double *loads, double *forces);
/* Columns (count, 6 + n + e + 1): force and moment about the pivot, which are given as wrenches (count, 6); forces of
   outriggers; margins over the edges that begin at the corners, N m; use of the polygon. */
int pmr_stand_columns(const pmr_stand *stand, int64_t count, const double *wrenches, double *columns);
/* Force and moment about the pivot (count, 6) by weight and inertia of m masses (m, 8): mass, place from the pivot,
   moments of inertia, whether it slews.  Angles (count, 3, 4) are slewing, roll, pitch and yaw, their rates and second
   rates; falling (count, 3) is gravity and the pivot's acceleration, upwards along axes of the ground. */
void pmr_masses_wrench(int32_t m, const double *masses, int64_t count, const double *angles, const double *falling,
                       double *wrenches);

/* Doubles of work that `pmr_contact` takes for m contacts. */
size_t pmr_contact_work(int m);
/* lambda (m,) of A lambda = b + w with lambda >= 0, w >= 0, lambda w = 0 at those that push and w = 0 at the others.
   A (m, m) symmetric and positive definite; b (m,): how far they would come out beyond their clearances without forces.
   `closed` (m,) is what it begins with, and tells which are closed.  PMR_DEPENDENT, PMR_UNSETTLED as for a step;
   `*trouble`, unless NULL, is the number of the contact that PMR_DEPENDENT is about, else -1. */
int pmr_contact(int m, const double *A, const double *b, const int32_t *pushes, double *lambda, int32_t *closed,
                double *work, int *trouble);
/* How the same search stands where the caller solves for the forces of closed contacts: fewest contacts that were
   wrong, and how often all wrong ones may still change sides.  Zeros begin a search. */
typedef struct {
    int32_t fewest, chances;
} pmr_search;
/* Leave in `wrong` (m,), the contacts that pull although they only push or overlap although they are open, those that
   change sides before the next solve.  Returns how many were wrong. */
int pmr_choose_changes(int m, int32_t *wrong, pmr_search *search);
/* Iterates of a fixed point x = phi(x), of which the first `measured` numbers count in a residual's size.  All arrays
   begin on a multiple of 32 bytes, `count` and `measured` are multiples of four. */
typedef struct {
    double *x, *f;                /* (count,): iterate and residual phi(x) - x */
    double *least_x, *least_f;    /* (count,): where the residual was least so far, and that */
    double *directions, *changes; /* (most, count) */
    int32_t count, measured, most, pairs, begun;
    void (*sum)(double *value, void *context); /* NULL; or adds up an inner product of all parts of an iterate */
    void *context;
} pmr_iteration;
/* Forget all iterates before, as where phi has become another function. */
void pmr_restart(pmr_iteration *iteration);
/* Replace x, whose residual is f, by the next iterate (extrapolation.c). */
void pmr_extrapolate(pmr_iteration *iteration);
/* Factors of generalized-alpha.  With a the acceleration-like variable and z'' the acceleration,

       a* = a_from_share a + a_from_force z'',    v* = v + v_from_share a + v_from_force z'',
       z* = z + h v + z_from_share a + z_from_force z''

   are what a step begins with, and its acceleration adds gain, v_gain and z_gain times itself to them. */
typedef struct {
    double h;
    double gain, v_gain, z_gain;
    double a_from_force, a_from_share, v_from_force, v_from_share, z_from_force, z_from_share;
} pmr_factors;
/* Factors of a step of h s with the spectral radius rho_inf at infinite frequency. */
void pmr_scheme_factors(double h, double rho_inf, pmr_factors *factors);
/* Cylinder of a joint whose pads rub. */
typedef struct {
    double gives;      /* m/N: 1/k; 0 of a rigid one or none */
    double compliance; /* m/N: its diagonal entry of A */
    double force;      /* N: its multiplier */
    double friction;   /* N: sum of the pads' friction under which that was found */
    double drive;      /* N: force plus friction at the end of the last step */
} pmr_cylinder;
/* Friction f (n,) N of the pads of one joint at the end of a step, of elements that stick with stiffness kappa (n,) N/m
   and slide at limits (n,) N, by `laws` (n, LAW_CONSTANTS) and the pads' forces (n,) N; from the `old` one (n,) N, where the
   path of the joint has moved by `moved` m, at a speed of `speed` m/s.  Returns their sum. */
double pmr_friction(int n, const double *kappa, const double *laws, const double *forces, const double *old,
                    double moved, double speed, const pmr_cylinder *cylinder, double *limits, double *f);

/* ---- a bank of models along a path, for a place that nobody measures ---- */

/* S places, D speeds and n states; probabilities of a step.  Arrays stay as long as they are used. */
typedef struct {
    int32_t places, speeds, states;
    const double *F, *H, *gain, *variance; /* (S, n, n), (S, n), (S, n), (S): maps, outputs, gains, variances of these */
    const double *up, *down;               /* (D,): that a speed leads to the next place, or to the one before */
    const double *rest, *active;           /* (D, D): that speeds change, at rest and in motion */
    double temper;                         /* exponent of likelihoods, 0 to 1 */
    double attack, decay, floor;           /* shares by which the level of innovations follows, and its least value */
} pmr_bank;

/* Probabilities of speeds and places (., D, S), mean states (., n) and level (.,), a row each step. */
typedef struct {
    double *probability, *states, *level;
} pmr_bank_record;

/* Doubles of a bank's memory; all places equally likely; `steps` steps with measurements y, NaN where there is none, by
   how much each is in motion (0 to 1), the least level of each, and logarithms (steps, D) of the likelihoods of speeds. */
size_t pmr_bank_memory(const pmr_bank *bank);
void pmr_bank_start(const pmr_bank *bank, double *memory);
void pmr_bank_advance(const pmr_bank *bank, double *memory, int64_t steps, const double *y, const double *activity,
                      const double *least_level, const double *of_speeds, const pmr_bank_record *record);
/* Probabilities of places (steps, S) from those of speeds and places, each by the measurements of up to `delay` further
   steps.  `memory` is as long as that of the bank, which it replaces. */
void pmr_bank_places(const pmr_bank *bank, double *memory, int64_t steps, const double *activity, int64_t delay,
                     const double *probability, double *places);

/* ---- a Kalman filter on linear models of steps ---- */

/* n = 3 r states of a prediction of r modes, q outputs, p sensors, i loads of the model; what else is not known, by numbers of loads,
   outputs and sensors, those of sensors ascending (filter.c).  N = n + loads + payload + parameters + biased + scaled +
   off.  Arrays stay as long as they are used. */
typedef struct {
    int32_t states, outputs, sensors, inputs;
    int32_t loads, parameters, biased, scaled, off;
    int32_t payload, acceleration;  /* load by the payload, less than 0: none; output: acceleration of its place */
    double gravity;                 /* m/s^2 */
    double gate, refused;           /* innovations over their deviation that count less, and not at all */
    double alarm, share;            /* mean square of innovations of a doubted sensor, share by which it follows */
    double following;               /* share by which mean squares of outputs follow */
    const int32_t *sensor_outputs;  /* (p,) */
    const int32_t *load_inputs;     /* (loads,) */
    const int32_t *considered;      /* (parameters,): 1 if it has no gain */
    const int32_t *biased_sensors, *scaled_sensors, *off_sensors;
    const double *noise, *errors;   /* (p,) deviations, (q,) shares of the model's error */
    const double *decay, *added;    /* (N,): in a step, from the loads on; variance that each step adds */
    const double *rough;            /* (loads,) N: deviation within a step */
    const double *courses;          /* (5, 4, r): of pmr_linear_courses */
} pmr_filter;

/* Linear model of a step as pmr_linear_step has it, and how outputs change with parameters and by each kg of payload,
   (q, parameters). */
typedef struct {
    const double *reference, *R, *G, *C, *D, *sensitivity, *per_kilogram;
} pmr_filter_step;

/* How a measurement is used: if the model can explain it, or only if it is near where the sensor is doubted; as if what
   is expected were measured where there is none; not at all, though it has an innovation. */
enum { PMR_IF_POSSIBLE, PMR_IF_NEAR, PMR_AS_EXPECTED, PMR_NOT_USED };
/* Most that a normalised innovation counts in the running mean square. */
enum { PMR_MOST_SQUARE = 1000 };

/* Numbers N of a state and L of a row, whole registers; doubles of the memory, and how many of them, the first, are to be
   kept between steps: X (L,), P (N, L), mean squares of outputs (q,) and of innovations (p,). */
typedef struct {
    size_t states, stride, memory, kept;
} pmr_filter_counts;

void pmr_filter_sizes(const pmr_filter *filter, pmr_filter_counts *counts);
/* Begin with X (N,), P (N, N) and mean squares of outputs (q,). */
void pmr_filter_start(const pmr_filter *filter, double *memory, const double *x, const double *P, const double *square);
/* Correct by measurements (p,), not finite where there is none, each used as `use` (p,) says; innovations (p,) over their
   standard deviations, NaN without a measurement.  0, or PMR_NOT_FINITE where the covariance of the measurements is not
   positive definite, as of a model with infinite numbers. */
int pmr_filter_update(const pmr_filter *filter, double *memory, const pmr_filter_step *step, const double *measured,
                      const int32_t *use, double *innovations);
/* Mean and variance (q,) of outputs after a correction; then go on to the next step. */
void pmr_filter_outputs(const pmr_filter *filter, double *memory, const pmr_filter_step *step, double *mean,
                        double *variance);
void pmr_filter_predict(const pmr_filter *filter, double *memory, const pmr_filter_step *step);

/* ---- linear models of steps for outputs that are chosen ---- */

/* q outputs of i loads and r modes: columns (q,) among outputs of the bodies and, behind them, forces of all contacts;
   orders (q,), 0 to 2, of their rates; numbers of the drivers (i,) and of the modes (r,), without padding. */
typedef struct {
    int32_t outputs, inputs, modes;
    const int32_t *columns, *orders, *loads, *at_modes;
} pmr_chosen;

/* Acceleration of the modes by the prediction, R (r, 2 r) of z* and v*, and by loads, G (r, i); outputs by both, C (q, 2 r)
   and D (q, i); reference (q,).  Where there are rates, outputs are Y z + loaded with Y (q, r), loaded (q,), and motion
   (3 r,) is z, z', z''. */
typedef struct {
    double *reference, *R, *G, *C, *D, *shapes, *loaded, *motion;
} pmr_linear_step;

/* Courses (5, 4, r), which are the same in all steps: z*, v* and a* of the next prediction, then z and z' at the end of
   the step, as sums of z*, v*, a* and the acceleration of the same mode. */
void pmr_linear_courses(pmr_state *state, const pmr_chosen *chosen, double *courses);
/* Matrices of the step to drivers u (N,), before it is taken; then what they are about, after it.  Return as
   a step and pmr_evaluate; PMR_REFUSED with a hoist.  Contacts that are closed stay so, and pads that stick or slide;
   what friction remembers of the step before stays too. */
int pmr_linear_matrices(pmr_state *state, const pmr_chosen *chosen, const double *u, const pmr_linear_step *to);
int pmr_linear_outputs(pmr_state *state, const pmr_chosen *chosen, const double *u, const pmr_linear_step *to);
/* Put rates into C, D and reference of `now`: y' = Y z' + Y' z and y'' = Y z'' + 2 Y' z' + Y'' z, with Y of neighbours
   that are `step` s apart; NULL at the ends, beyond which Y goes on along a straight line. */
void pmr_output_rates(const pmr_chosen *chosen, const double *courses, double step, const pmr_linear_step *before,
                      const pmr_linear_step *now, const pmr_linear_step *after);

/* ---- up to here ---- */

#ifdef __cplusplus
}
#endif

#endif
