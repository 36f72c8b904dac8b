/* The law of friction: a new one is another `friction_limit`, its constants those of `FrictionLaw` in
   pmr/system/contacts.py. */
#ifndef PMR_LAW_H
#define PMR_LAW_H

#include <math.h>
#include <stddef.h>

/* ---- from here on cffi reads this file: declarations only ---- */

/* Constants of a pad's law: coefficients of a pad that slides and of one at rest, speed in m/s by which it falls from
   the latter to the former. */
enum { SLIDING, AT_REST, FALLS_BY, LAW_CONSTANTS };

/* ---- up to here ---- */

/* Derivatives of a pad's largest friction with respect to the size |N| of its force, and to the speed, in N s/m. */
typedef struct {
    double by_force, by_speed;
} pmr_friction_slopes;

/* Largest friction of a pad that presses with a force, mu(v) |N|, and how it changes with the force and the speed,

       mu(v) = mu_k + (mu_s - mu_k) exp(-v / v_s)

   (Stribeck 1902, in the form of Bo and Pavelescu 1982); Coulomb's law where mu_s = mu_k.  It has to be 0 where the
   force is 0, for pads that have lifted off have the same law. */
static inline double friction_limit(const double *law, double force, double speed, pmr_friction_slopes *slopes)
{
    const double more = law[AT_REST] - law[SLIDING];
    double falls = 0.0;
    if (more != 0.0) falls = more * exp(-speed / law[FALLS_BY]);
    if (slopes) {
        slopes->by_force = law[SLIDING] + falls;
        slopes->by_speed = more != 0.0 ? -falls / law[FALLS_BY] * fabs(force) : 0.0;
    }
    return (law[SLIDING] + falls) * fabs(force);
}

#endif
