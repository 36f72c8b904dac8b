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

/* Largest friction of a pad that presses with a force, mu(v) |N|, and how it changes with the speed,

       mu(v) = mu_k + (mu_s - mu_k) exp(-v / v_s)

   (Stribeck 1902, in the form of Bo and Pavelescu 1982); Coulomb's law where mu_s = mu_k. */
static inline double friction_limit(const double *law, double force, double speed, double *slope)
{
    const double more = law[AT_REST] - law[SLIDING];
    double falls = 0.0;
    if (more != 0.0) falls = more * exp(-speed / law[FALLS_BY]);
    if (slope) *slope = more != 0.0 ? -falls / law[FALLS_BY] * fabs(force) : 0.0;
    return (law[SLIDING] + falls) * fabs(force);
}

#endif
