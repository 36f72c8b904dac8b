/* What the parts of the kernel share: the layout of a system and of a state.  variant.c puts them together. */
#ifndef PMR_INTERNAL_H
#define PMR_INTERNAL_H

#include "pmr_kernel.h"

/* Modes, inputs, outputs and rows are filled up with zeros to so many, so that no loop over them has a remainder. */
#define PMR_LANES 4
#define PMR_UP(n) (((n) + PMR_LANES - 1) / PMR_LANES * PMR_LANES)
#define PMR_LINE 64
#define PMR_SPAN 16
#define PMR_MOST_LEVELS 64

#if defined __GNUC__
#define INLINE static inline __attribute__((always_inline))
#define APART static __attribute__((noinline))
#else
#define INLINE static inline
#define APART static
#endif

/* Change of forces of terms and of friction that counts as none, and what is accepted after the last time, over the
   largest. */
#define PMR_CONVERGED 1e-11
#define PMR_ACCEPTED 1e-8
/* Omega^2 of rigid motions, over that of the stiffest mode, at most. */
#define RIGID_MOTION 1e-9

/* Sides that travel along one path on one body.  Their tables are polynomials in s between breaks, the highest power
   first: of C (rows, modes), G (rows, rows), S (rows, stays), H (rows, inputs) and X (rows, outputs), each row filled
   up. */
typedef struct {
    int32_t path, body, intervals, rows, stays;
    int32_t first_mode, modes, first_input, inputs, first_output, outputs;
    int32_t powers_C, powers_G, powers_S, powers_H, powers_X;
    int32_t at_breaks, at_rows, at_C, at_G, at_S, at_H, at_X;
    int32_t carriers, width, at_touched, at_weights; /* of blocks that another path on the same body is coupled with */
} pmr_block;

/* Two blocks of one body on different paths: G between their rows is w(s) R v(s')^T with weights w and v on carriers.
   */
typedef struct {
    int32_t first, second, at_between;
} pmr_pair;

enum { PMR_BLOCK_NUMBERS = sizeof(pmr_block) / sizeof(int32_t), PMR_PAIR_NUMBERS = sizeof(pmr_pair) / sizeof(int32_t) };

/* Outputs, or reactions of supports: what they are of modes, loads and multipliers. */
typedef struct {
    int width, reactions; /* of rows; whether they are reactions */
    const double *shapes, *direct, *X0, *table; /* (r', width), (i, width), (rows, width); polynomials of blocks */
    /* (width / PMR_SPAN, 3, 2): the modes, inputs and rows, first and behind the last one, by which so many outputs
       change: each body has its own */
    int32_t *spans;
} pmr_observed;

/* A free extension (extension.c): the motion that drives its cylinder, less than 0: none; within which lengths rows are
   known; of each section that moves with it its motion, path, the contact that holds it along the boom and the joint
   whose pads rub, less than 0: none, and how it follows, s = ratio * extension + offset. */
typedef struct {
    int32_t sections, drive; /* 0 sections without a free extension */
    double range[2];         /* m */
    const int32_t *moved;    /* (sections, 4) */
    const double *ratios;    /* (sections, 2) */
    pmr_actuator cylinder;
} pmr_extension;

struct pmr_system {
    const char *block; /* the bytes */
    size_t bytes;
    uint64_t checksum;
    /* sizes: `rows` are contacts and, behind them, the moments of pads that rub */
    int32_t modes, rows, contacts, forces, inputs, outputs, paths, terms, pads, joints, drivers, blocks, pairs;
    int32_t whole;   /* all rows are those of one block, so that its tables are the rows */
    int32_t coupled; /* damping couples modes */
    int32_t ropes;   /* paths by which ropes get longer */
    int32_t mp, ip, op, pushing, quasi_static, registers, entries, largest_table;
    const double *omega2;          /* (r') */
    const double *damping;         /* (r'), or (r', r') where it couples */
    const double *inertia;         /* (r'): 1, or 0 of modes without */
    const double *B;               /* (i, r') */
    const double *shapes, *direct; /* (r', op), (i, op) */
    const double *load_energy;     /* (i, ip): B^T R B */
    const double *clearance;       /* (rows) m */
    const int32_t *pushes;         /* (rows) */
    const int32_t *row_modes;      /* (rows, 2): modes that a row touches */
    int32_t *input_modes;          /* (i, 2): modes that a load touches */
    int32_t *mode_inputs;          /* (r' / PMR_LANES, 2): loads that touch so many modes */
    double *give;                  /* (r'): 1 / Omega^2, or 0 of rigid motions */
    const double *path_ends;       /* (P, 2) m */
    const pmr_block *block_list;
    const pmr_pair *pair_list;
    const double *breaks;
    const int32_t *block_rows;
    const double *table_C, *table_G, *table_S, *table_H, *table_X;
    const double *C0, *F0, *H0, *X0; /* (rows, r'), (rows, mp), (rows, ip), (rows, op): of what stays */
    const int32_t *touched;
    const double *weights, *between;
    const int32_t *rope_paths; /* (ropes) */
    const double *rope_slopes; /* (ropes, rows, mp) 1/N: dA/ds */
    const double *shares;      /* (forces, mp): forces of all contacts from multipliers */
    const int32_t *of_modes;   /* (quasi_static): modes without inertia */
    /* terms: registers of four rows, of which those of one block of rows stand together, those on z before those on
       z' */
    const int32_t *of_rows;      /* (r' / 4, 3) */
    const int32_t *columns;      /* (registers) */
    const int32_t *first_entry;  /* (K + 1) */
    const int32_t *registers_of; /* (entries): the register that an entry of a term is added to */
    const double *entry_values;  /* (entries, 4): with amplitudes of 1 */
    /* friction */
    const int32_t *joint_paths, *joint_cylinders, *first_pad, *pad_contacts;
    const double *joint_gives, *pad_laws, *pad_stiffness, *pad_arms;
    /* a frame that moves (frame.c); without one there are no motions */
    int32_t motions, quantities, product_count;
    const int32_t *frame_angles;  /* (5): motions that are luffing, slewing, roll, pitch and yaw; less than 0: none */
    const int32_t *frame_paths;   /* (P): motions that are the paths */
    const int32_t *quantity_list; /* (quantities, 3): kind and two numbers */
    const int32_t *products;      /* (products, 3): quantities of each */
    const int32_t *first_product; /* (N - P + 1): of loads, amplitudes of terms and drivers of a hoist */
    const double *factors;        /* (products) */
    /* further outputs: reactions of rigid supports, in bodies' tables as outputs are; what rates of modes add to them,
       and entries of each term; in a frame the tip and the luffing cylinder (frame.c) */
    int32_t reactions, hp, has_tip, has_cylinder; /* width of rows of reactions */
    const double *reaction_shapes, *reaction_direct, *reaction_X0, *table_R; /* (r', hp), (i, hp), (rows, hp) */
    const double *reaction_rates;                                            /* (r', hp) */
    const int32_t *reaction_blocks;  /* (blocks, 4): first reaction, number, powers, place in the table */
    const int32_t *support_first;    /* (K + 1): entries of terms on supports */
    const int32_t *support_entries;  /* (entries, 2): reaction; mode, or r' and mode of a rate */
    const double *support_values;    /* (entries) */
    const int32_t *tip_numbers;      /* (4): outputs along x, y and z, less than 0: none; paths that lead to the tip */
    const double *tip_place;         /* (3) m, without extensions */
    const double *cylinder_hinges;   /* (4) m: x and z of foot and lug */
    int32_t pressing;                /* K: forces with which the boom presses on the ground */
    const int32_t *pressing_numbers; /* (K): outputs, behind them reactions, behind them forces of contacts */
    const double *pressing_wrenches; /* (K, 6, 1 + P): about the pivot by a unit of each, and by each path */
    const int32_t *cylinder_pin; /* (3): reactions of a pin along x and z, less than 0: none; source at the lug */
    /* outriggers (ground.c): their outputs, 0 without any; masses of the machine */
    int32_t ground, ground_mass_count, ground_reads_outputs;
    const int32_t *ground_numbers; /* (5): motions that accelerate the base, gravity, force of a cylinder which gives way;
                                      less than 0: none */
    const double *ground_masses;   /* (masses, 8) */
    pmr_stand stand;
    /* a hoist (hoist.c) */
    int32_t hoist;               /* k: inputs by which its rope pulls the bodies; 0 without one */
    const int32_t *hoist_inputs; /* (k) */
    const int32_t *hoist_slots;  /* (PMR_HOIST_SLOTS): drivers that it is driven by, less than 0: by none */
    const double *hoist_shares;  /* (PMR_HOIST_SLOTS, 2): what a slot is besides, and factor of its driver */
    const double *hoist_levers;  /* (k, 6): how far a unit along each input moves the head, and the winch */
    const double *hoist_numbers; /* (PMR_HOIST_NUMBERS) */
    const double *hoist_reach;   /* (2, P): paths that the head moves along with, and the winch */
    /* a luffing angle (luffing.c) or an extension that is free: its outputs, 0 without one.  Of the angle motions that are
       gravity and the cylinder's drive, less than 0: none; the boom as a machine that pitches, with a cylinder whose
       arrays over time each state has by itself */
    int32_t computed, luffing_gravity, luffing_drive;
    pmr_machine boom;
    pmr_extension extension;
    pmr_observed observed[2];    /* outputs, reactions */
};

enum { PMR_HOIST_SLOTS = 19, PMR_HOIST_NUMBERS = 19, PMR_HOIST_STATE = 32, PMR_HOIST_OUTPUTS = 10 };

/* Kinds of quantities, by two numbers: axes; the motion; number of paths and order of the rate; the path from 1 on. */
enum { PMR_ONE, PMR_TURNED, PMR_VELOCITY, PMR_TURNING, PMR_GRADIENT, PMR_MOTION, PMR_REACH, PMR_OVER, PMR_RAISED };

/* Generalized-alpha with one length of step. */
typedef struct {
    double h;
    double z_gain, v_gain, gain; /* what an acceleration adds to z, v and a */
    double z_from_v, z_from_a, z_from_acceleration, v_from_a, v_from_acceleration, a_from_a, a_from_acceleration;
    /* what a force of the step before leaves */
    double a_from_force, a_from_share, v_from_force, v_from_share, z_from_force, z_from_share;
    double *stiffness, *damping, *unit; /* (r'): Omega^2 / S, D / S and 1 / S, S = 1 + D v_gain + Omega^2 z_gain */
    double *inverse;                    /* (r', r'): S^-1 where damping couples modes */
    double *F0;                         /* (rows, mp): A of what stays */
    /* A = F + z_gain C S^-1 C^T has tables of its own, made on the way into an interval */
    double *of_blocks;  /* block after block: of G (powers, rows, up(rows)), then of S (powers, rows, up(stays)) */
    int32_t *in_blocks; /* (blocks): the interval that they are of */
    double *of_pairs;   /* polynomials in both places */
    int32_t *in_pairs;  /* (pairs, 2) */
} pmr_scheme;

/* A number in time, with its first and second rate. */
typedef struct {
    double at, rate, second;
} moved;

/* What a state is saved with besides its numbers. */
typedef struct {
    int64_t step;
    int32_t level, active, came, parts, ready, spare;
    double largest;      /* N: largest force so far */
    double term_largest; /* largest |w|^2 so far */
    double term_first, term_change, term_shrinks, term_trusted;
    double gap_largest, rub_largest; /* m and N^2: largest gap and |w|^2 that friction could make so far */
} pmr_progress;

struct pmr_state {
    const pmr_system *system;
    pmr_settings settings; /* parts point into the block */
    pmr_progress progress;
    size_t memory; /* bytes of the block that this struct begins */
    /* numbers that a step which is taken back returns to, one array after the other, filled up to registers */
    double *mark;
    double *hoist, *pulls; /* (PMR_HOIST_STATE), (k) N: where the rope stands, its forces on the inputs (hoist.c) */
    double *motions; /* (4, n): motions where it stands; how many rows of those count */
    double *computed, *computed_past; /* outputs of a free luffing angle or extension; what its next step depends on */
    pmr_machine_run *run;           /* of the free luffing angle, or NULL */
    size_t marked;                                       /* doubles */
    double *z_next, *v_next, *a_next, *z_free, *z, *v;   /* (r') */
    double *lambda, *force, *share, *closed, *impulse;   /* (mp): lambda of moments behind those of contacts */
    double *energy;                                      /* (4): stored, work, work of terms */
    double *old_friction, *old_gap, *drives, *travelled; /* (pads), (mp), (joints), (joints): at the end of the step */
    /* saved too */
    double *w, *old_w, *extra; /* (r'), (4, r'), (r'): forces of terms, of the steps before; with moments of friction */
    double *accelerated;       /* (r') */
    double *friction, *gap;    /* (pads), (mp) */
    double *joint_sums;        /* (joints) N: friction that the gaps are of */
    double *u;                 /* (N): drivers where it stands */
    size_t saved;              /* doubles */
    size_t stepped;            /* doubles that a step changes, or that it computes anew at its end */
    double *answer, *answer_drift; /* of a free luffing angle (machine.h) */
    /* workspace */
    double *began, *peak;
    double *s, *s_rates, *x; /* (P), (P), (blocks): paths, their rates at the start, places in blocks' intervals */
    moved *moved_paths;      /* (P) */
    int32_t *interval;
    double *C, *H, *A, *factor;
    double *weighted, *excess, *entries, *motion, *pushed;
    double *push, *pulled, *turned, *others, *scratch, *held;
    double *loads, *known_amplitudes, *now; /* (ip), (K), (registers, 4) */
    double *slopes, *seeds;                 /* of rows by each path, and along seeds: for derivatives */
    int32_t *numbers, *wrong;
    double *old_z, *old_push, *old_C, *old_A, *old_H, *old_loads, *old_lambda;
    double load_energy, old_load_energy;
    double *acceleration, *before_closed, *before_lambda;
    double *w_new, *w_divided, *z_before; /* (r') */
    double *limits, *new_moments, *along, *new_sums, *pair_sums;
    pmr_iteration iteration;
    double *u_next, *u_begun;                        /* (N) */
    double *motions_next, *motions_now, *quantities; /* (4, n), (3, n), (quantities) */
    /* (op + hp + forces + 6): outputs, reactions, forces, a rope's wrench on a winch on the machine, and behind them outputs
       of a hoist and of what is computed; along a seed; (further) */
    double *values, *changes, *shown;
    double *kept; /* (saved): a state that trials of a free extension begin with */
    /* hoist: before a part, slots, forces; R (k, k) and what it is made of, (k, r') and (k, mp); places of inputs */
    double *hoist_before, *slots, *new_pulls, *receptance, *hoist_units, *hoist_rows, *hoist_held;
    double *hoist_free, *hoist_moved, *hoist_slope;
    const pmr_scheme *receptance_of;  /* scheme that R is of where the rows stand, or NULL */
    pmr_scheme *scheme, *still;       /* (levels), and without a step, for which A is F */
    int32_t opened;                   /* levels that there is room for */
    int32_t placed, factored, moved, trouble;
};

/* Functions of the interface that each kind of code has for its processor: what F returns, or P, which returns nothing;
   its name behind pmr_, its name in that code, parameters, arguments. */
#define PMR_OF_VARIANTS(F, P)                                                                                          \
    F(int, state_open, state_open,                                                                                     \
      (const pmr_system *system, const pmr_settings *settings, pmr_state **state, char *why),                          \
      (system, settings, state, why))                                                                                  \
    F(int, state_adjust, state_adjust, (pmr_state *state, const pmr_settings *settings, char *why),                    \
      (state, settings, why))                                                                                          \
    F(size_t, state_bytes, state_bytes, (const pmr_state *state), (state))                                             \
    P(state_save, state_save, (const pmr_state *state, void *bytes), (state, bytes))                                   \
    F(int, state_restore, state_restore, (pmr_state *state, const void *bytes, size_t count, char *why),               \
      (state, bytes, count, why))                                                                                      \
    F(int, start_moving, start,                                                                                        \
      (pmr_state *state, int kind, const double *u, const double *rates, const double *z, const double *v),            \
      (state, kind, u, rates, z, v))                                                                                   \
    F(int, start_in_frame, start_in_frame,                                                                             \
      (pmr_state *state, int kind, const double *motions, const int32_t *rows, const double *z, const double *v),      \
      (state, kind, motions, rows, z, v))                                                                              \
    F(int, step, step_to, (pmr_state *state, const double *u, const double *rates), (state, u, rates))                 \
    F(int, step_in_frame, step_in_frame, (pmr_state *state, const double *motions, const int32_t *rows),               \
      (state, motions, rows))                                                                                          \
    F(int, step_led, step_led, (pmr_state *state, const double *led, double since), (state, led, since))               \
    F(int, advance, advance_signals,                                                                                   \
      (pmr_state *state, const pmr_signals *signals, int64_t count, int64_t every, const int32_t *parts,               \
       const pmr_record *record, int64_t *taken),                                                                      \
      (state, signals, count, every, parts, record, taken))                                                            \
    F(int, advance_sampled, advance_sampled,                                                                           \
      (pmr_state *state, const double *u, int per, int64_t count, int64_t every, const int32_t *parts,                 \
       const pmr_record *record, int64_t *taken, int *needed),                                                         \
      (state, u, per, count, every, parts, record, taken, needed))                                                     \
    F(int, machine_run_open, machine_run_open, (pmr_state *state, const pmr_machine *machine, pmr_machine_run **run),  \
      (state, machine, run))                                                                                           \
    F(int, machine_run_holding_forces, machine_run_holding_forces,                                                     \
      (pmr_machine_run *run, const double *b, const double *z, const double *v, const double *a, double *needed),      \
      (run, b, z, v, a, needed))                                                                                       \
    F(int, machine_run_load_cylinder, machine_run_load_cylinder,                                                       \
      (pmr_machine_run *run, const double *b, const double *z), (run, b, z))                                           \
    F(int, machine_run_start, machine_run_start,                                                                       \
      (pmr_machine_run *run, const double *b, const double *z, const double *v, const pmr_machine_record *record),     \
      (run, b, z, v, record))                                                                                          \
    F(int, machine_run_advance, machine_run_advance,                                                                   \
      (pmr_machine_run *run, int64_t first, int64_t count, const pmr_machine_record *record, int64_t *taken),          \
      (run, first, count, record, taken))                                                                              \
    P(outputs, outputs, (pmr_state *state, double *y, double *forces), (state, y, forces))                             \
    F(int, observe, observe, (pmr_state *state, int count, const int32_t *numbers, double *values),                         \
      (state, count, numbers, values))                                                                                 \
    F(int, observe_and_watch, observe_and_watch,                                                                       \
      (pmr_state *state, int count, const int32_t *numbers, double *values, const pmr_limits *limits),                 \
      (state, count, numbers, values, limits))                                                                         \
    F(int, further, further_outputs, (pmr_state *state, double *further), (state, further))                                 \
    F(int, evaluate_along, evaluate_along,                                                                             \
      (pmr_state *state, const double *at, const double *seed, const double *z, const double *v, int hold,             \
       const pmr_values *values),                                                                                      \
      (state, at, seed, z, v, hold, values))                                                                           \
    F(int, check_start, check_start,                                                                                   \
      (pmr_state *state, const double *at, const double *rates, const double *z, const double *v, char *why),          \
      (state, at, rates, z, v, why))                                                                                   \
    P(filter_sizes, filter_sizes, (const pmr_filter *filter, pmr_filter_counts *counts), (filter, counts))             \
    P(filter_start, filter_start,                                                                                      \
      (const pmr_filter *filter, double *memory, const double *x, const double *P, const double *square),              \
      (filter, memory, x, P, square))                                                                                  \
    F(int, filter_update, filter_update,                                                                               \
      (const pmr_filter *filter, double *memory, const pmr_filter_step *step, const double *measured,                  \
       const int32_t *use, double *innovations),                                                                       \
      (filter, memory, step, measured, use, innovations))                                                              \
    P(filter_outputs, filter_outputs,                                                                                  \
      (const pmr_filter *filter, double *memory, const pmr_filter_step *step, double *mean, double *variance),         \
      (filter, memory, step, mean, variance))                                                                          \
    P(filter_predict, filter_predict, (const pmr_filter *filter, double *memory, const pmr_filter_step *step),         \
      (filter, memory, step))                                                                                          \
    P(linear_courses, linear_courses, (pmr_state *state, const pmr_chosen *which, double *courses),                    \
      (state, which, courses))                                                                                         \
    F(int, linear_matrices, linear_matrices,                                                                           \
      (pmr_state *state, const pmr_chosen *which, const double *u, const pmr_linear_step *to), (state, which, u, to))  \
    F(int, linear_outputs, linear_outputs,                                                                             \
      (pmr_state *state, const pmr_chosen *which, const double *u, const pmr_linear_step *to), (state, which, u, to))  \
    P(output_rates, output_rates,                                                                                      \
      (const pmr_chosen *which, const double *courses, double step, const pmr_linear_step *before,                     \
       const pmr_linear_step *now, const pmr_linear_step *after),                                                      \
      (which, courses, step, before, now, after))                                                                      \
    F(int, contact, contact_alone,                                                                                     \
      (int m, const double *A, const double *b, const int32_t *pushes, double *lambda, int32_t *closed, double *work,  \
       int *trouble),                                                                                                  \
      (m, A, b, pushes, lambda, closed, work, trouble))                                                                \
    F(int, choose_changes, choose_changes, (int m, int32_t *wrong, pmr_search *search), (m, wrong, search))            \
    F(double, friction, friction_alone,                                                                                \
      (int n, const double *kappa, const double *laws, const double *forces, const double *old, double moved,          \
       double speed, const pmr_cylinder *cylinder, double *limits, double *f),                                         \
      (n, kappa, laws, forces, old, moved, speed, cylinder, limits, f))                                                \
    P(extrapolate, extrapolate, (pmr_iteration *iteration), (iteration))                                               \
    P(scheme_factors, factors_alone, (double h, double rho_inf, pmr_factors *factors), (h, rho_inf, factors))

/* One kind of code. */
typedef struct {
    const char *name;
#define POINTER(result, name, code, parameters, arguments) result(*name) parameters;
#define VOID_POINTER(name, code, parameters, arguments) void(*name) parameters;
    PMR_OF_VARIANTS(POINTER, VOID_POINTER)
#undef POINTER
#undef VOID_POINTER
} pmr_functions;

/* How a frame, or the base that carries it, is turned: its rotation (3, 3) into axes of the ground, its angular velocity
   and acceleration in its own axes. */
typedef struct {
    double R[9], velocity[3], acceleration[3];
} pmr_turning;

/* u (N,) from motions (3, n); where the boom is turned so its paths, and the loads by some inputs or, without `inputs`, the
   first `count` of loads and amplitudes; how u changes along a seed of the motions.  With `pmr_frame_work` doubles. */
int pmr_frame_drivers(const pmr_system *system, const double *motions, double *u, double *work);
void pmr_frame_turned(const pmr_system *system, const double *motions, const pmr_turning *boom, int count,
                      const int32_t *inputs, double *u, double *work);
void pmr_frame_along(const pmr_system *system, const double *motions, const double *seed, double *u, double *along,
                     double *work);
/* Further outputs from values (op + hp + forces) and motions (3, n), and how they change along `seed`; a seed of NULL:
   values alone. */
int pmr_frame_outputs(const pmr_system *system, const double *motions, const double *seed, const double *values,
                       const double *changes, double *further, double *along);
/* Of these those of outriggers alone; PMR_LIFTED or PMR_NOT_FINITE where they are not found. */
int pmr_ground_outputs(const pmr_system *system, const double *motions, const double *seed, const double *values,
                       const double *changes, double *columns, double *along);
void pmr_frame_turning(const pmr_system *system, const double *motions, pmr_turning *boom, pmr_turning *base);
/* How fast the rate of a driver grows within h around t. */
double pmr_signals_spread(const pmr_signals *signals, int32_t driver, double t, double h);

extern const pmr_functions pmr_functions_avx2, pmr_functions_baseline;

/* Memory, and arrays of a block (block.c). */
enum { PMR_INTEGERS, PMR_NUMBERS, PMR_BYTES };
/* 1 with a reason in `why` if the head of a block, the places of its arrays or a number are not sound. */
int pmr_block_check(const pmr_system *system, char *why);
/* An array; NULL with a reason if it is missing or has not `count` entries (less than 0: any number). */
const void *pmr_block_take(const pmr_system *system, const char *name, int kind, int64_t count, char *why);
int64_t pmr_block_count(const pmr_system *system, const char *name);
uint64_t pmr_block_checksum(const pmr_system *system);
void pmr_say(char *why, const char *format, ...);
void *pmr_aligned(size_t bytes);
void pmr_free_aligned(void *memory);

#endif
