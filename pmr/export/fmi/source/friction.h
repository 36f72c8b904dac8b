/* Friction of pads (pmr/system/friction.py has the law, pmr/simulation/native/friction.py the iteration of a step).

   Of a pad that rubs with f on a face that is e from the axis and pressed with lambda, the moment e sign(lambda) f acts on the
   row C' of the pad, which stands behind the contacts with the multiplier -e sign(lambda) f.  A cylinder that gives way does so
   under the friction of its joint's pads too. */
#ifndef FRICTION_H
#define FRICTION_H

#include "body.h"

#if PADS
/* Of each joint the number of its path, of its cylinder's contact, less than 0: none, 1/k of that, 0: rigid, and where its
   pads begin; of each pad the number of its contact, mu, kappa in N/m and e in m. */
extern const int joint_paths[JOINTS];
extern const int joint_cylinders[JOINTS];
extern const double joint_gives[JOINTS];
extern const int first_pad[JOINTS + 1];
extern const int pad_contacts[PADS];
extern const double pad_coefficients[PADS];
extern const double pad_stiffness[PADS];
extern const double pad_arms[PADS];
#endif

/* Friction and its moments as the last step left them. */
void take_friction(Body *body);

/* motion -= A multipliers of the moments, and what cylinders give way to friction. */
void subtract_friction(const Body *body, double A[ROWS][ROWS], double *motion);

/* Find friction from the present multipliers: 0 where it is what these were found under, 1 where they have to follow, less than 0
   where it does not converge. */
int revise_friction(Body *body, int times);

/* End a step. */
void remember_friction(Body *body);

/* Add to the forces of contacts what cylinders bear of friction. */
void add_to_cylinders(const Body *body, double *forces);

#endif
