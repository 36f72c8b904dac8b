/* All of the kernel that is compiled for one kind of processor: PMR_VL doubles a register, its functions in the table
   PMR_FUNCTIONS. */
#include "internal.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "vectors.h"
#include "carried.h"

#include "scheme.c"
#include "contact.c"
#include "rows.c"

static void free_motion(pmr_state *st, const pmr_scheme *c);
static void couple(const pmr_state *st, const pmr_scheme *c, const double *z, const double *v, double *result);
static int stand(pmr_state *st);
static int all_finite(const double *values, int count);
INLINE void subtract_rows(const pmr_state *st, int first, int last, double *sums);

#include "extrapolation.c"
#include "friction.c"
#include "terms.c"
#include "energy.c"
#include "step.c"
#include "substeps.c"
#include "outputs.c"
#include "state.c"
#include "linearize.c"
#include "start.c"
#include "advance.c"
#include "moving_rows.c"
#include "moments.c"
#include "whole.c"
#include "machine.c"
#include "continuous.c"

const pmr_functions PMR_FUNCTIONS = {
    .name = PMR_VARIANT,
    .state_open = state_open,
    .state_restore = state_restore,
    .start = start,
    .start_from = start_from,
    .step = step_to,
    .start_in_frame = start_in_frame,
    .step_in_frame = step_in_frame,
    .advance = advance_signals,
    .advance_sampled = advance_sampled,
    .carried_open = carried_open,
    .carried_needed = carried_needed,
    .carried_start = carried_start,
    .carried_advance = carried_advance,
    .outputs = outputs,
    .observe = observe,
    .linearize = linearize,
    .contact = contact_alone,
    .choose_changes = choose_changes,
    .extrapolate = extrapolate,
    .factors = factors_alone,
    .friction = friction_alone,
    .state_bytes = state_bytes,
    .state_save = state_save,
    .state_adjust = state_adjust,
    .step_led = step_led,
    .further = further_outputs,
    .evaluate = evaluate_at,
    .evaluate_along = evaluate_along,
    .check_start = check_start,
};
