/* All of the kernel that is compiled for one kind of processor: PMR_VL doubles a register, its functions in the table
   PMR_FUNCTIONS. */
#include "internal.h"

#include <float.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "numbers.h"
#include "vectors.h"

#include "space.c"
#include "contact.c"
#include "scheme.c"
#include "rows.c"

static void free_motion(pmr_state *st, const pmr_scheme *c);
static void couple(const pmr_state *st, const pmr_scheme *c, const double *z, const double *v, double *result);
static int stand(pmr_state *st);
static int all_finite(const double *values, int count);
INLINE void subtract_rows(const pmr_state *st, int first, int last, double *sums);
typedef struct pmr_course pmr_course;
static const double *extended_motions(pmr_state *st, const double *motions);
static int make_extended_part(pmr_state *st, const pmr_scheme *c, const pmr_course *course, int part, int parts);

#include "extrapolation.c"
#include "friction.c"
#include "terms.c"
#include "hoist.c"
#include "energy.c"
#include "step.c"
#include "substeps.c"
#include "outputs.c"
#include "moving_rows.c"
#include "machine.h"
#include "state.c"
#include "linearize.c"
#include "start.c"
#include "advance.c"
#include "moments.c"
#include "cylinder.c"
#include "whole.c"
#include "machine.c"
#include "luffing.c"
#include "extension.c"
#include "continuous.c"
#include "filter.c"
#include "chosen.c"

const pmr_functions PMR_FUNCTIONS = {
    .name = PMR_VARIANT,
#define ENTRY(result, name, code, parameters, arguments) .name = code,
#define VOID_ENTRY(name, code, parameters, arguments) .name = code,
    PMR_OF_VARIANTS(ENTRY, VOID_ENTRY)
};
