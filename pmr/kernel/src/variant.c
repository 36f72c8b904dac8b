/* All of the kernel that is compiled for one kind of processor: PMR_VL doubles a register, its functions in the table
   PMR_FUNCTIONS. */
#include "internal.h"

#include <math.h>
#include <string.h>

#include "vectors.h"

#include "scheme.c"
#include "contact.c"
#include "rows.c"

static void free_motion(pmr_state *st, const pmr_scheme *c);
static void couple(const pmr_state *st, const pmr_scheme *c, const double *z, const double *v, double *result);
static int stand(pmr_state *st);
INLINE void subtract_rows(const pmr_state *st, int first, int last, double *sums);

#include "extrapolation.c"
#include "friction.c"
#include "terms.c"
#include "energy.c"
#include "step.c"
#include "substeps.c"
#include "outputs.c"
#include "state.c"
#include "start.c"
#include "linearize.c"
#include "advance.c"
#include "continuous.c"

const pmr_functions PMR_FUNCTIONS = {
    .name = PMR_VARIANT,
    .state_open = state_open,
    .state_adjust = state_adjust,
    .state_restore = state_restore,
    .state_bytes = state_bytes,
    .state_save = state_save,
    .start = start,
    .start_from = start_from,
    .start_in_frame = start_in_frame,
    .step = step_to,
    .step_in_frame = step_in_frame,
    .step_led = step_led,
    .advance = advance_signals,
    .advance_sampled = advance_sampled,
    .outputs = outputs,
    .further = further_outputs,
    .linearize = linearize,
    .evaluate = evaluate_at,
    .evaluate_along = evaluate_along,
    .check_start = check_start,
    .contact = contact_alone,
    .choose_changes = choose_changes,
    .factors = factors_alone,
    .friction = slide,
};
