/* The law of friction: a new one is another `friction_limit`, its constants those of `FrictionLaw` in
   pmr/scene/joints.py, by name and order. */
#ifndef PMR_LAW_H
#define PMR_LAW_H

#include <math.h>
#include <stddef.h>

/* ---- from here on cffi reads this file: declarations only ---- */

/* Constants of a pad's law: coefficients of a pad that slides and of one at rest (0: that of sliding), speed in m/s by
   which it falls from the latter to the former. */
enum { FRICTION, STATIC_FRICTION, STRIBECK_SPEED, LAW_CONSTANTS };

/* ---- up to here ---- */

/* Derivatives of a pad's largest friction with respect to the size |N| of its force, and to the speed, in N s/m. */
typedef struct {
    double by_force, by_speed;
} pmr_friction_slopes;

/* Largest friction of a pad that presses with a force, mu(v) |N|, and how it changes with the force and the speed,

       mu(v) = mu_k + (mu_s - mu_k) exp(-v / v_s)

   (Stribeck 1902, in the form of Bo and Pavelescu 1982); Coulomb's law where no mu_s > mu_k is given.  It has to be
   0 where the force is 0, for pads that have lifted off have the same law. */
static inline double friction_limit(const double *law, double force, double speed, pmr_friction_slopes *slopes)
{
    const double more = law[STATIC_FRICTION] - law[FRICTION];
    double falls = 0.0;
    if (more > 0.0) falls = more * exp(-speed / law[STRIBECK_SPEED]);
    if (slopes) {
        slopes->by_force = law[FRICTION] + falls;
        slopes->by_speed = -falls / law[STRIBECK_SPEED] * fabs(force);
    }
    return (law[FRICTION] + falls) * fabs(force);
}

#endif
