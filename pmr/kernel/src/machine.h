/* A machine and the boom that it carries, at one moment: what moments.c, whole.c and machine.c share. */
#ifndef PMR_MACHINE_H
#define PMR_MACHINE_H

enum { MOST_SECTIONS = 16, ROTATING = 3, SECOND = 9 };

typedef struct {
    double extension[3], length[3]; /* m with rates: how far it is out, and its tail from the base's along the boom */
    double d[3], own[3];            /* m, kg m: its tail and its first moment from the pivot */
    double mu[3][4][3];             /* moments with rates */
} carried_section;

typedef struct {
    double s[3][3], inertia[9], inertia_rate[9], h[3], h_rate[3]; /* first moment with rates, Theta, int rho rho x rho' */
} boom_moments;

/* How a machine carries its boom. */
typedef struct {
    double R[9], v[3], omega[3], turned[9], left[3], axes[9];
    double base_R[9], base_omega[3];
} carrier;

/* A cylinder: what is recorded; flows into both chambers as the step averages them; by how much its drive was longer at
   the start, and the force of a length's spring then; its friction. */
typedef struct {
    double length, speed, force, pressures[2], flows[2], fed[2], supplied, mean[2], begun, held, friction;
    int32_t emptied; /* a chamber has no volume */
} cylinder_state;

typedef struct {
    double momenta[6], forces[6], springs[6], axes[9];
} machine_whole;

/* What the next step depends on. */
typedef struct {
    double b[18], smooth[6], felt[6], forces[6], fastest[2], slope[36], rates[3][6], momenta[6], held[6];
    carrier carrier;
    machine_whole whole;
    cylinder_state cylinder;
    double answer_off;   /* of the answer to a rate of a single direction (machine.c) */
    int32_t rates_known, slope_known, answers, answer_age, answer_taut;
} machine_past;

/* A motion that a step may end with. */
typedef struct {
    double b[18], felt[6], left[6];
    carrier carrier;
    machine_whole whole;
    cylinder_state cylinder;
} trial;

/* What the next step of a free extension depends on: its rates, its second rate as generalized-alpha averages it, and how
   what it leaves of its equation grows with the second rate. */
typedef struct {
    double at, rate, second, smooth, slope;
    cylinder_state cylinder;
} extension_past;

struct pmr_machine_run {
    const pmr_machine *machine;
    pmr_state *state;
    pmr_machine own; /* of a free luffing angle: arrays of two steps */
    double loaded[3]; /* N, Pa: force of a length's spring, and pressures, at the start */
    int32_t moves;                 /* whether a path does */
    int32_t rows_known;            /* orders of rates that the tables have; 0: they are of another moment */
    int32_t *ranges;               /* (matrices, MOST_SECTIONS + 1, 2) of modes (moments.c) */
    machine_past past;
    trial now;
    carried_section of[MOST_SECTIONS];
    boom_moments boom;
    pmr_progress progress;
    int32_t *giving, count, orders; /* contacts that give way; rates of moments that are asked for, and one */
    int32_t failed;                 /* PMR_DEPENDENT where these depend on each other */
    moved *paths;
    moved_tables tables; /* of the contacts that give way, with their rates */
    double *answer, *answer_drift, *tried; /* (end): how a step's end changes by the rate; that from step to step; end of a
                                              first trial */
    double *saved, *motions, *inertia, *inertia_smooth, *new_inertia, *new_smooth, *u, *u_old, *accelerations, *begun;
    double *factor, *lambda, *right, *product;
    double *inertial[3]; /* (ip): displacements of inputs' points by inertia alone, with their rates */
};

#endif
