/* What drives a body: loads and terms from the inputs, and where the tip of a boom in a frame that moves is in space.

   An input has a value and its first three rates, with which it goes on: u(t) = u + u' t + u'' t^2/2 + u''' t^3/6.
   Loads f are inputs as they are; where a frame moves (FRAME) they and the amplitudes c of the terms are sums of products
   of few quantities (`pmr/simulation/products.py`), which follow from the angles of the frame, from paths and loads. */
#ifndef DRIVE_H
#define DRIVE_H

#include "body.h"

/* Numbers of the inputs among all, less than 0 where there is none: luffing, slewing, roll, pitch and yaw of the base; the
   paths by which sections slide, from number 1 on. */
#if FRAME
enum { ANGLES = 5 };
extern const int angle_drivers[ANGLES];
extern const int section_paths[];
/* The tip from the pivot without extensions, m, and the outputs that tell how far it moves, less than 0: none. */
extern const double tip_place[3];
extern const int tip_outputs[3];
/* A quantity by its kind and two numbers: axes; the input of a DRIVER; section and order of a REACH; section of an OVER. */
enum { ONE, TURNED, VELOCITY, TURNING, GRADIENT, DRIVER, REACH, OVER };
extern const int quantities[QUANTITIES][3];
/* Each product is a factor times three quantities; each load, then each term, the sum of some of them. */
extern const double factors[];
extern const int products[][3];
extern const int first_product[INPUTS + TERMS + 1];
#if LUFFING
/* Of the cylinder that raises the boom x and z of foot and lug in m; its forces, numbers of outputs or -1 - k of contact k; and the
   moment about the pivot of a unit of each, in m, and what a metre of each path adds. */
extern const double luffing_hinges[4];
extern const int luffing_sources[LUFFING];
extern const double luffing_moments[LUFFING][1 + PATHS];
/* Outputs of the pin's forces along x and z, less than 0 where no pin bears what the cylinder does not, and the force of the
   support across the boom that stands for the cylinder, as among the sources. */
extern const int luffing_pin[3];
#endif
#endif
/* Entries of T for an amplitude of 1, those of one term after the other: where they stand, and their values. */
#if TERMS
extern const int first_entry[TERMS + 1];
extern const int entries[][2];
extern const double entry_values[];
#endif

/* Angles but that of slewing turn once at most, rad; inputs that a step leaves farther than this share of their range, or of
   a turn, jump; and a motion in a frame that goes on by so much, m or rad, without second rates has no inertia. */
#define WHOLE_TURN 6.283185307179586
#define JUMP 0.1
#define LEFT_OUT 1e-6

/* Warn of such inputs before a step, once each. */
void check_inputs(Body *body);

/* VALUES: loads and terms; RATES: how loads and the tip change in time and along a seed too. */
enum { VALUES = 1, RATES };

/* Lead the inputs on by a time from their values and rates `given` (4 DRIVERS,). */
void drive_on(double *variables, const double *given, double time);

/* Loads and terms, at least as much as is asked for; along a seed (VARIABLES,) where there is one. */
void find_drive(Body *body, int what, const double *seed);

/* forces -= T x with x = (z, v): the first MODES of them on modes, the others of supports. */
void subtract_terms(double T[PUSHED][2 * MODES], const double *x, double *forces);

/* Add to the outputs in `found` (VARIABLES,), or where there is a seed to how they change along it, what rows and loads do
   not have of them: the place of the tip, the force of the cylinder that raises
   the boom, from all others, and of reactions what rates of the modes and `pushed` (PUSHED,) by terms make. */
void add_outputs(const Body *body, const double *seed, const double *v, const double *pushed, double *found);
void add_output_rates(const Body *body, const double *seed, double *found);

#endif
